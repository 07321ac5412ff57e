"""Fits that find their way in rough runs: they end where full runs alone would, however rough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from mrdamp.core import Array
from mrdamp.diagnosis.fit import Fit, fit, taken_up
from mrdamp.diagnosis.problem import Problem
from mrdamp.diagnosis.terms import Hypothesis, Settings, Term
from toy_rig import ToyRig, toy

TRUTH = {"gain": 2.3, "cubic": 0.4, "sign": 0.3}


@dataclass(frozen=True)
class Bent(ToyRig):
    """The toy as longer steps may see it: a factor, a part of the square, noise that has nothing to do with it."""

    factor: float = 1.0
    square: float = 0.0
    foreign: float = 0.0

    def simulate(self, settings: Sequence[Settings], record: int, *, coarse: bool = False) -> Array:
        out = super().simulate(settings, record)
        noise = np.random.default_rng(7).standard_normal(out.shape[-1])
        return np.asarray(self.factor * out + self.square * out**2 + self.foreign * noise)


@dataclass(frozen=True)
class Stepped(ToyRig):
    """A toy with rough runs."""

    rough: ToyRig | None = None

    def rougher(self, terms: Sequence[Term]) -> ToyRig | None:
        return self.rough


def fitted(factor: float | None = None, square: float = 0.0, foreign: float = 0.0) -> tuple[Fit, Problem]:
    plain = toy(TRUTH)
    rough = None if factor is None else Bent(plain.records, factor=factor, square=square, foreign=foreign)
    rig = Stepped(plain.records, rough=rough)
    hypothesis = Hypothesis(rig.nominal, tuple(t for t in rig.terms if t.effect in ("cubic", "sign")))
    problem = Problem(rig, coarse=True)
    return fit(problem, hypothesis, hypothesis.start(), most=20, tolerance=1e-4), problem


@pytest.mark.parametrize(
    ("factor", "square", "foreign"),
    [
        (1.05, 0.0, 0.0),
        (1.0, 0.05, 0.0),
        (1.0, 0.0, 0.2),  # what is off by a constant is taken off wholly
        (1.3, 0.2, 1.0),
        (-1.0, 0.0, 0.0),  # leads the wrong way
    ],
)
def test_rough_runs_end_where_full_ones_do(factor: float, square: float, foreign: float) -> None:
    want, _ = fitted()
    got, problem = fitted(factor, square, foreign)
    assert got.cost == pytest.approx(want.cost, rel=0.02)
    np.testing.assert_allclose(got.point, want.point, atol=0.15)
    # What is told of the fit is the full run's.
    np.testing.assert_array_equal(got.residual, problem.residuals(got.hypothesis, got.point)[0])
    assert got.cost == float(got.residual @ got.residual)


def test_good_rough_runs_spare_full_ones() -> None:
    want, full = fitted()
    got, spared = fitted(1.02)
    assert spared.runs < 0.2 * full.runs
    assert got.cost == pytest.approx(want.cost, rel=5e-3)


@pytest.mark.parametrize("factor", [1.05, -1.0])
def test_a_fit_in_rough_runs_is_taken_up_to_the_last_bit(factor: float) -> None:
    got, problem = fitted(factor)
    assert got.at is not None
    again = taken_up(problem, got.hypothesis, got.point, got.at, None, converged=got.converged)
    np.testing.assert_array_equal(again.jacobian, got.jacobian)
    np.testing.assert_array_equal(again.residual, got.residual)
