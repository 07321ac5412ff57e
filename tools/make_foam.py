"""Make the foam damper's records that come with the package: the experiment of the foam-damper paper, simulated.

Zapateiro, Luo, Taylor and Dyke 2010: the hyperbolic tangent plant with the numbers as printed, integrated by SciPy from
Eqs. (5) and (8) in N, cm, s and V. This file shares nothing with the package but the writing of records::

    plant     m0 x0'' = -(k0 + k1) x0 - (c0 + c1) x0' + k1 x + c1 x' - f0 tanh(x0' / V_REF)
              F = k1 (x - x0) + c1 (x' - x0')
    lines     p = p_a w + p_b for k0, k1, c1 and f0; c0, m0 and V_REF constant
    field     w = V_S - S ln(1 + exp((V_S - u) / S)): as u up to about 3 V, then constant (Fig. 7)
    actuator  x = A r(t) sin(2 pi f t) + y,  y'' + 2 ZETA OMEGA y' + OMEGA^2 y = -OMEGA^2 X_F tanh(s / S_F)
              friction, s the velocity that is asked for: the fluctuations after each reversal (Section 5)
    sensors   noise and steps of the converters, 256 Hz; the mean of the force is not zero

The paper's noise and the actuator's friction are given by their effect only; both are chosen here. With the printed c0
the force at 4 Hz, 0.8 cm and 3 V is 28 N, twice that of the paper's other two models.

    python tools/make_foam.py [FOLDER [HZ ...]]        (default: src/mrdamp/data/foam)

HZ: of the training tests that are written, for a set with fewer frequencies (Section 5.4).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from mrdamp.records import Record

Array = NDArray[np.float64]

RATE = 256.0  # Hz
K0, K1 = (0.0193, 0.5383), (148.4435, -47.4474)  # N/(cm V), N/cm
C1, F0 = (0.0385, 0.0044), (4.9328, -1.3704)  # N s/(cm V), N s/cm; N/V, N
C0, M0, V_REF = 0.7494, 0.00008, 0.330  # N s/cm, N s2/cm, cm/s
V_S, S = 3.0, 0.1  # V, where the field saturates, and how softly
OMEGA, ZETA, X_F, S_F = 2 * math.pi * 25.0, 0.12, 1.5e-3, 0.3  # rad/s, 1, cm, cm/s
NOISE_X, STEP_X = 3e-4, 1e-4  # cm
NOISE_F, STEP_F, ZERO_F = 0.1, 0.02, 0.4  # N
VOLTAGES = (0.6, 1.0, 2.0, 3.0, 4.0)
#: Folder, Hz and cm; every one at every voltage. The paper's comparisons are at 4 Hz and 0.8 cm.
TESTS = (
    ("train", 0.5, 0.8), ("train", 1.0, 0.4), ("train", 3.0, 0.8), ("train", 5.0, 0.4), ("train", 5.0, 0.8),
    ("validation", 2.0, 0.6), ("test", 4.0, 0.8), ("train", 2.0, 0.2),
)  # fmt: skip


def line(p: tuple[float, float], u: float) -> float:
    """Eq. (8) at a voltage, with the field's saturation."""
    return p[0] * (V_S - S * math.log1p(math.exp((V_S - u) / S))) + p[1]


def simulate(frequency: float, amplitude: float, u: float, friction: float = X_F) -> tuple[Array, Array]:
    """Displacement (n,) cm and force (n,) N at the records' rate, free of noise; Hz, cm, V, cm."""
    k0, k1, c1, f0 = (line(p, u) for p in (K0, K1, C1, F0))
    w, count = 2 * math.pi * frequency, round(RATE * max(2.0, 3.0 / frequency))

    def asked(t: float) -> tuple[float, float]:
        if t >= 0.25:
            return amplitude * math.sin(w * t), amplitude * w * math.cos(w * t)
        ramp, rate = 0.5 - 0.5 * math.cos(4 * math.pi * t), 2 * math.pi * math.sin(4 * math.pi * t)
        return ramp * amplitude * math.sin(w * t), amplitude * (ramp * w * math.cos(w * t) + rate * math.sin(w * t))

    def rates(t: float, s: Array) -> list[float]:
        (x, v), (y, dy, x0, dx0) = asked(t), s
        pull = -(OMEGA**2) * (y + friction * math.tanh(v / S_F)) - 2 * ZETA * OMEGA * dy
        inner = -(k0 + k1) * x0 - (C0 + c1) * dx0 + k1 * (x + y) + c1 * (v + dy) - f0 * math.tanh(dx0 / V_REF)
        return [dy, pull, dx0, inner / M0]

    time = np.arange(count) / RATE
    found = solve_ivp(rates, (0, time[-1]), [0.0] * 4, "LSODA", time, rtol=1e-8, atol=1e-9, max_step=2e-3)
    if not found.success:
        raise RuntimeError(found.message)
    y, dy, x0, dx0 = found.y
    x, v = np.array([asked(t) for t in time]).T
    return x + y, k1 * (x + y - x0) + c1 * (v + dy - dx0)


def record(frequency: float, amplitude: float, u: float, seed: int) -> Record:
    """The test as its sensors see it, in the package's units."""
    x, force = simulate(frequency, amplitude, u)
    rng = np.random.default_rng(seed)
    x = np.round((x + NOISE_X * rng.standard_normal(len(x))) / STEP_X) * STEP_X
    force = np.round((force + ZERO_F + NOISE_F * rng.standard_normal(len(x))) / STEP_F) * STEP_F
    name = f"sine_{frequency:.1f}Hz_{10 * amplitude:.1f}mm_{u:.1f}V"
    channels = {"displacement_m": 0.01 * x, "command": np.full(len(x), u), "force_N": force}
    return Record(name, None, 1.0 / RATE, channels)


def main(folder: Path, trained: Sequence[float] = ()) -> None:
    """Write every test; trained: Hz of the training tests that are written, empty for all."""
    seed = 300
    for half, frequency, amplitude in TESTS:
        (folder / half).mkdir(parents=True, exist_ok=True)
        for u in VOLTAGES:
            seed += 1
            if half != "train" or not trained or frequency in trained:
                made = record(frequency, amplitude, u, seed)
                made.save(folder / half / f"{made.name}.csv.gz", digits=6)


if __name__ == "__main__":
    default = Path(__file__).parents[1] / "src" / "mrdamp" / "data" / "foam"
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else default, [float(hz) for hz in sys.argv[2:]])
