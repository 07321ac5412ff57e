"""Dyke's frame with its modified Bouc-Wen damper, integrated by SciPy from equations written out once more."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.integrate import solve_ivp

from excitation import Array

# Dyke et al. 1996, doi 10.1088/0964-1726/5/5/006, typed in.
MASS = 98.3
STIFFNESS = np.array([[12e5, -6.84e5, 0], [-6.84e5, 13.68e5, -6.84e5], [0, -6.84e5, 6.84e5]])
DAMPING = np.array([[175.0, -50, 0], [-50, 100, -50], [0, -50, 50]])
C0, C1, K0, K1 = (2100.0, 350.0), (28300.0, 295.0), 4690.0, 500.0
ALPHA, GAMMA, BETA, A = (14000.0, 69500.0), 3.63e6, 3.63e6, 301.0
LAG = 1 / 190.0  # s


def solve(
    ground: Callable[[float], float], commands: Array, period: float, every: float, floor: int = 1
) -> Mapping[str, Array]:
    """Free run with commands (n,) V held a period (s) each; channels at steps of `every` (s). floor: the damper
    stands between it and the floor below. Channels: displacement (3,), acceleration (3,) absolute, force, current,
    energy (J, of the damper)."""
    along = np.zeros(3)
    along[floor - 1] = 1.0
    if floor > 1:
        along[floor - 2] = -1.0

    def law(x: float, v: float, z: float, y: float, i: float) -> tuple[float, float]:
        c0, c1, alpha = C0[0] + C0[1] * i, C1[0] + C1[1] * i, ALPHA[0] + ALPHA[1] * i
        rate = (alpha * z + c0 * v + K0 * (x - y)) / (c0 + c1)
        return c1 * rate + K1 * x, rate

    def shares(s: Array) -> tuple[float, float, Array]:
        x, v = float(along @ s[:3]), float(along @ s[3:6])
        force, rate = law(x, v, s[6], s[7], s[8])
        return force, rate, -(STIFFNESS @ s[:3] + DAMPING @ s[3:6] + along * force) / MASS

    def rhs(t: float, s: Array, u: float) -> Array:
        force, rate, absolute = shares(s)
        v = float(along @ s[3:6])
        w, z = v - rate, s[6]
        z_rate = -GAMMA * abs(w) * abs(z) * z - BETA * w * z * z + A * w
        return np.concatenate([s[3:6], absolute - ground(t), [z_rate, rate, (u - s[8]) / LAG, force * v]])

    state = np.zeros(10)
    steps = round(period / every)
    rows = []
    for k, u in enumerate(commands):
        times = k * period + every * np.arange(steps + 1)
        found = solve_ivp(
            rhs,
            (times[0], times[-1]),
            state,
            "LSODA",
            times,
            args=(u,),
            rtol=1e-8,
            atol=1e-10,
            max_step=every,
        )
        rows.append(found.y[:, :-1].T)
        state = found.y[:, -1]
    s = np.concatenate([*rows, state[None]])
    forces, _, absolute = zip(*(shares(row) for row in s), strict=True)
    return {
        "displacement": s[:, :3],
        "acceleration": np.array(absolute),
        "force": np.array(forces),
        "current": s[:, 8],
        "energy": s[:, 9],
    }
