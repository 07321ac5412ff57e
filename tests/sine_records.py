"""Records of a Bingham damper written out in NumPy, at constant or stepping commands: truth for fits."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mrdamp.model.core import Array
from mrdamp.records import Record

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
