"""Paths for the reference rig's rod, and what the force is told by where the law is not the question."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from studies.blindtest import bench, rig
from studies.blindtest.bench import Truth
from studies.blindtest.rig import RATE_HZ, Array

DASHPOT = {"law": 0.0, "c0a": 1000.0, "v_ref": 1.0}
#: A yield force of 100 N per ampere.
YIELD = {"law": 0.0, "fyb": 100.0, "v_ref": 1e-3}
NOTHING = {"law": 0.0, "v_ref": 1.0}
PLAIN = {"mass": 100.0, "stiffness": 4e5, "damping": 50.0}


def clock(end: float, rate: int = RATE_HZ) -> Array:
    """Half steps."""
    return np.arange(round(end * 2 * rate) + 1) / (2 * rate)


def moved(numbers: Mapping[str, float], t: Array, x: Array, u: Array | float = 1.0) -> dict[str, Array]:
    """A rod on a path, with its velocity by differences."""
    return rig.run_damper(numbers, x, np.gradient(x, t), np.broadcast_to(u, t.shape))


def held(numbers: Mapping[str, float], t: Array, u: Array) -> dict[str, Array]:
    return rig.run_damper(numbers, 0 * t, 0 * t, u)


def steady(numbers: Mapping[str, float], speed: float, end: float = 0.2, u: float = 1.0) -> dict[str, Array]:
    t = clock(end)
    return rig.run_damper(numbers, speed * t, np.full(len(t), speed), np.full(len(t), u))


def at(seconds: float) -> int:
    return round(seconds * RATE_HZ)


def cycle(numbers: Mapping[str, float], hz: float = 1.0) -> tuple[Array, Array]:
    """Place (m) and force over the last of three cycles that begin with the stroke from 0 to 10 mm."""
    t = clock(3 / hz)
    x = 0.005 * (1 - np.cos(2 * np.pi * hz * t))
    last = slice(at(2 / hz), None)
    return x[::2][last], moved(numbers, t, x)["force"][last]


def on_the_way(numbers: Mapping[str, float], place: float, hz: float = 1.0) -> tuple[float, float]:
    """Force where the rod passes a place (m), out and back."""
    x, force = cycle(numbers, hz)
    half = len(x) // 2
    out = np.interp(place, x[:half], force[:half])
    return float(out), float(np.interp(place, x[half:][::-1], force[half:][::-1]))


def sensed(force: Array, seed: int = 0, **numbers: float) -> Array:
    """What a sensor with such numbers reads."""
    truth = Truth({}, {f"sensor.{name}": value for name, value in numbers.items()})
    return bench.sensor(truth, "sensor", force, np.random.default_rng(seed))
