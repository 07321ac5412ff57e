"""Linear-quadratic-Gaussian gains in continuous time, and the Kalman filter, stepped once per control period.

    s_hat' = a s_hat + b f + l (y - c s_hat - d f)

The measured damper force f is a known input. The continuous filter is stepped exactly for measurements that are
linear between the samples (first-order hold).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np
from scipy.linalg import expm, solve_continuous_are

from mrdamp.control.base import sensor_name
from mrdamp.control.plant import Plant
from mrdamp.errors import InputError
from mrdamp.structures import FloatArray


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
