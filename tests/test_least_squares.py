"""Least squares that run no simulation twice take the steps that SciPy takes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from threadpoolctl import threadpool_info  # type: ignore[import-untyped]

from mrdamp.identify.least_squares import bounded_least_squares
from mrdamp.model.core import Array

TIME = np.linspace(0.0, 3.0, 400)
MEASURED = 0.8 * np.exp(-1.3 * TIME) * np.cos(7 * TIME) + 0.02 * np.sin(50 * TIME)


def residual(p: Array) -> Array:
    return np.asarray(p[0] * np.exp(-2 * p[1] * TIME) * np.cos(10 * p[2] * TIME) - MEASURED)


def jacobian(p: Array, r: Array) -> Array:
    wave, decay = np.cos(10 * p[2] * TIME), np.exp(-2 * p[1] * TIME)
    turned = -10 * TIME * p[0] * decay * np.sin(10 * p[2] * TIME)
    return np.column_stack([decay * wave, -2 * TIME * (r + MEASURED), turned])


@pytest.mark.parametrize("start", [(0.5, 0.4, 0.62), (0.95, 0.9, 0.75), (0.2, 0.05, 0.68)])
def test_steps_are_those_of_scipy(start: tuple[float, float, float]) -> None:
    whole = least_squares(residual, start, lambda p: jacobian(p, residual(p)), bounds=(0, 1), max_nfev=7)
    found = bounded_least_squares(
        residual, jacobian, np.array(start), bounds=(0, 1), most=7, ftol=1e-8, xtol=1e-8
    )
    assert found.x == pytest.approx(whole.x, abs=1e-12)
    assert (found.nfev, found.status) == (whole.nfev, whole.status)


def test_no_residual_is_computed_twice_and_blas_keeps_to_a_thread() -> None:
    seen: list[bytes] = []
    threads: set[int] = set()

    def counted(p: Array) -> Array:
        seen.append(p.tobytes())
        threads.update(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")
        return residual(p)

    found = bounded_least_squares(
        counted, jacobian, np.array([0.5, 0.4, 0.62]), bounds=(0, 1), most=20, ftol=1e-8, xtol=1e-8
    )
    assert found.success
    assert len(seen) == len(set(seen)) == found.nfev
    assert threads <= {1}
