"""What is handed over: never a correction that is worse than the nominal simulator on left-out records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from mrdamp.diagnosis.constants import MATERIAL, UNSTEADY
from mrdamp.diagnosis.evidence import judgement
from mrdamp.diagnosis.evidence.consistency import RegimeEstimate
from mrdamp.diagnosis.evidence.judgement import decided, likely, never_worse
from mrdamp.diagnosis.evidence.verdict import Decision
from mrdamp.diagnosis.fits.final import FinalFit
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model import Model
from toy_rig import ToyRig, toy


@pytest.fixture(scope="module")
def answered() -> tuple[Search, list[Fit], Decision]:
    search = Search(Problem(toy({"cubic": 0.5}, 0.02)), 1e-9)
    search.extend(False, 1)
    fits = [*search.ranked(False), *search.ranked(True)]
    return search, fits, decided(search, fits, {}, None)


@pytest.mark.parametrize("by_file", [None, 0.99, 1.01], ids=lambda x: f"file {x}")
@pytest.mark.parametrize(
    ("verdict", "share", "seen", "kept"),
    [
        ("effect", 0.99 * np.sqrt(1 - MATERIAL), False, True),
        ("effect", 1.01 * np.sqrt(1 - MATERIAL), False, False),
        ("effect", 0.99, True, True),
        ("effect", 1.01, True, False),
        ("unknown", 0.99 * np.sqrt(1 - MATERIAL), False, True),
        ("unknown", 1.01 * np.sqrt(1 - MATERIAL), False, False),
        ("parameters", 0.99, False, True),
        ("parameters", 1.01, False, False),
        ("none", 2.0, False, True),
    ],
)
def test_a_correction_has_to_hold_on_left_out_records(
    answered: tuple[Search, list[Fit], Decision],
    verdict: str,
    share: float,
    seen: bool,
    kept: bool,
    by_file: float | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """share: gap of the corrected simulator over the nominal one, on left-out records and folds. by_file: the same by
    their files, over the largest that is allowed; None: as `share`. seen: channels show the cause without a law."""
    search, fits, decision = answered
    assert search.inexact
    problem = search.problem
    best = next(f for f in fits if f.hypothesis.causes)
    nominal = problem.gaps(problem.of_settings([{}])[0])
    final = FinalFit(best, share * nominal, problem)
    monkeypatch.setattr(Search, "predicted", lambda self, found: share * self.residual)
    monkeypatch.setattr(search, "direct", {"cubic": 5.0} if seen else {})
    most = 1.0 if seen else float(np.sqrt(1 - MATERIAL))
    gaps = iter([share if by_file is None else by_file * most, 1.0])
    monkeypatch.setattr(judgement, "predicted_gap", lambda model, problem: next(gaps))
    if by_file is not None and verdict in ("effect", "unknown"):
        kept = kept and by_file < 1
    before = replace(decision, verdict=verdict, unknown=0.6)
    handed, after = never_worse(search, fits, final, before)
    assert (handed is final) is kept
    if kept:
        assert after is before
        return
    assert not handed.fit.hypothesis.coordinates
    assert np.array_equal(handed.heldout, nominal)
    assert after.verdict == "unknown"
    assert after.chosen.causes == ()
    assert after.unknown == (0.6 if verdict == "unknown" else UNSTEADY)


def test_a_simulator_that_no_model_file_takes_is_not_handed_over() -> None:
    """Its damping is negative at every command, whatever it predicts."""

    class Wild(ToyRig):
        def model(self, settings: Mapping[str, float]) -> Model:
            own = super().model(settings)
            return replace(own, parameters={**own.parameters, "c0a": -1.0 if "cubic" in settings else 1.0})

    search = Search(Problem(Wild(toy({"cubic": 0.5}, 0.02).records)), 1e-9)
    search.extend(False, 1)
    fits = [*search.ranked(False), *search.ranked(True)]
    decision = decided(search, fits, {}, None)
    best = fits[decision.chosen.index]
    assert best.hypothesis.causes == ("cubic",)
    final = FinalFit(best, search.problem.gaps(best.residual), search.problem)
    handed, after = never_worse(search, fits, final, decision)
    assert (after.verdict, handed.fit.hypothesis.coordinates) == ("unknown", ())


@pytest.mark.parametrize(("unknown", "worse", "verdict"), [(0.45, False, "effect"), (0.45, True, "unknown")])
def test_a_cause_is_named_if_it_is_stated_to_be_more_probable_than_not(
    answered: tuple[Search, list[Fit], Decision], unknown: float, worse: bool, verdict: str
) -> None:
    """.55 of a sure cause; with a lapse of .35, where it makes the gap larger in a regime: .65 x .55 + .35 / 3."""
    search, fits, decision = answered
    estimate = RegimeEstimate("record", None, None, ("1",), {}, {}, True, 0.1, 0.2 if worse else 0.05)
    after = likely(search, replace(decision, unknown=unknown), fits, {"cubic": (estimate,)})
    assert (after.verdict, after.chosen) == (verdict, decision.chosen)
