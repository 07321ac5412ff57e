"""A small cause beside a large one, on a toy whose truth is known."""

from __future__ import annotations

import pytest

from mrdamp.diagnosis.fits.alternative_forms import others, try_second_cause
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.problem.residuals import Problem
from toy_rig import toy

NOISE = 0.01


def large(truth: dict[str, float]) -> tuple[Search, Fit]:
    """A search that tried single causes alone, and the best of them."""
    problem = Problem(toy(truth, NOISE))
    search = Search(problem, sum((NOISE / b.size) ** 2 for b in problem.blocks))
    search.extend(False, 1)
    found = search.best(False, 1)
    assert found is not None
    return search, found


def test_a_small_cause_is_found_beside_the_large_one() -> None:
    search, found = large({"cubic": 1.0, "sign": 0.06})
    assert found.hypothesis.causes == ("cubic",)
    assert 1e-3 < search.unexplained(found) < 0.02
    try_second_cause(search, found)
    pair = search.best(False)
    assert pair is not None
    assert set(pair.hypothesis.causes) == {"cubic", "sign"}
    assert pair.settings["sign"] == pytest.approx(0.06, abs=0.002)
    assert search.unexplained(pair) < 1e-4


def test_nothing_is_fitted_beside_a_cause_that_leaves_noise() -> None:
    search, found = large({"cubic": 1.0})
    before = set(search.fits)
    try_second_cause(search, found)
    assert set(search.fits) == before


def test_score_tests_of_the_others_are_computed_once_for_a_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    search, found = large({"cubic": 1.0, "sign": 0.06})
    first = others(search, found)
    assert first[0].term.cause == "sign"
    assert "cubic" not in [p.term.cause for p in first]
    monkeypatch.setattr(search.problem, "outputs", lambda settings: pytest.fail("simulated again"))
    assert others(search, found) is first
    with pytest.raises(pytest.fail.Exception, match="simulated again"):
        others(search, search.base)
