"""The pieces of a diagnosis against truths that are known: fits, floors, evidence, shares, ceilings, regimes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrdamp.diagnosis.attribution.stages import regimes
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.constants import CAUSE, EVIDENCE_GAIN, LAPSE, NUMBER
from mrdamp.diagnosis.damper_run import judge
from mrdamp.diagnosis.evidence.ceiling import ceiling
from mrdamp.diagnosis.evidence.consistency import RegimeEstimate, hull
from mrdamp.diagnosis.evidence.judgement import with_nearest
from mrdamp.diagnosis.evidence.ties import unseen
from mrdamp.diagnosis.evidence.verdict import Scored, by_causes, decide, lapse_of, of_cause
from mrdamp.diagnosis.hypotheses.terms import Coordinate
from mrdamp.diagnosis.problem.noise import channel_noise
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model import Model
from mrdamp.records.motion import stroke_since_reversal
from mrdamp.records.sampling import memory
from mrdamp.records.smoothing import noise_level, smoothed
from mrdamp.records.upsampling import repaired_ends, upsampled
from toy_rig import search_of, searched, toy

RNG = np.random.default_rng(5)


def test_gaps_of_the_nominal_are_what_the_truth_says() -> None:
    rig = toy({"offset": 0.5}, noise=0.0)
    problem = Problem(rig)
    gaps = problem.gaps(problem.of_settings([{}])[0])
    for b, gap in zip(problem.blocks, gaps, strict=True):
        force = rig.measured(b.record)[0, problem.taken(b.record)]
        assert gap == pytest.approx(0.5 / np.sqrt(np.mean(force**2)), rel=1e-9)


@pytest.mark.parametrize(
    ("truth", "verdict", "causes"),
    [
        ({}, "none", ()),
        ({"offset": 0.0008}, "none", ()),  # below the noise
        ({"gain": 2.6}, "parameters", ()),
        ({"cubic": 0.4}, "effect", ("cubic",)),
        ({"late": 1.5}, "effect", ("late",)),
        ({"sign": 0.3, "offset": 0.4}, "effect", ("offset", "sign")),
        ({"gain": 2.4, "sign": 0.4}, "effect", ("sign",)),
        ({"outside": 1.2}, "unknown", None),
    ],
)
def test_the_verdict_is_the_truth_that_made_the_records(
    truth: dict[str, float], verdict: str, causes: tuple[str, ...] | None
) -> None:
    search = searched(truth)
    _, decision = judge(search)
    assert decision.verdict == verdict
    if causes is not None:
        assert tuple(sorted(decision.chosen.causes)) == causes
    assert sum(decision.probabilities) == pytest.approx(1.0)


def test_noise_is_read_from_repeats_and_from_the_high_band() -> None:
    rig = toy({}, noise=0.3)
    again = toy({}, noise=0.3, seed=9)
    model = Model("bingham", {"c0a": 1.0, "c0b": 0.0, "fya": 1.0, "fyb": 0.0, "v_ref": 0.1})
    case = Case("toy", Path("."), model, rig.records, ((again.records[1], 1),))
    assert channel_noise(case, rig)[0].levels[0] == pytest.approx(0.3, rel=0.08)
    alone = Case("toy", Path("."), model, rig.records, ())
    noise, notes = channel_noise(alone, rig)
    assert noise.source == "high band"
    assert not notes
    assert noise.levels[0] == pytest.approx(0.3, rel=0.15)


def test_smoothing_takes_noise_from_a_sine_and_leaves_a_corner() -> None:
    t = 0.002 * np.arange(3000)
    sine = 0.01 * np.sin(2 * np.pi * 1.5 * t)
    noise = 1e-6 * RNG.standard_normal(len(t))
    assert noise_level(sine + noise) == pytest.approx(1e-6, rel=0.1)
    left = smoothed(sine + noise) - sine
    assert np.std(left) < 0.75e-6
    assert np.std(np.gradient(left)) < 0.15e-6  # of white noise 0.7e-6: what counts is the velocity
    triangle = 0.01 * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * t))
    assert np.abs(smoothed(triangle + noise) - triangle).max() < 2e-5  # the plain window of 45 is off by 2e-4
    np.testing.assert_array_equal(smoothed(sine, 0.0), sine)


def test_motion_between_samples_is_a_sines() -> None:
    dt, w = 0.002, 2 * np.pi * 12.0
    t = dt * np.arange(1000)
    fine = upsampled(0.01 * np.sin(w * t), np.asarray(t), dt, 4)
    at = fine.sample_time * np.arange(len(fine.x))
    inner = slice(40, -40)
    assert np.abs(fine.v - 0.01 * w * np.cos(w * at))[inner].max() < 1e-4 * 0.01 * w
    assert np.abs(fine.a + 0.01 * w**2 * np.sin(w * at))[inner].max() < 5e-3 * 0.01 * w**2
    np.testing.assert_allclose(fine.u, at, atol=1e-12)
    np.testing.assert_allclose(fine.x[::4], 0.01 * np.sin(w * t), atol=1e-12)


def test_a_bent_end_is_put_where_the_motion_goes_and_others_are_left() -> None:
    sine = 0.01 * np.sin(2 * np.pi * 3 * 0.002 * np.arange(500))
    bent = sine.copy()
    bent[-1] = sine[-2] + 0.4 * (sine[-1] - sine[-2])
    assert np.abs(repaired_ends(bent) - sine).max() < 0.05 * abs(bent[-1] - sine[-1])
    for seed in range(100):
        x = sine + 1e-6 * np.random.default_rng(seed).standard_normal(500)
        np.testing.assert_array_equal(repaired_ends(x), x)
    for last in range(1, 12):  # a corner that a filter has rounded, turning so many samples before the end
        t, kernel = np.arange(400 + last), np.hanning(11) / np.hanning(11).sum()
        x = np.convolve(np.where(t < 400, t, 800 - t) * 1e-5, kernel, "valid")
        assert np.abs(repaired_ends(x) - x).max() < 0.3e-5


def test_the_ceiling_sees_what_is_lawful_and_not_what_is_noise() -> None:
    tables, lawful, noise, weights = [], [], [], []
    for k in range(6):
        x = np.sin(0.02 * (1 + 0.2 * k) * np.arange(1500) + k)
        slow = memory(np.abs(x), 0.01, 0.3)
        tables.append(np.column_stack([x, np.gradient(x), slow]))
        lawful.append(np.tanh(3 * x) * slow + 0.05 * RNG.standard_normal(1500))
        noise.append(RNG.standard_normal(1500))
        weights.append(np.full(1500, 1 / np.sqrt(1500)))
    groups = list(range(6))
    assert ceiling(tables, lawful, weights, 6 * 0.05**2, groups) > 0.9
    assert ceiling(tables, noise, weights, 0.0, groups) < 0.03


def test_memory_and_stroke() -> None:
    step = memory(np.concatenate([[0.0], np.ones(100)]), 0.01, 0.1)
    assert step[10] == pytest.approx(1 - np.exp(-1), rel=1e-9)
    x = np.concatenate([np.linspace(0, 1, 11), np.linspace(0.9, 0, 10)])
    stroke = stroke_since_reversal(x, 0.01)
    assert stroke[10] == pytest.approx(1.0)
    assert stroke[-1] == pytest.approx(-1.0)


def test_a_regime_that_holds_the_gap_is_found_and_none_where_there_is_none() -> None:
    v = RNG.uniform(-1, 1, 4000)
    halves = np.arange(4000) % 2 == 0
    loud = RNG.standard_normal(4000) * np.where(v > 0.5, 4.0, 1.0)
    found = regimes({"velocity (m/s)": v}, loud, halves)
    assert len(found) == 1
    assert found[0].what.startswith("velocity (m/s) from 0.4")
    assert found[0].share_of_samples == pytest.approx(0.25, abs=0.01)
    assert found[0].share_of_gap == pytest.approx(16 / 19, abs=0.04)
    assert regimes({"velocity (m/s)": v}, RNG.standard_normal(4000), halves) == ()


def test_a_regime_is_named_by_the_values_in_it() -> None:
    """A fifth of the samples at each of five commands, the error at the second one alone: quarters part there."""
    command = np.repeat([0.1, 0.2, 0.45, 0.8, 1.0], 800)
    (found,) = regimes({"command": command}, np.where(command == 0.2, 2.0, 0.1), np.arange(4000) % 2 == 0)
    assert found.what == "command 0.2"
    assert found.share_of_samples == pytest.approx(0.2)


def test_an_unknown_cause_is_handed_over_by_what_leaves_least() -> None:
    """An effect takes a part of the cost, too little to be named: nothing at all has the most evidence."""
    search = searched({"outside": 1.1, "cubic": 0.15})
    fits, decision = judge(search)
    assert decision.verdict == "unknown"
    near = with_nearest(search, fits, decision)
    assert (near.verdict, near.unknown) == ("unknown", decision.unknown)
    assert not decision.chosen.causes
    assert near.chosen.causes
    cost = {f.hypothesis.name: search.left_out_cost(f) for f in fits}
    assert cost[fits[near.chosen.index].hypothesis.name] == min(cost.values())
    assert cost[fits[near.chosen.index].hypothesis.name] < cost[fits[decision.chosen.index].hypothesis.name]


NOTHING = Scored((), False, 1.0, 0)
QUIET = Scored((), False, 0.0102, 0)
FREED = Scored((), True, 0.01, 0, left_out=0.01)
BETTER = Scored((), True, 0.0094, 0, left_out=0.92)
A, B = (Scored((cause,), False, 0.01, 1, left_out=0.01) for cause in "ab")
HALF, OTHER = Scored(("a",), False, 0.3, 1, left_out=0.3), Scored(("b",), False, 0.95, 1, left_out=0.95)
LITTLE = replace(HALF, cost=0.9, left_out=0.9)
BESIDE = [Scored(("a", other), False, 0.1, 2, left_out=0.1) for other in "bc"]
#: Nominal parameters 4 % off and one effect: a gain of the sensor takes most of what free parameters take.
OFF = [
    Scored((), False, 60.0, 0),
    Scored((), True, 17.0, 0, left_out=0.3),
    Scored(("a",), True, 1.02, 2, left_out=0.04),  # of what the law alone leaves
    Scored(("a",), False, 3.3, 2, left_out=0.024),
    Scored(("a", "gain"), False, 2.0, 3, left_out=0.0138),
]


@pytest.mark.parametrize(
    ("scored", "floor", "options", "verdict", "causes"),
    [
        ([NOTHING, FREED], 0.01, {}, "parameters", ()),
        ([NOTHING, A], 0.01, {"steady": False}, "effect", ("a",)),
        # Two runs of one test that differ: other numbers, the same in both, cannot be the answer.
        ([NOTHING, FREED], 0.01, {"steady": False}, "unknown", ()),
        ([QUIET], 0.01, {}, "none", ()),
        ([QUIET], 0.01, {"steady": False}, "unknown", ()),
        # 8 % off a gap that is hardly more than noise, at a price that it is not worth.
        ([QUIET, BETTER], 0.0095, {}, "none", ()),
        ([QUIET, BETTER], 0.0095, {"steady": False}, "unknown", ()),
        ([replace(QUIET, cost=0.03), replace(BETTER, cost=0.028)], 0.0095, {}, "unknown", ()),
        # A baseline determines the law.
        ([NOTHING, A, FREED], 0.01, {"own": 0.005}, "effect", ("a",)),
        # Two forms of one cause together outweigh another that is a little better than each.
        ([NOTHING, replace(B, cost=0.0099, left_out=0.0099), A, A], 0.001, {}, "effect", ("a",)),
        # A clearance and a spring of the mount are one statement.
        ([NOTHING, replace(A, causes=("backlash",)), replace(A, causes=("mount_compliance",)), B], 0.001, {},
         "effect", ("backlash",)),
        # What a cause takes off the records that it was fitted to, it has to take off others, and not a little.
        ([NOTHING, HALF, OTHER], 0.001, {}, "effect", ("a",)),
        ([NOTHING, replace(HALF, left_out=0.9), OTHER], 0.001, {}, "unknown", ()),
        ([NOTHING, LITTLE, OTHER], 0.001, {}, "unknown", ()),
        ([NOTHING, LITTLE, OTHER], 0.001, {"own": 0.9}, "none", ()),
        # Beside what it is established is open, and alone it was not fitted.
        ([NOTHING, *BESIDE], 0.001, {}, "effect", ("a", "b")),
        (OFF, 1.0, {}, "effect", ("a",)),
    ],
)
def test_what_is_left_decides(
    scored: list[Scored], floor: float, options: dict[str, Any], verdict: str, causes: tuple[str, ...]
) -> None:
    found = decide(scored, floor, **options)
    assert (found.verdict, found.chosen.causes) == (verdict, causes)
    assert found.chosen.free or scored is not OFF


@pytest.mark.parametrize(("times", "unknown"), [(1.0, 0.0), (1.375, 0.2), (1.75, 0.5)])
def test_no_gap_is_less_certain_the_nearer_its_limit_is(times: float, unknown: float) -> None:
    """x^2 / (1 + x^2) for the share x of the way from the baseline's squares to 1.75 times them."""
    found = decide([Scored((), False, times * 0.02, 0)], 0.01, own=0.02)
    assert found.verdict == "none"
    assert found.unknown == pytest.approx(unknown)


