"""Further causes beside an established one, with a law that is not the rig's."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mrdamp.diagnosis.evidence import further
from mrdamp.diagnosis.evidence.further import with_further
from mrdamp.diagnosis.evidence.judgement import decided, likely, scored
from mrdamp.diagnosis.evidence.verdict import Decision
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.problem.residuals import Problem
from toy_rig import toy


def found(noise: float = 0.02, **truth: float) -> tuple[Search, list[Fit], Decision]:
    """A search in records of a toy with a part that the catalogue lacks; single causes alone are decided on."""
    search = Search(Problem(toy({"outside": 0.4, **truth}, records=6, noise=noise)), 1e-6)
    for free in (False, True):
        search.extend(free, 1)
    fits = [*search.ranked(False), *search.ranked(True)]
    return search, fits, decided(search, fits, {}, None)


def test_a_second_cause_is_found_beside_the_first() -> None:
    search, fits, decision = found(offset=0.5, sign=0.3)
    assert (decision.verdict, len(decision.chosen.causes)) == ("effect", 1)
    more, both = with_further(search, fits, decision)
    assert set(both.chosen.causes) == {"offset", "sign"}
    fit = more[both.chosen.index]
    assert fit.settings["offset"] == pytest.approx(0.5, rel=0.1)
    assert fit.settings["sign"] == pytest.approx(0.3, rel=0.1)
    assert more[: len(fits)] == fits
    # Probabilities: what the first cause had is shared between it alone and both.
    assert len(both.probabilities) == len(more)
    assert sum(both.probabilities) == pytest.approx(sum(decision.probabilities))
    first = set(decision.chosen.causes)
    before, after = (
        sum(p for p, f in zip(d.probabilities, some, strict=False) if first <= set(f.hypothesis.causes))
        for d, some in ((decision, fits), (both, more))
    )
    assert after == pytest.approx(before)


@pytest.mark.parametrize(("pair", "named"), [(0.4, {"offset"}), (0.6, {"offset", "sign"})])
def test_of_two_causes_that_are_named_each_is_more_probable_than_not(pair: float, named: set[str]) -> None:
    """pair: stated probability of both, the rest being the offset's alone."""
    search, fits, decision = found(offset=0.5, sign=0.3)
    more, both = with_further(search, fits, decision)
    alone = max(k for k, f in enumerate(more) if f.hypothesis.causes == ("offset",))
    share = np.zeros(len(more))
    share[[alone, both.chosen.index]] = 1 - pair, pair
    after = likely(search, replace(both, probabilities=tuple(share), unknown=0.0), more, {})
    assert set(after.chosen.causes) == named
    assert set(more[after.chosen.index].hypothesis.causes) == named


def test_nothing_is_added_where_there_is_no_second_cause() -> None:
    search, fits, decision = found(offset=0.5)
    assert decision.chosen.causes == ("offset",)
    assert with_further(search, fits, decision) == (fits, decision)


def test_a_second_cause_that_takes_little_is_not_added() -> None:
    """In the noise of .2 a friction of .09 is a sixth of the squares: fitted, and not worth another cause."""
    search, fits, decision = found(noise=0.2, offset=0.8, sign=0.09)
    assert decision.chosen.causes == ("offset",)
    assert ("offset", "sign") in [f.hypothesis.causes for f in search.beside(fits[decision.chosen.index])]
    assert with_further(search, fits, decision) == (fits, decision)


def test_unknown_causes_and_exact_laws_are_left_as_they_are() -> None:
    search, fits, decision = found(offset=0.5, sign=0.3)
    unknown = replace(decision, verdict="unknown")
    assert with_further(search, fits, unknown) == (fits, unknown)
    search.floor = np.inf
    assert not search.inexact
    assert with_further(search, fits, decision) == (fits, decision)


@pytest.mark.parametrize("own", [0.0, 1e-3])
def test_a_cause_is_handed_over_with_the_parameters_that_it_had_bent(own: float) -> None:
    """The nominal gain is 2, the rig's 2.6: the search fitted the cubic term with the nominal gain alone. A baseline
    (own) determines the gain."""
    search = Search(
        Problem(toy({"gain": 2.6, "cubic": 0.8, "outside": 0.1}, records=6, noise=0.02)), 1e-6, own=own
    )
    search.extend(False, 1)
    fits = search.ranked(False)
    index = next(k for k, f in enumerate(fits) if f.hypothesis.causes == ("cubic",))
    held = replace(scored([fits[index]])[0], index=index)
    decision = Decision("effect", held, tuple(1 / len(fits) for _ in fits), 0.1, 1e-6, search.excess)
    more, after = with_further(search, fits, decision)
    found = more[after.chosen.index]
    assert found.hypothesis.causes == ("cubic",)
    assert bool(found.hypothesis.nominal) is (own == 0.0)
    if not own:
        assert found.settings["gain"] == pytest.approx(2.6, rel=0.02)
        assert after.unexplained < decision.unexplained
        assert len(after.probabilities) == len(more)


@pytest.mark.parametrize(
    ("second", "rival", "freed", "known", "named"),
    [
        (0.60, 0.70, 1.0, 0.0, ("a", "b")),
        (0.60, 0.63, 1.0, 0.0, ("a",)),
        (0.60, 0.70, 0.5, 0.0, ("a",)),
        (0.95, 1.0, 1.0, 0.0, ("a",)),
        (0.60, 1.0, 1.0, 0.0, ("a", "b")),
        (0.60, 1.0, 1.0, 28.0, ("a",)),
    ],
)
def test_a_second_cause_beats_its_rivals_by_a_tenth_and_free_parameters_too(
    second: float,
    rival: float,
    freed: float,
    known: float,
    named: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Shares of the left-out squares beside the cause a, by hand. known: nats against b because the law lacks it."""

    def fit_of(*causes: str, nominal: tuple[str, ...] = ()) -> Any:
        hypothesis = SimpleNamespace(causes=causes, nominal=nominal)
        return SimpleNamespace(hypothesis=hypothesis, point=np.zeros(len(causes)), cost=1.0)

    parent, free = fit_of("a"), fit_of("a", nominal=("c0",))
    left = {("a", "b"): second, ("a", "c"): rival}
    search = SimpleNamespace(
        beside=lambda _: [fit_of("a", "b"), fit_of("a", "c")],
        problem=SimpleNamespace(rig=None),
        best_version=lambda _: None,
        versions=lambda f: [(freed if f is free else left[f.hypothesis.causes], False)],
        ratio=lambda share, _: share,
        smallest=lambda is_free, _: free,
        direct={},
        own=0.0,
        inexact=True,
    )
    monkeypatch.setattr(further, "of_itself", lambda _: 0.0)
    monkeypatch.setattr(further, "of_law", lambda _, causes: known * (causes == ("b",)))
    found = further._further(search, parent)  # type: ignore[arg-type]
    assert (("a",) if found is None else found[0].hypothesis.causes) == named
