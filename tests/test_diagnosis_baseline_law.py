"""The law identified again on the rig's baseline, and whether a cause is new since then.

The rig is a Bouc-Wen damper whose hysteretic force bends with the current, integrated by SciPy, with noise. Its
simulator has straight lines.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from mrdamp.diagnosis.attribution.baseline_law import baseline_law
from mrdamp.diagnosis.attribution.frame_blocks import blocks
from mrdamp.diagnosis.attribution.frame_damper import frame_baseline_law
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.constants import SECOND_CAUSE
from mrdamp.diagnosis.evidence.changed import evidence_of_change, of_changes
from mrdamp.diagnosis.evidence.judgement import scored
from mrdamp.diagnosis.evidence.verdict import Decision
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.report.result import Diagnosis
from mrdamp.diagnosis.run import diagnose
from mrdamp.identify import identify
from mrdamp.model import Effect, Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.structures import ShearFrame

DT = 0.002
#: Amplitude (m), frequency (Hz) and command of a test.
TESTS = [
    (0.008, 1.1, 0.0), (0.008, 1.1, 1.0), (0.014, 0.8, 0.35), (0.005, 2.3, 0.6), (0.011, 1.6, -1.0), (0.006, 1.9, -1.0)
]  # fmt: skip


def record(name: str, test: tuple[float, float, float], seed: int, *, lag: float = 0.0) -> Record:
    """Three seconds; a command below 0 stands for steps between levels."""
    amplitude, hz, level = test
    rng = np.random.default_rng(seed)
    t = DT * np.arange(1500)
    x = amplitude * (np.sin(2 * np.pi * hz * t) + 0.2 * np.sin(2 * np.pi * 0.41 * hz * t + 1 + seed))
    v = np.gradient(x, DT)
    u = np.full(len(t), level)
    if level < 0:
        u = rng.choice([0.0, 0.25, 0.5, 0.75, 1.0], 12)[np.minimum((t / 0.25).astype(int), 11)]
    current = u
    if lag:
        a = np.exp(-DT / lag)
        current = np.asarray(lfilter([1 - a], [1, -a], u, zi=[a * u[0]])[0])

    def rate(when: float, z: Array) -> Array:
        w = np.interp(when, t, v)
        return np.asarray(1500.0 * w - 650.0 * np.abs(w) * z - 350.0 * w * np.abs(z))

    z = solve_ivp(rate, (0, t[-1]), [0.0], t_eval=t, max_step=DT, rtol=1e-6).y[0]
    force = (500 + 400 * current) * v + (60 + 620 * current**0.55) * z + 20
    force = force + rng.normal(0, 2.0, len(t))
    return Record(name, None, DT, {"displacement_m": x, "command": u.astype(float), "force_N": force})


@cache
def baseline() -> tuple[Record, ...]:
    return tuple(record(f"baseline_{k}", test, 20 + k) for k, test in enumerate(TESTS))


@cache
def records(lag: float = 0.0) -> tuple[Record, ...]:
    return tuple(record(f"test_{k}", test, 40 + k, lag=lag) for k, test in enumerate(TESTS))


@cache
def lines() -> Model:
    """The simulator that was commissioned with straight lines."""
    fit = identify("bouc_wen", baseline(), dependence="linear", starts=2, threads=1)
    return replace(fit.model, name="nominal")


def rig(model: Model, lag: float = 0.0) -> DamperRig:
    return DamperRig(model, records(lag)).with_motion()


@pytest.mark.slow
def test_a_simulator_is_kept_if_nothing_is_gained_or_cannot_be_tried() -> None:
    few, unfitted = baseline()[:3], replace(lines(), effects=(Effect("moving_mass", {"m": 1.0}),))
    assert baseline_law(rig(lines()), few) is None
    cell_only = tuple(
        Record(r.name, None, DT, {k.replace("force_N", "reference_force_N"): v for k, v in r.channels.items()})
        for r in baseline()
    )
    assert baseline_law(rig(lines()), cell_only) is None
    assert baseline_law(rig(unfitted), baseline()) is None
    best = identify("bouc_wen", baseline(), dependence="quadratic_saturating", starts=2, threads=1).model
    assert baseline_law(rig(best), baseline()) is None


@pytest.mark.slow
def test_a_law_is_not_extrapolated_to_commands_that_the_baseline_lacks() -> None:
    low = [r for r in baseline() if r.command.max() < 0.9]
    low += [Record(f"{r.name} again", None, DT, r.channels) for r in low]
    assert len(low) >= 4
    assert baseline_law(rig(lines()), low) is None
    few = DamperRig(lines(), tuple(low[:1])).with_motion()
    assert baseline_law(few, low, records()) is None  # of all records that are asked about, few are judged
    within = [r for r in records() if r.command.max() < 0.9]
    assert baseline_law(DamperRig(lines(), tuple(within)).with_motion(), low) is not None


@pytest.mark.slow
def test_the_given_simulator_stands_first_in_the_answer() -> None:
    case = Case("rig", Path(), lines(), records(0.04), (), baseline())
    found: Diagnosis = diagnose(case)
    assert [e.effect for e in found.effects] == ["driver_lag"]
    assert found.gap.corrected < 1.5 * found.gap.noise_floor
    assert found.baseline_law is not None
    assert [s.name for s in found.waterfall[:2]] == ["nominal", "law of the baseline"]
    assert found.gap.corrected < found.baseline_law["gap"] < found.gap.nominal
    assert [s.gap for s in found.waterfall[:2]] == [found.gap.nominal, found.baseline_law["gap"]]
    # Of the nominal squares beyond the noise: what the law of the baseline leaves of them, less what is left at last.
    alone, last, noise = (g**2 for g in (found.baseline_law["gap"], found.gap.left_out, found.gap.noise_floor))
    assert found.effects[0].share == pytest.approx((alone - last) / (found.gap.nominal**2 - noise), abs=0.03)
    assert found.effects[0].share < 0.97
    assert "identified again on the baseline" in found.sentence
    assert found.to_dict()["baseline_law"]["law"] == found.corrected.law


def evidence(before: float, now: float, levels: bool = True) -> float:
    """Of a driver's lag (s, before and now) to be a change. levels: False for a baseline at constant commands."""
    own = tuple(record(f"baseline_{k}", t, 20 + k, lag=before) for k, t in enumerate(TESTS) if levels or t[2] >= 0)
    changed = DamperRig(lines(), records(now))
    (term,) = (t for t in changed.terms if t.name == "driver_lag")
    case, hypothesis = Problem(changed, coarse=True), Hypothesis((), (term,))
    found = fit(case, hypothesis, hypothesis.start())
    baseline = Problem(replace(changed, records=own), coarse=True)
    return evidence_of_change(found, changed.nominal, case, baseline)["driver_lag"]


