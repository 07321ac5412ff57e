"""SciPy's bounded least squares for residuals that are a simulation each: none runs twice, and BLAS keeps to a thread.

The Jacobian (samples, coordinates) is slim. Several threads of BLAS gain nothing on it and wait for each other, which
doubles the CPU time of a fit, and takes far longer still where the cores are busy.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import optimize
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp.model.core import Array


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
) -> optimize.OptimizeResult:
    """`scipy.optimize.least_squares` of residual(p) (samples,), from a start (n,) inside the bounds.

    jacobian: of a point and its residual (samples, n). most: evaluations of the residual.
    """
    last: tuple[Array, Array] | None = None

    def kept(point: Array) -> Array:
        nonlocal last
        if last is None or not np.array_equal(point, last[0]):
            last = point.copy(), residual(point)
        return last[1]

    with threadpool_limits(limits=1):
        return optimize.least_squares(
            kept, start, lambda p: jacobian(p, kept(p)), bounds=bounds, ftol=ftol, xtol=xtol, gtol=gtol,
            max_nfev=most,
        )  # fmt: skip
