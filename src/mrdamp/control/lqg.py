"""Structures as linear plants, their linear-quadratic-Gaussian gains, and the Kalman filter.

s = [x; x'] (2N,), s' = a s + b f + e w, of a frame w = xg''; a measurement is y = c s + d f. The damper's force f is an
input here, as a controller that measures it may treat it. The filter

    s_hat' = a s_hat + b f + l (y - c s_hat - d f)

is stepped once per control period, exactly for measurements that are linear between the samples (first-order hold).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, solve_continuous_are

from mrdamp.control.base import sensor_name
from mrdamp.errors import InputError
from mrdamp.structures import FloatArray, ShearFrame
from mrdamp.structures.lumped import Mechanics


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
    absolute acceleration. The dashpot would damp a rigid frame with the first frequency with a ratio of one half."""
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
    inverse = np.diag(1 / frame.mass)
    rate = np.hstack([-inverse @ frame.stiffness_matrix, -inverse @ frame.damping_matrix])
    return first_order(rate, inverse @ frame.gamma, -np.ones(frame.storeys))


def first_order(rate: FloatArray, push: FloatArray, loaded: FloatArray) -> Plant:
    """Of accelerations q'' = rate [q; q'] + push f + loaded w."""
    n = len(rate)
    a = np.vstack([np.eye(n, 2 * n, n), rate])
    return Plant(a, *(np.concatenate([np.zeros_like(part), part]) for part in (push, loaded)))


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
    return first_order(system.rate, system.push[:, 0], system.loaded)


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


def regulator_gain(
    a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray, q: FloatArray, r: float
) -> FloatArray:
    """k (2N,) of f = -k s, which minimises the integral of y^T diag(q) y + r f^2, y = c s + d f.

    a (n, n), b (n,), c (p, n), d (p,), q (p,) weights, r > 0 in 1/N^2 times the unit of the cost. For m forces b is
    (n, m), d (p, m) and k (m, n).
    Where y holds the force itself (d not 0) the cross terms of the cost are kept. Raises
    InputError where no such gain is found: the cost then does not see a mode that barely decays.
    """
    # The force is solved for in units that make its weight one: r is 1e-17 in N^-2.
    drive, through = b.reshape(len(b), -1), d.reshape(len(d), -1)
    many = drive.shape[1]
    weight = r * np.eye(many) + through.T @ (q[:, None] * through)
    unit = np.linalg.inv(np.linalg.cholesky(weight)).T
    cross = c.T @ (q[:, None] * through) @ unit
    scaled = drive @ unit
    with _needs_stable(
        f"no stable regulator found for r = {r:g}; raise r or regulate more measurements"
    ) as check:
        p = solve_continuous_are(a, scaled, c.T @ (q[:, None] * c), np.eye(many), s=cross)
        k = np.asarray(unit @ (scaled.T @ p + cross.T), dtype=np.float64)
        check(a - drive @ k)
    return k if b.ndim > 1 else k[0]


def kalman_gain(
    a: FloatArray, e: FloatArray, c: FloatArray, noise_ratio: float, deviation: FloatArray | None = None
) -> FloatArray:
    """l (n, p) of s' = a s + l (y - c s) for white noise on the load and on each measurement.

    e (n,), or (n, k) for k independent loads: how the load (the ground's acceleration) enters; noise_ratio: S_g / S_v,
    the intensity of each load's noise over that of every measurement's, each in units of its deviation (p,), one by
    default. Raises InputError where no filter is found.
    """
    unit = np.ones(len(c)) if deviation is None else deviation
    loads = e.reshape(len(a), -1)
    rows = c / unit[:, None]
    with _needs_stable(f"no stable filter found for noise_ratio = {noise_ratio:g}; measure more") as check:
        p = solve_continuous_are(a.T, rows.T, noise_ratio * loads @ loads.T, np.eye(len(c)))
        gain = np.asarray(p @ rows.T / unit, dtype=np.float64)
        check(a - gain @ c)
    return gain


@contextmanager
def _needs_stable(otherwise: str) -> Iterator[Callable[[FloatArray], None]]:
    """Gives a check of a closed loop's matrix; InputError with that line where it or the Riccati equation fails."""

    def check(closed: FloatArray) -> None:
        if not (np.linalg.eigvals(closed).real < 0).all():
            raise InputError(otherwise)

    try:
        yield check
    except InputError:
        raise
    except ValueError:  # LinAlgError is one
        raise InputError(otherwise) from None


def first_order_hold(
    a: FloatArray, b: FloatArray, period: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """phi (n, n), g0 and g1 (n, m) of s+ = phi s + g0 u + g1 u+ for s' = a s + b u.

    Exact for inputs u (m,) that are linear from one sample to the next. From the exponential
    of [[a h, b h, 0], [0, 0, 1], [0, 0, 0]].
    """
    n, m = b.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n] = a * period
    block[:n, n : n + m] = b * period
    block[n : n + m, n + m :] = np.eye(m)
    e = expm(block)
    held, ramp = e[:n, n : n + m], e[:n, n + m :]
    return np.asarray(e[:n, :n]), np.asarray(held - ramp), np.asarray(ramp)


class Estimator:
    """The filter above for s' = a s + b f + e w, y = c s + d f, of n states and p measurements.

    c (p, n), d (p,), measurements: p names; noise_ratio: intensity of w over that of every measurement's noise, in
    units of its deviation (p,), one by default; period: s. Attributes: gain (n, p), l above; estimate, s_hat (n,) of
    the last call. Raises InputError.
    """

    def __init__(
        self,
        linear: Plant,
        c: FloatArray,
        d: FloatArray,
        measurements: Sequence[str],
        noise_ratio: float,
        period: float,
        deviation: FloatArray | None = None,
    ) -> None:
        if not measurements:
            raise InputError("estimator: measurements is empty; name at least one")
        self.measurements = tuple(measurements)
        self.gain = kalman_gain(linear.a, linear.e, c, noise_ratio, deviation)
        drive = np.column_stack([self.gain, linear.b - self.gain @ d])  # inputs: y, then f
        forces = range(drive.shape[1] - len(self.measurements))
        self._inputs = (*self.measurements, *(sensor_name("force", k) for k in forces))
        self._phi, self._g0, self._g1 = first_order_hold(linear.a - self.gain @ c, drive, period)
        self.reset()

    @property
    def matrices(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(n, n), (n, p + m), (n, p + m) of s_hat+ = m0 s_hat + m1 y + m2 y+, y the measurements, then the m forces."""
        return self._phi, self._g0, self._g1

    def reset(self) -> None:
        """The structure is at rest."""
        self.estimate: FloatArray = np.zeros(len(self._phi))
        self._last: FloatArray | None = None

    def __call__(self, y: Mapping[str, float]) -> FloatArray:
        """s_hat (n,) with the measurements y of now, (n, rows) with those of many runs; `force` (N) is among them."""
        now = np.array([y[name] for name in self._inputs])
        if self._last is None:
            self.estimate = np.zeros((len(self._phi), *now.shape[1:]))
        else:
            self.estimate = self._phi @ self.estimate + self._g0 @ self._last + self._g1 @ now
        self._last = now
        return self.estimate
