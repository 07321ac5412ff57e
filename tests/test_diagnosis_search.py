"""A search of causes on the toy: which are tried, what they promise, other forms of them, the last fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from mrdamp.diagnosis.attribution.stages import Changes, stage_shares
from mrdamp.diagnosis.fits import alternative_forms, screening
from mrdamp.diagnosis.fits.beam import parents
from mrdamp.diagnosis.fits.final import final_fit, least_left_out
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.fits.table import FitTable
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Hypothesis, Settings, Term
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array
from toy_rig import ToyRig, search_of, toy

NOISE = 0.005


def fitted(search: Search, name: str, *, free: bool = False, most: int = 12) -> Fit:
    """A fit of one term from a small start, kept in the table."""
    rig = search.problem.rig
    hypothesis = Hypothesis(rig.nominal if free else (), tuple(t for t in rig.terms if t.name == name))
    search.keep(fit(search.problem, hypothesis, hypothesis.start(), most=most))
    return search.fits[hypothesis.key]


@pytest.mark.parametrize(("established", "parent"), [("late", "late"), ("cubic", "cubic")])
def test_a_cause_that_channels_establish_is_extended_first_beside_a_wrong_law(
    established: str, parent: str
) -> None:
    search = Search(Problem(toy({"cubic": 0.6, "late": 6.0, "outside": 0.3})), 1e-6)
    search.direct = {established: 100.0}
    search.extend(False, 1)
    assert search.inexact
    search.extend(False, 2, Limits(beam=1, additions=1))
    (pair,) = (f.hypothesis.causes for f in search.ranked(False) if len(f.hypothesis.causes) == 2)
    assert pair[0] == parent


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many settings each run of a record was asked for."""
    counts, simulate = list[int](), ToyRig.simulate

    def counted(rig: ToyRig, settings: Sequence[Settings], record: int, *, coarse: bool = False) -> Array:
        counts.append(len(settings))
        return simulate(rig, settings, record, coarse=coarse)

    monkeypatch.setattr(ToyRig, "simulate", counted)
    return counts


def screened() -> Search:
    search = search_of(toy({"sign": 0.6, "cubic": 0.3}, NOISE), NOISE)
    screening.screen(search, search.fits[False, frozenset()], search.problem.rig.terms)
    return search


def test_what_is_foretold_is_what_runs_of_their_own_say(
    monkeypatch: pytest.MonkeyPatch, simulated: list[int]
) -> None:
    """In a sum of parts a change is the same on top of anything: exactly, and without a run."""
    whole, told = screened(), screened()
    sign = next(t for t in whole.problem.rig.terms if t.effect == "sign")
    none = whole.fits[False, frozenset()].hypothesis
    first, second = (s.fitted(none.plus(sign), np.array([1.0]), most=8) for s in (whole, told))
    others = whole.addable(("sign",))
    want = screening.screen(whole, first, others)
    monkeypatch.setattr(screening, "_LOOKED_AT", 1)
    simulated.clear()
    got = screening.screen(told, second, others)
    assert sum(simulated) == 2 * len(told.problem.records)  # the fit's own and one term's
    assert [p.term.name for p in got] == [p.term.name for p in want]
    assert np.allclose([p.cost for p in got], [p.cost for p in want], rtol=1e-9)
    assert got[0].term.effect == "cubic"


@pytest.mark.parametrize(("by", "foretold"), [(0.3, True), (0.5, False)])
def test_nothing_is_foretold_where_numbers_moved_far(
    by: float, foretold: bool, monkeypatch: pytest.MonkeyPatch, simulated: list[int]
) -> None:
    monkeypatch.setattr(screening, "_LOOKED_AT", 0)
    search = screened()
    moved = search.fitted(search.base.hypothesis, np.array([by / 0.1]), most=0, stage=f" {by}")
    simulated.clear()
    screening.screen(search, moved, search.problem.rig.terms)
    every = (len(search.problem.rig.terms) + 1) * len(
        search.problem.records
    )  # the fit's own and every term's
    assert sum(simulated) == (0 if foretold else every)


@dataclass(frozen=True)
class Formed(ToyRig):
    """The toy with a cubic that may be of the fifth power."""

    @property
    def terms(self) -> tuple[Term, ...]:
        fifth = Coordinate("fifth", 0.0, -50.0, 50.0, 0.1)
        return (*super().terms, Term("cubic", "fluid", (fifth,), ((0.2,),), form="fifth"))


