"""Nonlinear least squares folded to as many rows as a step can tell apart, for problems of many samples.

SciPy's trust-region method decomposes the Jacobian (samples, coordinates) in every step, which takes as long as the
simulations behind it. A step sees of it, and of the residual r, only J'J, J'r and r'r: an orthogonal transformation
that takes r to (|r|, 0, ...) keeps all three, in one row more than there are coordinates. So the steps are the same.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp.core import Array


def fold(residual: Array, jacobian: Array) -> Array:
    """Jacobian (n + 1, n) that goes with the residual (|r|, 0, ..., 0), of r (samples,) and J (samples, n)."""
    norm = float(np.linalg.norm(residual))
    along = residual / norm if norm > 0 else np.zeros_like(residual)
    row = along @ jacobian
    rest = np.linalg.qr(jacobian - np.outer(along, row), mode="r")
    out = np.zeros((jacobian.shape[1] + 1, jacobian.shape[1]))
    out[0] = row
    out[1 : 1 + len(rest)] = rest
    return out


def bounded_least_squares(
    residual: Callable[[Array], Array],
    jacobian: Callable[[Array, Array], Array],
    start: Array,
    *,
    bounds: tuple[float, float],
    most: int,
    ftol: float,
    xtol: float,
    gtol: float = 1e-8,
) -> OptimizeResult:
    """`scipy.optimize.least_squares` of residual(p) (samples,), from a start (n,) inside the bounds.

    jacobian: of a point and its residual (samples, n). most: evaluations of the residual. The result's `fun` and
    `jac` are the folded ones.
    """
    kept: dict[bytes, Array] = {}

    def length(point: Array) -> Array:
        kept.clear()
        kept[point.tobytes()] = residual(point)
        out = np.zeros(len(point) + 1)
        out[0] = np.linalg.norm(kept[point.tobytes()])
        return out

    def slope(point: Array) -> Array:
        known = kept.get(point.tobytes())
        at = residual(point) if known is None else known
        return fold(at, jacobian(point, at))

    # The matrices are too slim for more threads of BLAS, which wait for each other where the cores are busy.
    with threadpool_limits(limits=1):
        return least_squares(
            length, start, slope, bounds=bounds, ftol=ftol, xtol=xtol, gtol=gtol, max_nfev=most
        )
