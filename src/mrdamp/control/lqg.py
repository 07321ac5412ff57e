"""Linear-quadratic-Gaussian gains in continuous time, and a filter's step in discrete time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from scipy.linalg import expm, solve_continuous_are

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