def test_no_gap_is_less_certain_beside_a_cause_that_is_nearly_established() -> None:
    """A cause one nat below none, 1 : e, tempered: both shares to the power 1 / 1.3."""
    cause = Scored(("a",), False, 0.019, 1, left_out=float(np.exp(-(CAUSE + NUMBER - 1) / EVIDENCE_GAIN)))
    found = decide([Scored((), False, 0.02, 0), cause], 0.01, own=0.02)
    assert found.verdict == "none"
    assert found.probabilities == pytest.approx([1 / (1 + np.exp(-1 / 1.3)), 1 / (1 + np.exp(1 / 1.3))])


@pytest.mark.parametrize(("cost", "outside"), [(0.009, 7), (0.02, None)])
def test_a_rival_with_the_larger_error_is_no_better_explanation(cost: float, outside: int | None) -> None:
    cause = Scored(("a",), False, 0.01, 1, left_out=0.5)
    found = decide([Scored((), False, 1.0, 0), cause], 0.001, [Scored(("b",), False, cost, 1, 7, left_out=0.3)])
    assert (found.outside, found.verdict) == (outside, "effect" if outside is None else "unknown")


def test_beside_a_wrong_law_an_answer_without_a_cause_lapses_more_and_a_contradicted_one_most() -> None:
    beside = {v: lapse_of(v, inexact=True, worse=False) for v in ("effect", "parameters", "unknown", "none")}
    assert beside["effect"] == beside["parameters"] == LAPSE < beside["unknown"] == beside["none"]
    assert lapse_of("effect", inexact=True, worse=True) > beside["none"]
    assert {lapse_of(v, inexact=False, worse=w) for v in beside for w in (True, False)} == {LAPSE}


