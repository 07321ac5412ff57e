"""Other forms of a cause that was found: which are tried, and how far."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import pytest

from mrdamp.diagnosis.fits import alternative_forms as forms
from mrdamp.diagnosis.fits import screening
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Hypothesis, Term
from mrdamp.diagnosis.problem.residuals import Problem
from toy_rig import ToyRig, toy


@dataclass(frozen=True)
class Formed(ToyRig):
    """The toy with a cubic that may be of the fifth power."""

    @property
    def terms(self) -> tuple[Term, ...]:
        fifth = Coordinate("fifth", 0.0, -50.0, 50.0, 0.1)
        return (*super().terms, Term("cubic", "fluid", (fifth,), ((0.2,),), form="fifth"))


@pytest.fixture
def search() -> Search:
    rig = Formed(toy({"cubic": 0.4}).records)
    problem = Problem(rig)
    return Search(problem, sum((0.02 / b.size) ** 2 for b in problem.blocks), Limits())


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, float]]:
    """Names and bars of the fits that are asked for."""
    calls: list[tuple[str, float]] = []
    real = Search.fitted

    def fitted(self: Search, hypothesis: Hypothesis, start: Any, **how: Any) -> Fit:
        calls.append((hypothesis.name, how.get("bar", float("inf"))))
        return real(self, hypothesis, start, **how)

    monkeypatch.setattr(Search, "fitted", fitted)
    return calls


def alone(search: Search, name: str) -> Fit:
    """A held fit of one term, from where a screening has it start."""
    term = next(t for t in search.problem.rig.terms if t.name == name)
    base = Hypothesis((), ())
    none = Fit(base, base.start(), *search_start(search, base))
    promise = screening.screen(search, none, [term])[0]
    return search.fitted(*search.start_from(none, promise.term, promise.start, promise.by), most=12)


def search_start(search: Search, hypothesis: Hypothesis) -> tuple[float, Any, Any]:
    residual = search.problem.residuals(hypothesis, hypothesis.start())[0]
    return float(residual @ residual), residual, residual[:, None][:, :0]


def test_another_form_is_tried_and_given_up_where_it_leaves_twice_as_much(
    search: Search, asked: list[tuple[str, float]]
) -> None:
    found = alone(search, "cubic")
    asked.clear()
    forms.reform(search, found)
    assert asked == [("cubic:fifth", 2 * found.cost)]
    again = search.smallest(False, ["cubic"])
    assert again is not None
    assert again.hypothesis.name == "cubic:fifth"
    assert again.cost > found.cost


def test_a_form_is_not_tried_again_from_where_it_set_out_before(
    search: Search, asked: list[tuple[str, float]]
) -> None:
    alone(search, "cubic:fifth")
    key = next(k for k in search.cache.fits if k[0] == "held cubic:fifth")
    found = alone(search, "cubic")
    for iterations, tried in ((7, ["cubic:fifth"]), (8, [])):
        search.cache.fits[key] = replace(search.cache.fits[key], iterations=iterations)
        asked.clear()
        forms.reform(search, found)
        assert [name for name, _ in asked] == tried
