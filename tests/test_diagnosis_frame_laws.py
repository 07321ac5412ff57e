"""Other laws beside a cause that has the form of a law, in the frame that SciPy integrates (`frame_case`).

Its damper is a modified Bouc-Wen one; the simulator has a Bingham law of the same size.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from frame_case import altered, believed, case_of, records
from mrdamp.diagnosis import frame_run
from mrdamp.diagnosis.attribution import frame_laws as module
from mrdamp.diagnosis.attribution.frame_damper import damper_alone
from mrdamp.diagnosis.attribution.frame_laws import law_handed_over, other_law
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.evidence.judgement import not_established, scored
from mrdamp.diagnosis.evidence.verdict import Decision, Scored
from mrdamp.diagnosis.fits.final import final_fit, predicted_gap
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.frame_run import reduced
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.frame import FrameRig
from mrdamp.diagnosis.problem.residuals import Problem, pooled
from mrdamp.diagnosis.run import diagnose, searched
from mrdamp.diagnosis.searched import silent
from mrdamp.identify import identify


@cache
def case(stiffer: float = 1.0) -> Case:
    found = records()
    if stiffer != 1:
        found = altered(found, "floor3_acceleration_m_s2", stiffer)
    true = case_of(believed(), found)
    own = identify("bingham", damper_alone(true).records, extras=("driver_lag",), starts=2, threads=1).model
    model = replace(true.model, law=own.law, parameters=own.parameters, effects=own.effects)
    return case_of(model, found)


def problem_of(one: Case) -> Problem:
    rig = reduced(one)[1]
    return Problem(rig, coarse=True)


def fitted(problem: Problem, *names: str) -> Fit:
    terms = [next(t for t in problem.rig.terms if t.cause == name) for name in names]
    hypothesis = Hypothesis((), tuple(terms))
    return fit(problem, hypothesis, hypothesis.start(), most=8)


@pytest.mark.slow
@pytest.mark.parametrize("others", [(), ("sensor_gain@3",)])
def test_another_law_makes_shear_thinning_needless(others: tuple[str, ...]) -> None:
    one = case(1.15 if others else 1.0)
    problem = problem_of(one)
    found = other_law(one, problem, fitted(problem, "shear_thinning", *others))
    assert found is not None
    assert found.law == "modified_bouc_wen"
    assert found.causes == ("shear_thinning",)
    assert found.others == frozenset(others)
    assert found.gap < 0.2 * found.left  # with the sensor's gain, which alone leaves half
    assert found.to_dict() == {
        "law": "modified_bouc_wen",
        "gap": found.gap,
        "without": ["shear_thinning"],
        "gap_with": found.left,
        "handed_over": False,
    }
    # The record without a command does not determine the law's dependence on it.
    assert np.all(np.isinf(found.left_out)) if others else found.gap < float(np.max(found.left_out))


@pytest.mark.parametrize("floor", [1e-6, 1.0])
def test_a_storeys_cause_of_a_frame_that_is_as_its_baseline(floor: float) -> None:
    """The baseline is the case's own records: nothing has changed. floor: cost of the noise over the best fit's."""
    problem = problem_of(case())
    found = fitted(problem, "floor_mass@1")
    for baseline, verdict in ((None, "effect"), (problem, "none")):
        search = Search(problem, floor * found.cost, Limits())
        search.keep(found)
        search.own = search.nominal_cost if baseline else 0.0
        assert isinstance(problem.rig, FrameRig)
        assert frame_run.judge(search, problem.rig, baseline)[1].verdict == verdict


def test_a_needless_cause_is_unknown() -> None:
    chosen = Scored(("shear_thinning",), False, 1.0, 1)
    found = not_established(Decision("effect", chosen, (1.0,), 0.2, 0.1, 1.0, unknown=0.1))
    assert found.verdict == "unknown"
    assert found.unknown > 0.5


@pytest.mark.slow
def test_the_answer_names_the_law_and_not_the_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    own = frame_run.judge

    def of_many(law: str, _: object, **options: Any) -> Any:
        """A fit without one of many records: the two of this case do not suffice."""
        return identify(law, damper_alone(case()).records, **{**options, "dependence": "linear"})

    def named(search: Search, *args: Any, **options: Any) -> tuple[list[Fit], Decision]:
        fits, decision = own(search, *args, **options)
        fits = [*fits, fitted(search.problem, "shear_thinning")]
        chosen = replace(scored(fits)[-1], index=len(fits) - 1)
        return fits, replace(
            decision, verdict="effect", chosen=chosen, probabilities=(*decision.probabilities, 0.0)
        )

    monkeypatch.setattr(frame_run, "judge", named)
    monkeypatch.setattr(module, "identify", of_many)
    found = diagnose(case())
    assert (found.verdict, found.effects) == ("unknown", ())
    assert found.other_law is not None
    assert found.other_law["gap"] < 0.5 * found.gap.nominal
    assert found.to_dict()["other_law"] == found.other_law
    assert found.other_law["handed_over"]
    assert found.corrected.law == found.other_law["law"]
    assert not any(e.name == "shear_thinning" for e in found.corrected.effects)
    assert [s.name for s in found.waterfall] == ["nominal", f"law {found.corrected.law}"]
    assert found.gap.left_out is not None
    assert found.gap.left_out < 0.5 * found.gap.nominal
    assert found.gap.corrected == pytest.approx(
        predicted_gap(found.corrected, Problem(reduced(case())[1])), rel=0.1
    )
    assert found.remainder is None or found.remainder.gap == found.gap.left_out
    assert f"Another law ({found.other_law['law']})" in found.sentence
    assert found.sentence.endswith("it is handed over.")


@pytest.mark.slow
def test_a_law_is_handed_over_if_it_leaves_less_of_left_out_records() -> None:
    found = searched(case(), 1, silent, None)
    other = other_law(case(), found.search.problem, fitted(found.search.problem, "shear_thinning"))
    assert other is not None
    final = final_fit(found.search, found.search.ranked(False)[0], rig=found.rig)
    own = final.problem
    factors = 1.01, 0.6 * min(1.0, pooled(own.gaps(own.nominal())) / pooled(final.heldout))
    more, less = (replace(other, left_out=factor * final.heldout) for factor in factors)
    assert law_handed_over(more, final) is None
    handed = law_handed_over(less, final)
    assert handed is not None
    assert handed.problem.rig.model({}).law == other.law
    assert handed.heldout is less.left_out


@pytest.mark.slow
def test_a_cause_that_leaves_as_little_as_the_laws_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_of(case())
    chosen = fitted(problem, "shear_thinning")
    monkeypatch.setattr(module, "heldout", lambda *_: np.full(len(problem.blocks), 1e-3))
    assert other_law(case(), problem, chosen) is None


@pytest.mark.slow
def test_only_causes_in_the_form_of_a_law_of_a_measured_damper_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("identified")

    monkeypatch.setattr(module, "identify", never)
    problem = problem_of(case())
    assert other_law(case(), problem, fitted(problem, "seal_friction")) is None
    for name in ("shear_thinning", "heating"):
        with pytest.raises(AssertionError, match="identified"):
            other_law(case(), problem, fitted(problem, name))
    for missing in ("force_N", "floor1_displacement_m"):
        some = tuple(replace(r, channels={k: v for k, v in r.channels.items() if k != missing}) for r in case().records)
        assert other_law(replace(case(), records=some), problem, fitted(problem, "shear_thinning")) is None
