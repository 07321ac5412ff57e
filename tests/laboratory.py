"""Records as a laboratory makes them of a damper with known parameters: sines at constant commands, SciPy, noise;
and of a Bingham damper written out in NumPy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from excitation import Array, constant, sine
from mrdamp import sets
from mrdamp.records import Record
from twins import simulate

#: Parameters by law. That of modified_bouc_wen forgets x - y in (c0 + c1) / k0 = 6.5 s.
TRUE: dict[str, dict[str, float]] = {
    "bingham": {"c0a": 650.0, "c0b": 200.0, "fya": 50.0, "fyb": 400.0, "v_ref": 0.01},
    "bouc_wen": {
        "c0a": 650.0, "c0b": 300.0, "alpha_a": 60.0, "alpha_b": 500.0, "gamma": 1200.0, "beta": 800.0, "A": 2000.0,
        "n": 2.0, "k0": 500.0, "x0": 0.0,
    },
    "hyperbolic_tangent": {
        "k0a": 500.0, "k0b": 0.0, "k1a": 1e5, "k1b": 3e4, "c0a": 600.0, "c0b": 300.0, "c1a": 1500.0, "c1b": 500.0,
        "m0": 1.0, "f0a": 60.0, "f0b": 400.0, "v_ref": 0.02,
    },
    "modified_bouc_wen": {
        **{k: v for k, v in sets.load("spencer1997_3kN").parameters.items() if "command" not in k}, "x0": 0.0,
    },
}  # fmt: skip
#: Amplitude (m) and frequency (Hz) of the tests.
SINES = ((0.005, 4.0), (0.01, 1.5), (0.02, 0.5))
COMMANDS = (0.0, 0.5, 1.0)


@cache
def clean(law: str, dt: float, duration: float, k: int) -> tuple[str, Array, float, Array]:
    """Name, displacement (n,), command and force (n,) of a test, from rest."""
    (amplitude, frequency), command = SINES[k // len(COMMANDS)], COMMANDS[k % len(COMMANDS)]
    t: Array = np.asarray(dt * np.arange(round(duration / dt) + 1), dtype=np.float64)
    motion = sine(amplitude, frequency)
    force = simulate(law, TRUE[law], motion, t, constant(command))["force"]
    return f"{amplitude}_{frequency}_{command}", motion.sample(t)[0], command, force


def rig_tests(
    law: str, *, seed: int = 0, dt: float = 1e-3, duration: float = 4.0, noise: float = 0.01, late: float = 0.0,
    chosen: Sequence[int] = range(9),
) -> list[Record]:  # fmt: skip
    """Nine records, or those chosen, with noise of a share of each force's deviation. late: s, that the recording
    begins after the motion; duration is what is recorded."""
    rng, skip, out = np.random.default_rng(seed), round(late / dt), []
    for k in chosen:
        name, x, command, force = clean(law, dt, duration + late, k)
        measured = (force + noise * np.std(force) * rng.standard_normal(len(force)))[skip:]
        channels = {"displacement_m": x[skip:], "command": np.full(len(measured), command), "force_N": measured}
        out.append(Record(name, None, dt, channels))
    return out


def identifiable(law: str) -> dict[str, float]:
    """The true parameters as a fit states them: z of the Bouc-Wen laws is scaled to end at 1 (arithmetic by hand)."""
    p = dict(TRUE[law])
    if "A" not in p:
        return p
    both = p["beta"] + p["gamma"]
    end = (p["A"] / both) ** (1 / p["n"])  # where dz/dx = A - (beta + gamma) z^n is 0
    slope = p["A"] / end
    scaled = {"alpha_a": p["alpha_a"] * end, "alpha_b": p["alpha_b"] * end, "A": slope}
    return p | scaled | {"beta": slope * p["beta"] / both, "gamma": slope * p["gamma"] / both}


V_REF, OFFSET = 0.01, 12.0
Curve = Callable[[Array], Array]


def bingham_record(
    name: str,
    amplitude: float,
    frequency: float,
    command: float | Array,
    viscous: Curve,
    friction: Curve,
    seed: int,
    noise: float = 2.0,
) -> Record:
    """Two seconds at 500 Hz; viscous (N s/m) and friction (N) as functions of the command; noise in N."""
    dt = 0.002
    t = dt * np.arange(1000)
    u = np.full(len(t), float(command)) if np.ndim(command) == 0 else np.asarray(command)
    w = 2 * math.pi * frequency
    v = amplitude * w * np.cos(w * t)
    force = viscous(u) * v + friction(u) * np.tanh(v / V_REF) + OFFSET
    force += np.random.default_rng(seed).normal(0, noise, len(t))
    channels = {"displacement_m": amplitude * np.sin(w * t), "command": u, "force_N": force}
    return Record(name, None, dt, channels)


def straight(u: Array) -> Array:
    return np.asarray(40.0 + 300.0 * u)


def viscous(u: Array) -> Array:
    return np.asarray(400.0 + 250.0 * u)


def grid(
    friction: Curve = straight, commands: tuple[float, ...] = (0.0, 0.4, 0.8, 1.2), seed: int = 0
) -> list[Record]:
    return [
        bingham_record(f"{u:g}A_{mm}mm", 1e-3 * mm, hz, u, viscous, friction, seed + 10 * k + j)
        for k, u in enumerate(commands)
        for j, (mm, hz) in enumerate(((4, 2.0), (8, 1.0)))
    ]
