"""Data left out of a fit: whole records, halves of records and regimes, and the evidence that they give."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from mrdamp.diagnosis.constants import RECORD_VARIANCE
from mrdamp.diagnosis.evidence import judgement
from mrdamp.diagnosis.evidence.established import utility
from mrdamp.diagnosis.fits.least_squares import Fit, fit, leave_out, leave_out_halves
from mrdamp.diagnosis.fits.record_costs import over_records
from mrdamp.diagnosis.fits.regimes import groupings, left_out
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Hypothesis, Term
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.records import Record
from toy_rig import ToyRig, parts, toy


def test_left_out_records_are_predicted_from_the_others_alone() -> None:
    """The toy is linear in its terms, so the one step from the fit to all must be the others' own least squares."""
    rig = toy({"cubic": 0.3, "offset": 0.1}, noise=0.3)
    problem = Problem(rig)
    hypothesis = Hypothesis((), tuple(t for t in rig.terms if t.effect in ("cubic", "offset")))
    found = fit(problem, hypothesis, hypothesis.start(), tolerance=1e-9)
    gaps = leave_out(problem, found, [(2,)])
    rows, right, tests = [], [], {}
    for b in problem.blocks:
        take = problem.taken(b.record)
        made = {k: v[take] for k, v in parts(np.asarray(rig.records[b.record].displacement)).items()}
        force = rig.measured(b.record)[0, take]
        table, rest = np.column_stack([made["cubic"], made["offset"]]), force - 2 * made["gain"]
        tests[b.record] = (table, rest, b.size)
        if b.record != 2:
            scale = b.size * np.sqrt(len(force))
            rows.append(table / scale)
            right.append(rest / scale)
    numbers = np.linalg.lstsq(np.vstack(rows), np.concatenate(right))[0]
    table, rest, size = tests[2]
    assert gaps[2] == pytest.approx(np.sqrt(np.mean((table @ numbers - rest) ** 2)) / size, rel=1e-5)
    assert np.isnan(np.delete(gaps, 2)).all()


def test_halves_left_out_are_predicted_from_all_other_samples() -> None:
    """The toy is linear in its terms: least squares over the other half and the other records."""
    rig = toy({"cubic": 0.3, "offset": 0.1}, noise=0.3, records=3)
    problem = Problem(rig)
    hypothesis = Hypothesis((), tuple(t for t in rig.terms if t.effect in ("cubic", "offset")))
    found = fit(problem, hypothesis, hypothesis.start(), tolerance=1e-9)
    tables, rests = [], []
    for b in problem.blocks:
        take = problem.taken(b.record)
        made = {k: v[take] for k, v in parts(np.asarray(rig.records[b.record].displacement)).items()}
        scale = b.size * np.sqrt(b.span.stop - b.span.start)
        tables.append(np.column_stack([made["cubic"], made["offset"]]) / scale)
        rests.append((rig.measured(b.record)[0, take] - 2 * made["gain"]) / scale)
    table, rest = np.vstack(tables), np.concatenate(rests)
    expected = []
    for b in problem.blocks:
        middle, cost = (b.span.start + b.span.stop) // 2, 0.0
        for half in (slice(b.span.start, middle), slice(middle, b.span.stop)):
            others = np.delete(np.arange(len(rest)), half)
            numbers = np.linalg.lstsq(table[others], rest[others])[0]
            cost += float(np.sum((table[half] @ numbers - rest[half]) ** 2))
        expected.append(cost)
    assert leave_out_halves(problem, found) == pytest.approx(np.array(expected), rel=1e-4)


@pytest.mark.parametrize("offset", [1.0, 0.01])
@pytest.mark.parametrize(("slope", "left"), [(1.0, 0.0), (0.3, 0.65), (0.2, 0.25), (-0.2, 1.0)])
def test_a_step_that_makes_the_kept_records_worse_is_halved(slope: float, left: float, offset: float) -> None:
    """With a fifth of the true slope the step is five times too long, and two halvings leave a quarter of the error;
    with three tenths one halving leaves two thirds; with a slope of the wrong sign no step is taken. A small error is
    treated as a large one."""
    problem = Problem(toy({"offset": offset}, noise=0.0))
    hypothesis = Hypothesis((), (Term("offset", "sensor", (Coordinate("offset", 0.0, -50.0, 50.0, 1.0),), ((0.0,),)),))
    residual = problem.residuals(hypothesis, np.zeros(1))[0]
    slopes = slope * problem.jacobian(hypothesis, np.zeros(1), residual)
    found = Fit(hypothesis, np.zeros(1), float(residual @ residual), residual, slopes)
    gap = leave_out(problem, found, [(2,)])[2] / problem.gaps(residual)[2]
    assert gap == pytest.approx(left, abs=0.02)


def test_no_record_counts_without_limit() -> None:
    search = Search(Problem(toy({"cubic": 0.3}, records=3)), 1e-5)
    nominal = search.problem.costs(search.problem.gaps(search.residual))
    assert over_records(search, nominal) == pytest.approx(search.nominal_cost)
    assert over_records(search, 0.1 * nominal) > 0.1 * search.nominal_cost
    scale = RECORD_VARIANCE * nominal.mean()
    gone = over_records(search, nominal * [1, 0, 1]) / search.nominal_cost
    assert gone == pytest.approx((scale / (nominal[1] + scale)) ** (1 / 3))


def test_a_free_law_has_to_hold_in_regimes_left_out() -> None:
    """A fifth power is fitted by a gain and a cubic term: over other speeds and strokes they err more."""
    search = Search(Problem(toy({"fifth": 0.5})), 1e-6)
    (cubic,) = (t for t in search.problem.rig.terms if t.effect == "cubic")
    found = search.fitted(Hypothesis(search.problem.rig.nominal, (cubic,)), np.zeros(2), most=9)
    halves = over_records(search, leave_out_halves(search.problem, found))
    left = [left_out(search.problem, found, g.groups) for g in groupings(search.problem)]
    regimes = max(over_records(search, search.problem.costs(gaps)) for gaps in left)
    assert regimes > 1.1 * halves
    assert judgement.left_out_costs(search, [found]) == {id(found): pytest.approx(regimes)}


def test_what_a_cause_does_in_one_record_is_not_hidden_by_the_errors_of_others() -> None:
    """The law errs in three records of four, which the cause cannot affect; in the fourth the cause is nearly all."""
    rng = np.random.default_rng(1)
    made = []
    for k, r in enumerate(toy({}, records=4).records):
        x = np.asarray(r.displacement) * (1.0 if k == 2 else 0.5)
        error = lfilter([0.1], [1, -0.9], rng.normal(0, 0.03 if k == 2 else 0.4, r.n))
        force = 2 * x + error + (0.5 * parts(x)["outside"] if k == 2 else 0.0)
        made.append(Record(r.name, None, r.sample_time, {"displacement_m": x, "command": 0 * x, "force_N": force}))
    search = Search(Problem(ToyRig(tuple(made))), 1e-6)
    cause = Term("outside", "fluid", (Coordinate("outside", 0.0, -50.0, 50.0, 0.1),), ((0.2,),))
    search.keep(search.fitted(Hypothesis((), (cause,)), np.zeros(1), most=6))
    fits = search.ranked(False)
    found = judgement.decided(search, fits, {}, None)
    assert (found.verdict, found.chosen.causes) == ("effect", ("outside",))
    (named,) = (f for f in fits if f.hypothesis.causes)
    assert utility(named.cost / search.nominal_cost, 1, 1, free=False) < -1  # by the sum over records there is none
