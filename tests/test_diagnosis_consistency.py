"""Is a cause the same in every regime: its parameters from each regime's records alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mrdamp.diagnosis.answer import named_effects
from mrdamp.diagnosis.evidence.consistency import RegimeEstimate, by_regime, hull
from mrdamp.diagnosis.evidence.resample import spread
from mrdamp.diagnosis.fits.final import FinalFit
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Settings
from mrdamp.diagnosis.problem.residuals import Problem
from toy_rig import FIFTH, toy


def estimates(truth: Settings, named: str) -> tuple[Fit, Problem, tuple[RegimeEstimate, ...]]:
    """Estimates of `named` by regime, beside a free gain, on records that the truth has made."""
    rig = toy(truth)
    hypothesis = Hypothesis(rig.nominal, tuple(t for t in rig.terms if t.effect == named))
    problem = Problem(rig)
    found = fit(problem, hypothesis, hypothesis.start())
    return found, problem, by_regime(problem, found, named)


def test_a_real_cause_has_one_value_in_all_regimes() -> None:
    found, problem, rows = estimates({"gain": 2.4, "cubic": 0.5}, "cubic")
    assert {r.over for r in rows} == {"speed"}
    assert sorted(name for r in rows for name in r.records) == [r.name for r in problem.rig.records]
    for r in rows:
        low, high = r.intervals["cubic"]
        assert low - 0.01 < 0.5 < high + 0.01
        assert set(r.parameters) == {"cubic"}
        assert r.gap_with < 0.2 * r.gap_without
    together = [r.gap_with for r in rows for _ in r.records]
    assert np.sqrt(np.mean(np.square(together))) == pytest.approx(
        np.sqrt(np.mean(problem.gaps(found.residual) ** 2)), rel=0.05
    )


def test_a_wrong_cause_changes_with_the_regime() -> None:
    """A fifth power looks like a cubic whose factor grows with the amplitude."""
    _, _, rows = estimates({"fifth": 0.5}, "cubic")
    lowest, highest = (pick(rows, key=lambda r: r.parameters["cubic"]) for pick in (min, max))
    assert highest.parameters["cubic"] > 1.1 * lowest.parameters["cubic"]
    assert lowest.intervals["cubic"][1] < highest.intervals["cubic"][0]


def test_a_regime_that_does_not_determine_a_parameter_is_marked() -> None:
    """The first record stands still: a hysteresis has no sign there."""
    rig = toy({"sign": 0.3}, n=500)
    first = rig.records[0]
    still = replace(first, channels=dict(first.channels) | {"displacement_m": np.full(first.n, 0.5)})
    rig = replace(rig, records=(still, *rig.records[1:]))
    hypothesis = Hypothesis(rig.nominal, tuple(t for t in rig.terms if t.effect == "sign"))
    problem = Problem(rig)
    found = fit(problem, hypothesis, hypothesis.start())
    rows = by_regime(problem, found, "sign")
    assert [r.records for r in rows if not r.determined] == [(first.name,)]


def test_a_wrong_law_widens_the_interval_of_a_named_cause() -> None:
    """A fifth power as a cubic: each regime has another factor, and the reported interval contains them all."""
    rig = toy({"fifth": 0.5})
    (cubic,) = (t for t in rig.terms if t.effect == "cubic")
    problem = Problem(rig)
    found = fit(problem, Hypothesis((), (cubic,)), Hypothesis((), (cubic,)).start())
    for floor, widened in ((1e-6 * found.cost, True), (found.cost, False)):
        search = Search(problem, floor, Limits())
        search.keep(found)
        assert search.inexact == widened
        final = FinalFit(found, problem.gaps(found.residual), problem)
        plain = spread(problem, found).intervals()
        regimes = {"cubic": by_regime(problem, found, "cubic")}
        (named,) = named_effects(search, found, final, {"cubic": 0.9}, plain, regimes)
        low, high = named.intervals["cubic"]
        assert (low < plain["cubic"][0] or high > plain["cubic"][1]) == widened
        if widened:
            assert all(low <= r.parameters["cubic"] <= high for r in regimes["cubic"])


def test_a_single_record_and_a_cause_that_was_not_fitted_have_no_estimates() -> None:
    found, problem, _ = estimates({"offset": 0.3}, "offset")
    assert by_regime(problem, found, "cubic") == ()
    alone = Problem(problem.rig, [0])
    assert by_regime(alone, fit(alone, found.hypothesis, found.point, most=0), "offset") == ()


def test_a_cause_is_reported_in_the_form_of_the_last_fit() -> None:
    """The search names one form, the last fit converges in another one with other parameters."""
    rig = toy({"fifth": 0.5})
    problem = Problem(rig)
    search = Search(problem, sum((0.02 / b.size) ** 2 for b in problem.blocks), Limits())
    (cubic,) = (t for t in rig.terms if t.effect == "cubic")
    other = replace(cubic, form="other", coordinates=FIFTH.coordinates)
    first, last = (
        fit(problem, h, h.start()) for h in (Hypothesis(rig.nominal, (t,)) for t in (cubic, other))
    )
    search.keep(first)
    final = FinalFit(last, problem.gaps(last.residual), problem)
    regimes = {"cubic": by_regime(problem, last, "cubic")}
    (named,) = named_effects(search, first, final, {"cubic": 0.9}, {}, regimes)
    assert named.parameters == {"fifth": pytest.approx(0.5, abs=0.02)}
    assert named.by_regime
    assert all(set(r.parameters) == set(r.intervals) == {"fifth"} for r in named.by_regime)


def test_the_hull_contains_every_regime_that_determines_a_parameter() -> None:
    one = RegimeEstimate("speed", 0.1, 0.1, ("01",), {"a": 1.0}, {"a": (0.7, 1.1)}, True, 0.1, 0.05)
    two = replace(one, intervals={"a": (0.95, 1.6)})
    vague = replace(one, intervals={"a": (-9.0, 9.0)}, determined=False)
    assert hull({"a": (0.9, 1.2), "b": (0.0, 1.0)}, (one, two, vague)) == {"a": (0.7, 1.6), "b": (0.0, 1.0)}
    assert hull({"a": (0.9, 1.2)}, ()) == {"a": (0.9, 1.2)}


def test_a_regime_is_labelled_and_a_worse_one_is_known() -> None:
    one = RegimeEstimate("command", 0.5, 0.5, ("01",), {"a": 1.0}, {"a": (0.9, 1.1)}, True, 0.1, 0.2)
    assert one.worse
    assert one.label() == "command 0.5"
    assert not replace(one, determined=False).worse
    assert not replace(one, gap_with=0.05).worse
    assert replace(one, over="speed", high=0.75).label() == "speed 0.5 to 0.75 m/s"
    assert replace(one, low=None, high=None).label() == "01"
