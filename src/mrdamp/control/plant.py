"""Structures as linear plants: states, and measurements as rows over them.

s = [x; x'] (2N,), s' = a s + b f + e w, of a frame w = xg''; a measurement is y = c s + d f. The damper's force f
is an input here, as a controller that measures it may treat it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.control.base import sensor_name
from mrdamp.errors import InputError
from mrdamp.structures import FloatArray, ShearFrame
from mrdamp.structures.mechanics import Mechanics


@dataclass(frozen=True)
class Plant:
    """a: (2N, 2N); b: (2N,) per N of damper force, of m dampers (2N, m); e: (2N,) per m/s2 of ground acceleration, of k
    loads (2N, k)."""

    a: FloatArray
    b: FloatArray
    e: FloatArray


#: Rows c (p, n) and feedthrough d (p,) of named measurements of a plant.
Outputs = Callable[[Sequence[str]], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Linear:
    """A structure as controllers see it.

    outputs: of measurements and strokes by name, InputError for an unknown one. measured: what a Kalman filter gets
    besides the forces; deviation: (p,) of white noise on it, one by default. regulated: weights by name that force
    controllers make small by default. first: rad/s. hooks: a damper each, number of the accelerometer at its rod end
    (from 1), -1 where that is at its other end; dashpot: N s/m, of a skyhook by default.
    """

    plant: Plant
    outputs: Outputs
    measured: tuple[str, ...]
    regulated: Mapping[str, float]
    first: float
    hooks: tuple[tuple[int, float], ...] = ()
    dashpot: float = 0.0
    deviation: FloatArray | None = None

    @property
    def dampers(self) -> int:
        return 1 if self.plant.b.ndim == 1 else self.plant.b.shape[1]


    def weighted(self, what: str, weights: Mapping[str, float]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rows c, feedthrough d and weights (p,) of the outputs that have one. what: they are, for messages. Raises
        InputError."""
        if not weights or any(not 0 <= w < math.inf for w in weights.values()) or not any(weights.values()):
            raise InputError(f"{what} {dict(weights)}; allowed: weights >= 0, one of them > 0")
        return *self.outputs(tuple(weights)), np.array(list(weights.values()))


def linear(structure: ShearFrame | Linear) -> Linear:
    """Of a frame: what Dyke's filter got, all floor accelerations and `displacement_1`; regulated is the top floor's
    absolute acceleration. The dashpot would damp a rigid frame with the first frequency with a ratio of one half.
    """
    if isinstance(structure, Linear):
        return structure
    frame, first = structure, float(2 * np.pi * structure.frequencies[0])
    floors = tuple(f"acceleration_{i}" for i in range(1, frame.storeys + 1))
    # Of the two floors of a damper the rod is at the second.
    hooks = tuple((max(p), 1.0 if max(p) == p[1] else -1.0) for p in frame.places)
    return Linear(
        plant(frame), lambda names: outputs(frame, names), (*floors, "displacement_1"), {floors[-1]: 1.0}, first, hooks,
        first * float(frame.mass.sum()),
    )  # fmt: skip


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
    n, linear = frame.storeys, plant(frame)
    none, unit = np.zeros(n), np.eye(n)
    rows, direct = {}, {}
    for k, gamma in enumerate(np.reshape(frame.gamma, (n, -1)).T):
        rows[sensor_name("stroke", k)] = np.append(-gamma, none)
        rows[sensor_name("stroke_velocity", k)] = np.append(none, -gamma)
    for j in range(n):
        rows[f"acceleration_{j + 1}"], direct[f"acceleration_{j + 1}"] = linear.a[n + j], linear.b[n + j]
        rows[f"displacement_{j + 1}"] = np.append(unit[j], none)
        rows[f"drift_{j + 1}"] = np.append(unit[j] - unit[j - 1] if j else unit[j], none)
    return named_rows(rows, direct, names)


def plant_of(system: Mechanics) -> Plant:
    """First-order form; e (2n, k) per unit of the loads."""
    n = len(system.stroke)
    a = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), system.rate])
    b = np.append(np.zeros(n), system.push[:, 0])
    return Plant(a, b, np.vstack([np.zeros_like(system.loaded), system.loaded]))


def outputs_of(
    system: Mechanics, places: Mapping[str, FloatArray], more: Mapping[str, FloatArray], names: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """Rows c (p, 2n) and feedthrough d (p,) of measurements by name: acceleration_P, velocity_P and displacement_P of
    places P, rows (n,); stroke, stroke_velocity; and more rows over the coordinates. Raises InputError."""
    none = np.zeros_like(system.stroke)
    rows = {"stroke": np.append(system.stroke, none), "stroke_velocity": np.append(none, system.stroke)}
    direct = {}
    for place, at in places.items():
        rows[f"displacement_{place}"], rows[f"velocity_{place}"] = np.append(at, none), np.append(none, at)
        rows[f"acceleration_{place}"] = at @ system.rate
        direct[f"acceleration_{place}"] = np.asarray(at @ system.push[:, 0])
    rows |= {name: np.append(row, none) for name, row in more.items()}
    return named_rows(rows, direct, names)


def named_rows(
    rows: Mapping[str, FloatArray], direct: Mapping[str, FloatArray], names: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """Rows c (p, n) and feedthrough d, 0 by default, by name. Raises InputError for one that is not there."""
    if unknown := [name for name in names if name not in rows]:
        raise InputError(f"measurement {unknown[0]!r} is unknown; allowed: {', '.join(rows)}")
    none = np.zeros_like(next(iter(direct.values()), np.zeros(())))
    return np.array([rows[name] for name in names]), np.array([direct.get(name, none) for name in names])