def test_a_cause_that_the_simulator_misses_on_the_baseline_too_is_no_change() -> None:
    assert evidence(0.0, 0.04) > 5
    assert evidence(0.04, 0.04) < SECOND_CAUSE
    # A lag that the baseline shows too, and that has grown, is a change.
    assert evidence(0.04, 0.08) > 5
    # At constant commands nobody can tell.
    assert abs(evidence(0.0, 0.04, levels=False)) < 0.5


def test_beside_a_lag_that_is_missed_a_new_bias_is_a_change() -> None:
    """Both states have a lag of 40 ms; the case's force reads 15 N too much besides, a fiftieth of its size."""
    own = tuple(record(f"baseline_{k}", test, 20 + k, lag=0.04) for k, test in enumerate(TESTS))
    off = tuple(r.with_channels({"force_N": r.channel("force_N") + 15}) for r in records(0.04))
    changed = DamperRig(lines(), off)
    terms = {t.name: t for t in changed.terms}
    case, hypothesis = Problem(changed, coarse=True), Hypothesis((), (terms["driver_lag"], terms["sensor_offset"]))
    found = fit(case, hypothesis, hypothesis.start())
    nats = evidence_of_change(found, changed.nominal, case, Problem(replace(changed, records=own), coarse=True))
    assert nats["driver_lag"] < SECOND_CAUSE < 5 < nats["sensor_offset"]


def test_what_a_set_loses_goes_to_the_one_without_the_cause_or_to_an_unknown_one() -> None:
    terms = {t.name: t for t in rig(lines()).terms}
    sets = [(), ("driver_lag",), ("driver_lag", "seal_friction"), ("seal_friction",)]
    hypotheses, empty = [Hypothesis((), tuple(terms[n] for n in names)) for names in sets], np.zeros(0)
    fits = [Fit(h, h.start(), 1.0, empty, empty) for h in hypotheses]
    before = Decision("effect", scored(fits)[2], (0.0, 0.5, 0.4, 0.1), 0.1, 0.0, 1.0, unknown=0.2)
    after = of_changes(before, fits, {"driver_lag": 1.0, "seal_friction": 0.25})
    # .3 of the pair go to the lag, .075 of the friction to an unknown cause; the others then share what is left.
    assert after.probabilities == pytest.approx([0.0, 0.8 / 0.925, 0.1 / 0.925, 0.025 / 0.925])
    assert after.unknown == pytest.approx(0.2 + 0.8 * 0.075)


def in_frame(record: Record) -> Record:
    """The damper's test as the first storey's motion, the damper mounted from floor 1 to the ground. Nothing in this
    module asks for the frame's own response."""
    channels = {
        "ground_acceleration_m_s2": 0.1 * np.sin(5 * DT * np.arange(record.n)),
        "command": record.command,
        "floor1_displacement_m": -np.asarray(record.displacement),
        "force_N": record.channel("force_N"),
    }
    return Record(record.name, None, DT, channels)


@cache
def case() -> Case:
    two = np.ones(2)
    structure = ShearFrame(100 * two, 5e5 * two, 100 * two, damper_between=(1, 0))
    model: Model = replace(
        lines(),
        rig="frame",
        structure=structure,
        effects=(*lines().effects, Effect("storey_stiffness", {"e": 0.02}, 2)),
    )
    tests, own = (tuple(in_frame(r) for r in some) for some in (records(), baseline()))
    return Case("frame", Path(), model, tests, (), own)


@pytest.mark.slow
def test_the_law_of_a_frames_damper_is_found_on_its_baseline() -> None:
    one = case()
    again = frame_baseline_law(one, blocks(one))
    assert again is not None
    assert again.after < 0.5 * again.before
    assert again.given is one.model
    assert again.model.structure is one.model.structure
    assert [e.name for e in again.model.effects if e.place] == ["storey_stiffness"]
    error = [
        next(b for b in blocks(replace(one, model=m)) if b.kind == "damper").gap
        for m in (one.model, again.model)
    ]
    assert error[1] < 0.5 * error[0]
    assert frame_baseline_law(replace(one, baseline=()), blocks(one)) is None
    assert frame_baseline_law(one, [b for b in blocks(one) if b.kind != "damper"]) is None