@pytest.mark.parametrize(("truth", "name"), [({"cubic": 0.4}, "cubic"), ({"fifth": 0.4}, "cubic:fifth")])
def test_the_better_form_of_a_cause_stands(truth: Settings, name: str) -> None:
    search = search_of(Formed(toy(truth, NOISE).records), NOISE)
    screening.screen(search, search.base, search.problem.rig.terms)
    alternative_forms.reform(search, fitted(search, "cubic"))
    best = search.best(False)
    assert best is not None
    assert best.hypothesis.name == name
    assert "cubic:fifth" in {f.hypothesis.name for f in search.fits.values()}


def test_a_fit_that_was_broken_off_is_continued() -> None:
    search = search_of(toy({"sign": 0.6}, NOISE), NOISE)
    begun = fitted(search, "sign", most=0)
    object.__setattr__(begun, "converged", False)
    assert begun.settings["sign"] != pytest.approx(0.6, abs=0.05)
    final = final_fit(search, begun)
    assert final.fit.settings["sign"] == pytest.approx(0.6, abs=0.01)
    assert np.all(final.heldout < 0.1 * search.problem.gaps(search.residual))


@pytest.mark.parametrize(("gain", "free"), [(2.0, False), (2.4, True)])
def test_parameters_are_freed_where_left_out_records_need_it(gain: float, free: bool) -> None:
    search = search_of(toy({"sign": 0.6, "gain": gain}, NOISE), NOISE)
    held = fitted(search, "sign")
    fitted(search, "sign", free=True)
    assert bool(least_left_out(search, held).hypothesis.nominal) == free


def test_a_free_law_gets_what_it_changed_and_not_what_it_could_take() -> None:
    """Alone the gain takes up nearly all of a cubic part; beside the cause it moves little, and that is its share."""
    rig = toy({"cubic": 0.5, "gain": 2.02}, NOISE)
    search = search_of(rig, NOISE)
    problem = search.problem
    chosen = fitted(search, "cubic", free=True)
    assert search.base.cost < 0.3 * search.nominal_cost  # alone, the law does most of it
    shares, _ = stage_shares(search, chosen, "effect")
    assert shares["fluid"] == pytest.approx(1.0)  # the toy's cubic part and the law are of one stage
    x = np.concatenate([np.asarray(rig.records[k].displacement)[problem.taken(k)] for k in problem.records])
    cubic, gain = 0.5 * x**3 * problem.weights, 0.02 * x * problem.weights
    expected = np.array([cubic @ (cubic + gain), gain @ (cubic + gain)])
    found = Changes.of(search, chosen).table.sum(axis=0)
    assert found / found.sum() == pytest.approx(expected / expected.sum(), abs=0.02)
    assert found[0] > 10 * found[1]


def fit_of(cost: float, *causes: str) -> Fit:
    return cast(Fit, SimpleNamespace(cost=cost, hypothesis=SimpleNamespace(causes=causes)))


@pytest.mark.parametrize(
    ("fits", "chosen"),
    [
        ([(0.1, "a"), (0.3, "b"), (0.5, "c")], [0, 1]),  # what leaves five times as much
        ([(0.1, "a"), (0.11, "b"), (0.12, "c"), (0.13, "d")], [0, 1, 2]),
        ([(0.0101, "a"), (0.0125, "b"), (0.014, "c")], [0, 1]),  # within the noise floor's penalty
        ([(0.0101, "a"), (0.0101, "b"), (0.0101, "c")], [0, 1, 2]),
        ([], []),
    ],
)
def test_causes_are_added_to_fits_that_come_near_the_best(fits: list[Any], chosen: list[int]) -> None:
    ranked = [fit_of(*f) for f in fits]
    found = parents(ranked, 3, 0.01, 1e-4)
    assert [ranked.index(f) for f in found] == chosen


def test_each_set_of_causes_is_there_in_its_best_form_alone() -> None:
    ranked = [fit_of(*f) for f in ((0.1, "a"), (0.11, "a"), (0.12, "a", "b"), (0.2, "b"), (0.3, "b"))]
    table = cast(FitTable, SimpleNamespace(ranked=lambda free: ranked))
    assert [f.cost for f in FitTable.sets(table, True, 1)] == [0.1, 0.2]
    assert [f.cost for f in FitTable.sets(table, True, 1, lambda f: -f.cost)] == [0.3, 0.11]
