"""Make the calibration records that come with the package: a piezoelectric force sensor on a test machine.

Sixteen force-controlled sines, 0.2, 1, 2.5 and 5 Hz by 500, 1000, 1500 and 2000 N, as in the self-sensing paper
(Chen, Ni, Or), at 250 Hz. The physics is this file's own::

    force    F   = A r(t) sin(2 pi f t) (1 + third harmonic of 0.6 %) + PRELOAD            the machine's waveform
    wafer    q   = K (F + RAYLEIGH_LOSS h(F)),   K = K_0 (1 + RAYLEIGH_GAIN A)               Rayleigh hysteresis
    leakage  Q'  = q' - Q / TAU                                                            charge leaks away
    meter    y'  = (Q - y) / TAU_METER                                                     charge amplifier
    cell     z'  = (F - z) / TAU_CELL                                                      load cell's amplifier

h is a Prandtl sum of play operators (2, 5, 12, 30 % of the amplitude). Noise, mains hum and the steps of the
converters are added. No measured data are used.

    python tools/make_calibration.py [FOLDER]        (default: src/mrdamp/data/calibration)
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mrdamp.files import write_atomic
from mrdamp.records.csv_file import render

Array = NDArray[np.float64]

RATE = 250.0  # Hz, of the records
FINE = 40  # inner steps for each sample
K_0 = -158.0  # pC/N
RAYLEIGH_GAIN = 8.0e-6  # 1/N, sensitivity grows with the amplitude
RAYLEIGH_LOSS = 0.02  # share of the force that lags by play
PLAYS = (0.02, 0.05, 0.12, 0.30)  # widths over the amplitude
TAU = 45.0  # s, charge leakage
TAU_METER, TAU_CELL = 0.9e-3, 0.4e-3  # s
PRELOAD = 120.0  # N, the machine's zero is not the sensor's
NOISE_F, STEP_F = 4.0, 1.0  # N
NOISE_Q, STEP_Q = 900.0, 200.0  # pC
HUM_F, HUM_Q = 3.0, 1500.0  # N and pC at 50 Hz
FREQUENCIES = (0.2, 1.0, 2.5, 5.0)  # Hz
AMPLITUDES = (500.0, 1000.0, 1500.0, 2000.0)  # N
DURATION = {0.2: 20.0, 1.0: 8.0, 2.5: 5.0, 5.0: 4.0}  # s


def low_pass(x: Array, tau: float, dt: float) -> Array:
    """y' = (x - y)/tau, exact for straight lines between samples."""
    y, decay = np.empty_like(x), math.exp(-dt / tau)
    y[0] = x[0]
    for k in range(1, len(x)):
        slope = (x[k] - x[k - 1]) / dt
        y[k] = x[k] - slope * tau + (y[k - 1] - x[k - 1] + slope * tau) * decay
    return y


def play(x: Array, width: float) -> Array:
    """The play operator of that width, side to side."""
    y, at = np.empty_like(x), float(x[0])
    for k, value in enumerate(x):
        at = min(max(at, value - width / 2), value + width / 2)
        y[k] = at
    return y


def test(frequency: float, amplitude: float, seed: int) -> dict[str, Array]:
    """Columns of one test: time_s, reference_force_N, charge_pC."""
    dt = 1.0 / RATE / FINE
    t = dt * np.arange(round(DURATION[frequency] * RATE) * FINE)
    angle = 2 * np.pi * frequency * t
    ramp = np.minimum(1.0, t * frequency / 0.5)
    swing = amplitude * ramp * (np.sin(angle) + 0.006 * np.sin(3 * angle + 0.4))
    time, cell, charge = sensed(swing, amplitude, dt, FINE, PRELOAD, seed)
    return {"time_s": time, "reference_force_N": cell, "charge_pC": charge}


def sensed(
    swing: Array, amplitude: float, dt: float, fine: int, preload: float, seed: int
) -> tuple[Array, Array, Array]:
    """Time (n,) s, load cell (n,) N and charge (n,) pC at every `fine`-th step of a force (m,) N of steps dt (s)."""
    lagging = np.mean([play(swing, w * amplitude) for w in PLAYS], axis=0)
    charge = K_0 * (1 + RAYLEIGH_GAIN * amplitude) * ((1 - RAYLEIGH_LOSS) * swing + RAYLEIGH_LOSS * lagging)
    leaked = charge - low_pass(charge, TAU, dt)  # the high-pass that leakage is
    meter, cell = low_pass(leaked, TAU_METER, dt)[::fine], low_pass(swing, TAU_CELL, dt)[::fine] + preload
    rng, time = np.random.default_rng(seed), dt * np.arange(len(swing), dtype=float)[::fine]
    hum = 2 * np.pi * 50.0 * time + rng.uniform(0, 2 * np.pi)
    force = cell + HUM_F * np.sin(hum) + NOISE_F * rng.standard_normal(len(time))
    q = meter + HUM_Q * np.sin(hum + 1.0) + NOISE_Q * rng.standard_normal(len(time))
    return time, np.asarray(np.round(force / STEP_F) * STEP_F), np.asarray(np.round(q / STEP_Q) * STEP_Q)


def main(folder: Path) -> None:
    """Write the sixteen tests."""
    folder.mkdir(parents=True, exist_ok=True)
    for i, frequency in enumerate(FREQUENCIES):
        for j, amplitude in enumerate(AMPLITUDES):
            columns = test(frequency, amplitude, 1000 + 10 * i + j)
            path = folder / f"calibration_{frequency:.1f}Hz_{amplitude:04.0f}N.csv.gz"
            write_atomic(path, render(columns, 7))


if __name__ == "__main__":
    default = Path(__file__).parents[1] / "src" / "mrdamp" / "data" / "calibration"
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else default)
