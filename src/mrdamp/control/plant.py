"""A shear frame as a linear plant: states, and measurements as rows over them.

s = [x; x'] (2N,), s' = a s + b f + e xg''; a measurement is y = c s + d f. The damper's force f
is an input here, as a controller that measures it may treat it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.control.base import sensor_name
from mrdamp.errors import InputError
from mrdamp.structures import FloatArray, ShearFrame


@dataclass(frozen=True)
class Plant:
    """a: (2N, 2N); b: (2N,) per N of damper force, of m dampers (2N, m); e: (2N,) per m/s2 of ground acceleration, of k
    loads (2N, k)."""

    a: FloatArray
    b: FloatArray
    e: FloatArray


def plant(frame: ShearFrame) -> Plant:
    """First-order form of the frame's equation of motion."""
    n = frame.storeys
    inverse = np.diag(1 / frame.mass)
    a = np.zeros((2 * n, 2 * n))
    a[:n, n:] = np.eye(n)
    a[n:, :n] = -inverse @ frame.stiffness_matrix
    a[n:, n:] = -inverse @ frame.damping_matrix
    return Plant(
        a=a,
        b=np.concatenate([np.zeros_like(frame.gamma), inverse @ frame.gamma]),
        e=np.concatenate([np.zeros(n), -np.ones(n)]),
    )


def outputs(frame: ShearFrame, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Rows c (p, 2N) and feedthrough d (p,), of m dampers (p, m), of the named measurements (see control.base).

    Absolute accelerations are M^-1 (Gamma f - K x - C x'): the ground's own does not appear.
    `drift_j` (m) may be named too. Raises InputError on a name the frame does not have.
    """
    n = frame.storeys
    linear = plant(frame)
    c = np.zeros((len(names), 2 * n))
    d = np.zeros((len(names), *linear.b.shape[1:]))
    strokes = {sensor_name("stroke", k): gamma for k, gamma in enumerate(np.reshape(frame.gamma, (n, -1)).T)}
    for row, name in enumerate(names):
        match = re.fullmatch(r"(acceleration|displacement|drift)_([1-9]\d*)", name)
        floor = int(match.group(2)) - 1 if match else 0
        if name in strokes:
            c[row, :n] = -strokes[name]
        elif name.replace("_velocity", "") in strokes:
            c[row, n:] = -strokes[name.replace("_velocity", "")]
        elif match is None or floor >= n:
            raise InputError(
                f"measurement {name!r} is unknown; allowed: acceleration_i, displacement_i, drift_i "
                f"with i = 1..{n}, stroke, stroke_velocity"
            )
        elif match.group(1) == "acceleration":
            c[row] = linear.a[n + floor]
            d[row] = linear.b[n + floor]
        else:
            c[row, floor] = 1.0
            if match.group(1) == "drift" and floor > 0:
                c[row, floor - 1] = -1.0
    return c, d
