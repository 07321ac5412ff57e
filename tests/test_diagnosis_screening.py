"""What terms promise beside a cause, foretold from what they change in the nominal simulator."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from mrdamp.diagnosis.fits import screening
from mrdamp.diagnosis.fits import search as searching
from mrdamp.diagnosis.fits.beam import ScoreTest
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Settings
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array
from toy_rig import ToyRig, toy

TRUTH = {"sign": 0.6, "cubic": 0.3}


def made() -> Search:
    problem = Problem(toy(TRUTH, 0.005))
    return Search(problem, sum((0.005 / b.size) ** 2 for b in problem.blocks))


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many settings each run of a record was asked for."""
    counts: list[int] = []
    real = ToyRig.simulate

    def counted(rig: ToyRig, settings: Sequence[Settings], record: int, *, coarse: bool = False) -> Array:
        counts.append(len(settings))
        return real(rig, settings, record, coarse=coarse)

    monkeypatch.setattr(ToyRig, "simulate", counted)
    return counts


def held_with(search: Search, cause: str) -> Fit:
    (term,) = (t for t in search.problem.rig.terms if t.effect == cause)
    hypothesis = search.fits[False, frozenset()].hypothesis.plus(term)
    return search.fitted(hypothesis, np.array([1.0]), most=8)


def test_what_is_foretold_is_what_runs_of_their_own_say(
    monkeypatch: pytest.MonkeyPatch, simulated: list[int]
) -> None:
    """In a sum of parts a change is the same on top of anything: exactly, and without a run."""
    whole, told = made(), made()
    for search in (whole, told):
        screening.screen(search, search.fits[False, frozenset()], search.problem.rig.terms)
    others = whole.addable(("sign",))
    want = screening.screen(whole, held_with(whole, "sign"), others)
    monkeypatch.setattr(screening, "_LOOKED_AT", 1)
    second = held_with(told, "sign")
    simulated.clear()
    got = screening.screen(told, second, others)
    assert sum(simulated) == 2 * len(told.problem.records)  # the fit's own and one term's
    assert [p.term.name for p in got] == [p.term.name for p in want]
    assert np.allclose([p.cost for p in got], [p.cost for p in want], rtol=1e-9)
    assert got[0].term.effect == "cubic"


def test_a_term_that_was_not_seen_alone_gets_a_run_of_its_own(
    monkeypatch: pytest.MonkeyPatch, simulated: list[int]
) -> None:
    monkeypatch.setattr(screening, "_LOOKED_AT", 0)
    search = made()
    terms = search.addable(("sign",))
    screening.screen(search, search.fits[False, frozenset()], terms[:1])
    second = held_with(search, "sign")
    simulated.clear()
    assert len(screening.screen(search, second, terms)) == len(terms)
    assert sum(simulated) == len(terms) * len(search.problem.records)  # the fit's own and all but one


def test_what_is_hopeless_beside_a_lesser_cause_is_not_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """And what is found is the same."""

    def all_of_them(ranked: list[ScoreTest], cost: float, *, second: bool = False) -> list[ScoreTest]:
        return ranked

    monkeypatch.setattr(searching, "worth_a_look", all_of_them)
    monkeypatch.setattr(searching, "parents", lambda ranked, *_: ranked[:2])
    found = []
    for beyond_reach in (searching._HOPELESS, np.inf):
        monkeypatch.setattr(searching, "_HOPELESS", beyond_reach)
        search = made()
        search.extend(False, 1)
        search.extend(False, 2)
        found.append(search)
    fewer, more = found
    assert set(fewer.fits) < set(more.fits)
    best = fewer.best(False)
    assert best is not None
    assert set(best.hypothesis.causes) == {"sign", "cubic"}
    assert best.cost == more.ranked(False)[0].cost


def test_nothing_is_foretold_where_numbers_moved_far(
    monkeypatch: pytest.MonkeyPatch, simulated: list[int]
) -> None:
    monkeypatch.setattr(screening, "_LOOKED_AT", 0)
    search = made()
    terms = list(search.problem.rig.terms)
    screening.screen(search, search.fits[False, frozenset()], terms)
    asked = []
    for by in (0.3, 0.5):
        moved = search.fitted(search.base.hypothesis, np.array([by / 0.1]), most=0, stage=f" {by}")
        assert moved.move == pytest.approx(by)
        simulated.clear()
        screening.screen(search, moved, terms)
        asked.append(sum(simulated))
    assert asked == [0, (len(terms) + 1) * len(search.problem.records)]  # the fit's own and every term's
