"""Folded least squares take the steps that SciPy takes with every sample."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from mrdamp.core import Array
from mrdamp.folding import bounded_least_squares, fold

TIME = np.linspace(0.0, 3.0, 400)
MEASURED = 0.8 * np.exp(-1.3 * TIME) * np.cos(7 * TIME) + 0.02 * np.sin(50 * TIME)


def residual(p: Array) -> Array:
    return np.asarray(p[0] * np.exp(-2 * p[1] * TIME) * np.cos(10 * p[2] * TIME) - MEASURED)


def jacobian(p: Array, r: Array) -> Array:
    wave, decay = np.cos(10 * p[2] * TIME), np.exp(-2 * p[1] * TIME)
    turned = -10 * TIME * p[0] * decay * np.sin(10 * p[2] * TIME)
    return np.column_stack([decay * wave, -2 * TIME * (r + MEASURED), turned])


@pytest.mark.parametrize("scale", [0.0, 1.0, 1e6])
def test_what_a_step_sees_is_kept(scale: float) -> None:
    rng = np.random.default_rng(3)
    r, j = scale * rng.normal(size=50), rng.normal(size=(50, 4)) * [1e-3, 1, 1, 1e3]
    folded = fold(r, j)
    assert folded.shape == (5, 4)
    size = np.linalg.norm(j, axis=0)
    assert folded.T @ folded / np.outer(size, size) == pytest.approx(
        j.T @ j / np.outer(size, size), abs=1e-13
    )
    along = np.linalg.norm(r) * folded[0]
    assert along / size == pytest.approx(j.T @ r / size, abs=1e-12 * (1 + scale))


@pytest.mark.parametrize("start", [(0.5, 0.4, 0.62), (0.95, 0.9, 0.75), (0.2, 0.05, 0.68)])
def test_steps_are_those_of_all_samples(start: tuple[float, float, float]) -> None:
    whole = least_squares(residual, start, lambda p: jacobian(p, residual(p)), bounds=(0, 1), max_nfev=7)
    folded = bounded_least_squares(
        residual, jacobian, np.array(start), bounds=(0, 1), most=7, ftol=1e-8, xtol=1e-8
    )
    assert folded.x == pytest.approx(whole.x, abs=1e-9)
    assert folded.cost == pytest.approx(whole.cost, rel=1e-9)
    assert (folded.nfev, folded.status) == (whole.nfev, whole.status)


def test_residual_is_not_computed_again_for_its_jacobian() -> None:
    seen: list[bytes] = []

    def counted(p: Array) -> Array:
        seen.append(p.tobytes())
        return residual(p)

    found = bounded_least_squares(
        counted, jacobian, np.array([0.5, 0.4, 0.62]), bounds=(0, 1), most=20, ftol=1e-8, xtol=1e-8
    )
    assert found.success
    assert len(seen) == len(set(seen)) == found.nfev