def test_probabilities_are_even_between_equals() -> None:
    sets = by_causes([NOTHING, A, B], decide([NOTHING, A, B], 0.01).probabilities)
    assert sets["a",] == pytest.approx(sets["b",])
    assert of_cause(sets)["a"] == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize(("own", "hidden"), [(0.0, True), (1.0, False)])
def test_a_baseline_fixes_what_free_parameters_would_absorb(own: float, hidden: bool) -> None:
    """A motion between -1 and 1 alone: a cubic is a gain there, and the baseline has fixed the gain."""
    rig = toy({})
    rng = np.random.default_rng(3)
    made = []
    for r in rig.records:
        x = np.where(np.arange(r.n) // 20 % 2 == 0, 1.0, -1.0)
        force = 2.0 * x + 0.02 * rng.standard_normal(r.n)
        made.append(replace(r, channels=dict(r.channels) | {"displacement_m": x, "force_N": force}))
    search = search_of(replace(rig, records=tuple(made)))
    search.own = own
    rows = {row["effect"] for row in unseen(search, search.base)}
    assert ("cubic" in rows) == hidden


def test_a_regime_that_says_nothing_of_a_setting_does_not_widen_its_interval() -> None:
    """Regimes with 2 to 4 and with the whole range of 1 to 100, beside 3 to 5 of all records."""
    own = Coordinate("k", 10.0, 1.0, 100.0, 1.0, log=True)
    some, none = (
        RegimeEstimate("speed", 0.1, 0.2, ("a",), {"k": 3.0}, {"k": ends}, True, 0.2, 0.1)
        for ends in ((2.0, 4.0), (1.0, 100.0))
    )
    assert hull([own], {"k": (3.0, 5.0)}, [some, none]) == {"k": (2.0, 5.0)}
