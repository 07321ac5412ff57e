"""The fit of the chosen causes that is handed over, on a toy whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.diagnosis.fits.final import final_fit, least_left_out
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.residuals import Problem
from toy_rig import toy

NOISE = 0.005


def search(truth: dict[str, float]) -> Search:
    problem = Problem(toy(truth, NOISE))
    return Search(problem, sum((NOISE / b.size) ** 2 for b in problem.blocks))


def sign(made: Search, *, free: bool, most: int = 12) -> Fit:
    """A fit of the sign, kept in the table."""
    rig = made.problem.rig
    hypothesis = Hypothesis(rig.nominal if free else (), tuple(t for t in rig.terms if t.effect == "sign"))
    made.keep(fit(made.problem, hypothesis, hypothesis.start(), most=most))
    return made.fits[hypothesis.key]


def test_a_fit_that_was_broken_off_is_continued() -> None:
    made = search({"sign": 0.6})
    begun = sign(made, free=False, most=0)
    object.__setattr__(begun, "converged", False)
    assert begun.settings["sign"] != pytest.approx(0.6, abs=0.05)
    final = final_fit(made, begun)
    assert final.fit.settings["sign"] == pytest.approx(0.6, abs=0.01)
    assert np.all(final.heldout < 0.1 * made.problem.gaps(made.residual))


@pytest.mark.parametrize(("gain", "free"), [(2.0, False), (2.4, True)])
def test_parameters_are_freed_where_left_out_records_need_it(gain: float, free: bool) -> None:
    made = search({"sign": 0.6, "gain": gain})
    held = sign(made, free=False)
    sign(made, free=True)
    assert bool(least_left_out(made, held).hypothesis.nominal) == free
