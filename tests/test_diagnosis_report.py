"""What a diagnosis says of parameters and ties; the next test, within limits and as far apart as a rival leaves it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import bingham_rig
import frame_reference
from frame_case import believed, case_of, records
from mrdamp.diagnosis.damper_run import judge
from mrdamp.diagnosis.evidence.ties import could_hide
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.designs import SECONDS, Design, Envelope, columns, drawn, neighbour
from mrdamp.diagnosis.problem.frame import FrameRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.report.changes import Change, changes
from mrdamp.diagnosis.report.next_test import Pair, Steps, next_test
from mrdamp.diagnosis.report.result import Candidate, Diagnosis, Gap, Named, Where
from mrdamp.diagnosis.report.sentence import sentence
from mrdamp.model import Effect, Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.structures import dyke1996

DAMPER = Envelope("displacement_m", 0.01, 0.12, 0.3, 10.0, 0.2, 1.4, 0.002)
FRAME = Envelope("ground_acceleration_m_s2", 3.0, None, 0.8, 16.0, 0.0, 1.0, 0.002)


def test_the_size_that_could_hide_is_told_in_the_settings_own_direction() -> None:
    terms = {t.effect: t for t in sines((0.2, 1.0)).terms}
    gain = could_hide(terms["sensor_gain"], 3.0)
    assert gain == pytest.approx(1.3)  # of 1, which is none
    assert could_hide(terms["sensor_gain"], 1e9) == terms["sensor_gain"].coordinates[0].high
    delay, mount = terms["command_delay"], terms["mount_compliance"]
    assert could_hide(delay, 2.0) == pytest.approx(2 * delay.starts[0][0])
    assert could_hide(mount, 2.0) == pytest.approx(
        mount.starts[0][0] / 2
    )  # a softer mount hides, not a stiffer one


@pytest.mark.parametrize("envelope", [DAMPER, FRAME])
def test_every_test_stays_within_the_limits_and_uses_them(envelope: Envelope) -> None:
    rng = np.random.default_rng(1)
    designs = [drawn(rng, envelope) for _ in range(60)]
    designs += [neighbour(rng, a, b, envelope) for a, b in pairwise(designs)]
    kinds, used = set(), []
    for design in designs:
        signal = design.signal(envelope)
        assert len(signal.motion) == len(signal.command) == round(SECONDS / envelope.sample_time)
        peak = np.abs(signal.motion).max() / envelope.largest
        slope = 0.0
        if envelope.rate is not None:
            slope = np.abs(np.diff(signal.motion)).max() / envelope.sample_time / envelope.rate
        assert max(peak, slope) < 0.95, design
        used.append(max(peak, slope))
        assert abs(signal.motion[0]) < 1e-3 * envelope.largest
        assert envelope.command_low <= signal.command.min()
        assert signal.command.max() <= envelope.command_high
        spectrum = np.abs(np.fft.rfft(signal.motion * np.hanning(len(signal.motion))))
        hz = np.fft.rfftfreq(len(signal.motion), envelope.sample_time)
        if not design.triangle:
            assert envelope.lowest - 0.4 < hz[np.argmax(spectrum)] < envelope.highest + 0.4
        kinds.add((design.triangle, design.command))
        assert f"{max(design.hz):.2g} Hz" in design.text(envelope)
    assert np.mean(used) > 0.85
    assert len(kinds) > (7 if envelope.rate is not None else 4)
    names = list(columns(designs[0].signal(envelope), envelope))
    assert names == ["time_s", envelope.channel, "command"]


def test_what_a_test_gains_is_what_least_squares_leaves_more() -> None:
    rng = np.random.default_rng(2)
    known, apart = rng.standard_normal((3, 200)), rng.standard_normal(200)
    j, d = rng.standard_normal((3, 90)), rng.standard_normal(90)

    def left(columns: Array, target: Array) -> float:
        numbers = np.linalg.lstsq(columns.T, target)[0]
        return float(np.sum((target - numbers @ columns) ** 2))

    pair = Pair(("a", "b"), {}, {}, Steps((), np.zeros(0)), known, apart)
    want = left(np.hstack([known, j]), np.concatenate([apart, d])) - left(known, apart)
    assert pair.gained(j, d) == pytest.approx(want, rel=1e-6)
    # A difference that the rival can make itself, and that the records leave it, gains nothing.
    free = Pair(("a", "b"), {}, {}, Steps((), np.zeros(0)), 1e-6 * known, np.zeros(200))
    assert free.gained(j, 0.7 * j[1]) < 1e-6


def sines(commands: tuple[float, ...]) -> DamperRig:
    """A damper that the simulator matches, shaken by sines at constant commands."""
    t = 0.002 * np.arange(1200)
    model, records = bingham_rig.model(), []
    rng = np.random.default_rng(3)
    for k, command in enumerate(commands):
        x = 0.008 * np.sin(2 * np.pi * (0.8 + 0.7 * k) * t)
        force = model.simulate(0.002, {"displacement_m": x, "command": np.full(1200, command)})["force_N"]
        channels = {"time_s": t, "displacement_m": x, "command": np.full(1200, command)}
        records.append(
            Record(f"{k}", None, 0.002, channels | {"force_N": force + 5 * rng.standard_normal(1200)})
        )
    return DamperRig(model, tuple(records))


def proposed(*hidden: str) -> tuple[dict[str, Any], dict[str, Array] | None]:
    search = Search(Problem(sines((0.2, 1.0)), coarse=True), 1e-3, Limits())
    fits, decision = judge(search)
    unseen = [{"effect": name} for name in hidden]
    return next_test(search, fits[decision.chosen.index], fits, decision, (), unseen, np.array([5.0]))


def test_constant_commands_are_answered_with_one_that_changes() -> None:
    test, made = proposed("driver_lag", "command_delay")
    assert made is not None
    assert "driver_lag" in test["why"]
    assert np.ptp(made["command"]) > 0.3
    assert test["separation"] > 1.0
    assert [s["one"] for s in test["separates"]] == ["driver_lag"]  # one of a stage


def test_a_sensor_gain_that_the_law_can_make_itself_is_told_as_beyond_any_test() -> None:
    assert "no test within these limits separates sensor_gain" in proposed("sensor_gain")[0]["why"]


@pytest.mark.slow
def test_a_frames_test_moves_it_no_more_than_its_records_and_leaves_the_table_at_rest() -> None:
    """Sines at the first mode, at the strongest acceleration of the records: integrated by SciPy."""
    case = case_of(believed(), records())
    rig = FrameRig(case.model, case.records)
    design = Design((5.4,), (1.0,), (0.3,), False, "constant", 0.0, 0.0, 1.0, 0)
    asked = design.signal(rig.envelope)
    signal = rig.admitted(asked, {})
    dt = rig.envelope.sample_time
    t = dt * np.arange(len(signal.motion))
    speed = np.cumsum(signal.motion) * dt
    assert abs(speed[-1]) < 1e-3 * np.abs(speed).max()
    assert abs(np.sum(speed)) < 1e-3 * np.abs(np.cumsum(speed)).max()

    def moved(motion: Array) -> Array:
        run = frame_reference.solve(lambda at: float(np.interp(at, t, motion)), np.zeros(60), 0.1, dt)
        return np.asarray(np.abs(run["displacement"][:, 0]).max())

    reached = max(float(np.abs(r.channel("floor1_displacement_m")).max()) for r in case.records)
    assert moved(asked.motion) > 1.5 * reached
    assert moved(signal.motion) < 1.02 * reached


LAW = {"c0a": 500.0, "c0b": 10.0, "fya": 20.0, "fyb": 100.0, "v_ref": 0.01}
NOMINAL = Model("bingham", LAW, (Effect("sensor_offset", {"f": 5.0}),))
CORRECTED = Model("bingham", {**LAW, "c0a": 600.0}, (Effect("driver_lag", {"tau": 0.02}),))


def found(**more: object) -> Diagnosis:
    named = Named("driver_lag", "driver", None, 0.6, {"tau": 0.02}, 0.5, {"tau": (0.01, 0.03)})
    plain = Diagnosis(
        "case", "damper", "either", "effect", (named,), (), (("driver_lag", "saturation", "sensor_lag"),),
        Where({"driver": 1.0}), Gap(0.2, 0.2, 0.1, 0.01, (0.09, 0.11), left_out=0.12), (), {}, CORRECTED,
        intervals={"c0a": (590.0, 610.0), "driver_lag_tau": (0.0, 1.0)},
        probabilities={"driver_lag": 0.6, "saturation": 0.3, "sensor_lag": 0.01, "none": 0.97},
    )  # fmt: skip
    return replace(plain, **more)  # type: ignore[arg-type]


def test_old_and_new_values_have_units_and_named_effects_come_first() -> None:
    assert changes(NOMINAL, found()) == [
        Change("driver_lag_tau", "s", None, 0.02, (0.01, 0.03)),
        Change("c0a", "N s/m", 500.0, 600.0, (590.0, 610.0)),
        Change("sensor_offset_f", "N", 5.0, None, None),
    ]
    assert changes(CORRECTED, found()) == []


def test_the_same_at_a_place_of_a_frame() -> None:
    frame = replace(NOMINAL, rig="frame", structure=dyke1996(), effects=())
    named = Named("storey_stiffness", "structure", 2, 1.0, {"e": -0.1}, 1.0)
    other = frame.with_effects([Effect("storey_stiffness", {"e": -0.1}, 2)])
    there = found(effects=(named,), corrected=other)
    assert changes(frame, there) == [Change("storey_stiffness_e@2", "", None, -0.1, None)]


def test_the_headline_has_ties_with_their_probabilities() -> None:
    said = sentence(found())
    assert "driver_lag (the coil current lags the command; probability 0.60)" in said
    assert "do not distinguish it from saturation (probability 0.30). Nearly the same as it: sensor_lag" in said
    assert "from 20.0 % to 10.0 %, 12.0 % on records left out of the fit; noise 1.0 %." in said
    assert "agrees with the rig (probability 0.97)" in sentence(found(verdict="none", effects=()))
    # What no candidate is established for need not be outside the catalogue.
    unknown = found(
        verdict="unknown", effects=(), probabilities={"unknown": 0.8, "driver_lag": 0.2},
        candidates=(Candidate(("unknown",), 0.8, 0.2), Candidate((), 0.1, 0.2), Candidate(("driver_lag",), 0.1, 0.2)),
    )  # fmt: skip
    likeliest = "established for the gap of 20.0 %; the most probable one is driver_lag (probability 0.20)."
    assert likeliest in sentence(unknown)
    # A cause's own probability counts: .12 of the friction, .08 of it beside a lag.
    sets = {("unknown",): 0.8, ("sensor_lag",): 0.09, ("seal_friction",): 0.04, ("driver_lag", "seal_friction"): 0.08}
    two = replace(
        unknown, candidates=tuple(Candidate(c, p, 0.2) for c, p in sets.items()),
        probabilities={"unknown": 0.8, "seal_friction": 0.12, "sensor_lag": 0.09, "driver_lag": 0.08},
    )  # fmt: skip
    assert "the most probable one is seal_friction (probability 0.12)." in sentence(two)
