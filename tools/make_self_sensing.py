"""Make the self-sensing damper's records that come with the package: the harmonic tests of the self-sensing paper.

Chen, Ni and Or 2015: the constant-current sets at 0.5 A of Sections 3.3 and 3.4, in `train`, `validation` and `test`,
and the performance tests of Fig. 4 and Table 1, a 5 Hz, 5 mm sine at five currents, in `train`. The damper is that of
make_embedded.py, its own sensor and the load cell those of make_calibration.py: charge with hysteresis, leakage and a
slower amplifier, noise and hum. Both are zero at rest. `force_N` is the charge over the mean sensitivity that
`mrdamp calibrate` finds on the calibration tests, Eq. (3).

    python tools/make_self_sensing.py [FOLDER]        (default: src/mrdamp/data/self_sensing)
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from make_calibration import sensed
from make_embedded import NOISE_X, RATE, STEP_X, Trial, constant, simulate, sine, triangle

from mrdamp.identify.calibration import calibrate, corrected, embedded_tests
from mrdamp.records import Record

FINE = 10  # inner steps for each sample
#: Shape, Hz, mm, A.
TESTS = {
    "train": (
        ("sine", 1.0, 1.0, 0.5), ("sine", 5.0, 5.0, 0.5),
        ("sine", 5.0, 5.0, 0.0), ("sine", 5.0, 5.0, 0.25), ("sine", 5.0, 5.0, 0.75), ("sine", 5.0, 5.0, 1.0),
    ),
    "validation": (("sine", 1.0, 5.0, 0.5), ("sine", 5.0, 1.0, 0.5)),
    "test": (
        ("sine", 2.5, 1.0, 0.5), ("sine", 2.5, 5.0, 0.5),
        ("triangle", 1.0, 5.0, 0.5), ("triangle", 2.5, 5.0, 0.5), ("triangle", 5.0, 5.0, 0.5),
    ),
}  # fmt: skip


def record(shape: str, frequency: float, mm: float, current: float, seed: int, sensitivity: float) -> Record:
    """One test as the damper's own sensor and the machine see it; sensitivity in pC/N."""
    name = f"{shape}_{frequency:.1f}Hz_{mm:.1f}mm_{current:.2f}A"
    motion = (sine if shape == "sine" else triangle)(frequency, 1e-3 * mm)
    trial = Trial("", name, 5.0 if frequency < 2 else 3.0, motion, constant(current), seed)
    _, x, command, force = simulate(trial, FINE * RATE)
    swing = force - force[0]
    time, cell, charge = sensed(swing, float(np.abs(swing).max()), 1 / RATE / FINE, FINE, 0.0, seed)
    noise = NOISE_X * np.random.default_rng(seed + 1000).standard_normal(len(time))
    channels = {
        "displacement_m": np.round((x[::FINE] + noise) / STEP_X) * STEP_X,
        "command": command[::FINE],
        "force_N": np.round(corrected(charge, 1 / RATE, sensitivity), 3),
        "reference_force_N": cell,
        "charge_pC": charge,
    }
    return Record(name, None, 1 / RATE, channels)


def main(folder: Path) -> None:
    """Write every test."""
    sensitivity, seed = calibrate(embedded_tests()).sensitivity, 400
    for half, tests in TESTS.items():
        (folder / half).mkdir(parents=True, exist_ok=True)
        for test in tests:
            seed += 1
            made = record(*test, seed, sensitivity)
            made.save(folder / half / f"{made.name}.csv.gz", digits=7)


if __name__ == "__main__":
    default = Path(__file__).parents[1] / "src" / "mrdamp" / "data" / "self_sensing"
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else default)
