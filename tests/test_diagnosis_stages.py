"""Where the gap is put: what causes change against what a free law could take."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.diagnosis.attribution.stages import Changes, stage_shares
from mrdamp.diagnosis.fits import screening
from mrdamp.diagnosis.fits.least_squares import fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array
from toy_rig import toy


def test_a_free_law_gets_what_it_changed_and_not_what_it_could_take() -> None:
    """Alone the gain takes up nearly all of a cubic part; beside the cause it moves little, and that is its share."""
    rig = toy({"cubic": 0.5, "gain": 2.02}, 0.005)
    problem = Problem(rig)
    search = Search(problem, sum((0.005 / b.size) ** 2 for b in problem.blocks))
    hypothesis = Hypothesis(rig.nominal, tuple(t for t in rig.terms if t.effect == "cubic"))
    chosen = fit(problem, hypothesis, hypothesis.start(), tolerance=1e-8)
    assert search.base.cost < 0.3 * search.nominal_cost  # alone, the law does most of it
    shares, _ = stage_shares(search, chosen, "effect")
    cubic, gain = 0.5 * X3, 0.02 * X1
    whole = cubic + gain
    assert shares["fluid"] == pytest.approx(1.0)  # the toy's cubic part and the law are of one stage
    found = Changes.of(search, chosen).table.sum(axis=0)
    expected = np.array([cubic @ whole, gain @ whole])
    assert found / found.sum() == pytest.approx(expected / expected.sum(), abs=0.02)
    assert found[0] > 10 * found[1]


def _toy_parts() -> tuple[Array, Array]:
    """The toy's displacements, cubed and as they are, weighted as its residuals."""
    rig = toy({"cubic": 0.5, "gain": 2.02}, 0.005)
    problem = Problem(rig)
    x = np.concatenate([np.asarray(rig.records[k].displacement)[problem.taken(k)] for k in problem.records])
    return x**3 * problem.weights, x * problem.weights


X3, X1 = _toy_parts()


def test_nothing_is_fitted_or_screened_twice() -> None:
    problem = Problem(toy({"sign": 0.6}, 0.005))
    search = Search(problem, sum((0.005 / b.size) ** 2 for b in problem.blocks))
    (sign,) = (t for t in problem.rig.terms if t.effect == "sign")
    hypothesis = Hypothesis((), (sign,))
    first = search.fitted(hypothesis, hypothesis.start(), most=5)
    promised = screening.screen(search, first, search.addable(("sign",)))
    runs = problem.runs
    assert search.fitted(hypothesis, hypothesis.start(), most=5) is first
    assert screening.screen(search, first, search.addable(("sign",))) is promised
    assert problem.runs == runs
    free = search.fitted(Hypothesis(problem.rig.nominal, (sign,)), np.zeros(2), most=5)
    assert set(map(id, search.cache.with_fixed_law().fits.values())) == {id(first)}
    assert id(free) in set(map(id, search.cache.fits.values()))
    assert list(search.cache.with_fixed_law().screens) == list(search.cache.screens)
