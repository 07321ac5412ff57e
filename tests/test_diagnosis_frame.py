"""A frame's diagnosis on records that SciPy integrated: a fault in simulator, sensor or base, with and without law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from frame_case import DT, LAW, altered, believed, case_of, late, records, without
from modules import CASES, needs
from mrdamp.diagnosis import frame_run
from mrdamp.diagnosis.attribution.frame_blocks import blocks, place_shares
from mrdamp.diagnosis.attribution.frame_damper import damper_alone
from mrdamp.diagnosis.case.folder import Case, read_case
from mrdamp.diagnosis.channels.comparison import Compared
from mrdamp.diagnosis.channels.frame_comparison import Part, compared_parts
from mrdamp.diagnosis.evidence.changed import since_baseline
from mrdamp.diagnosis.evidence.judgement import likely
from mrdamp.diagnosis.evidence.structure_numbers import deviations, promoted
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.frame_run import LIMITS, compared_without_law, reduced
from mrdamp.diagnosis.hypotheses.frame_effects import frame_terms
from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Sizes
from mrdamp.diagnosis.problem.frame import FrameRig
from mrdamp.diagnosis.problem.noise import channel_noise, floors
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.report.page import page
from mrdamp.diagnosis.run import diagnose
from mrdamp.identify import identify
from mrdamp.model import Effect, Model
from mrdamp.records import Record
from mrdamp.simulation.predict import predict
from mrdamp.structures import ShearFrame

Floors = tuple[float, float, float]


def test_every_block_of_a_right_model_is_clean() -> None:
    found = blocks(case_of(believed(), records()))
    assert [b.name for b in found] == [
        *(f"accelerometer {j}" for j in (1, 2, 3)), *(f"storey {j}" for j in (1, 2, 3)), "damper",
    ]  # fmt: skip
    for b in found[:-1]:
        assert 0.6 * b.noise < b.gap < 1.35 * b.noise, (
            b
        )  # all of the gap is noise, and the noise is no larger


@pytest.mark.parametrize(
    ("change", "gain", "wrong"),
    [
        ({"stiffness": (5.16e5, 8.0e5, 6.84e5)}, 1.0, {"storey 2"}),
        ({"damping": (125.0, 50.0, 800.0)}, 1.0, {"storey 3"}),
        ({"mass": (98.3, 110.0, 98.3)}, 1.0, {"storey 1", "storey 2"}),
        ({}, 1.15, {"accelerometer 3"}),
    ],
)
def test_a_wrong_storey_or_accelerometer_is_that_one(
    change: dict[str, Floors], gain: float, wrong: set[str]
) -> None:
    read = altered(records(), lambda a: gain * a, "floor3_acceleration_m_s2")
    found = blocks(case_of(believed(True, **change), read))
    assert {b.name for b in found if not b.clean} - {"damper"} == wrong


def test_settings_with_a_place_reach_the_simulator() -> None:
    rig, model = FrameRig(believed(), (records()["steps"],)), believed()
    effects = (
        Effect("storey_stiffness", {"e": -0.2}, 2),
        Effect("joint_friction", {"coulomb": 40.0, "width": 0.003}, 3),
        Effect("sensor_gain", {"g": 1.2}, 1),
        Effect("channel_shift", {"d": 0.004}),
    )
    settings = {
        "storey_stiffness_e@2": -0.2, "joint_friction_coulomb@3": 40.0, "joint_friction_width@3": 0.003,
        "sensor_gain_g@1": 1.2, "channel_shift_d": 0.004, "mass@3": 120.0, "alpha_b": 5e4,
    }  # fmt: skip
    heavy = replace(model.structure, mass=np.array([98.3, 98.3, 120.0]))  # type: ignore[type-var]
    law = {**model.parameters, "alpha_b": 5e4}
    want = replace(model, structure=heavy, effects=(*model.effects, *effects), parameters=law)
    inputs = dict(records()["steps"].channels)
    expected, told = want.simulate(DT, inputs), rig.model(settings).simulate(DT, inputs)
    for row, name in zip(rig.simulate([settings], 0)[0], rig.channels, strict=True):
        np.testing.assert_array_equal(told[name], expected[name])
        assert np.std(row - expected[name]) < 5e-3 * np.std(expected[name]), name


def test_a_number_that_stands_out_is_told_as_an_effect() -> None:
    """All nominal numbers free, at what makes the simulator right: one storey was wrong, or everything a little."""

    def at_truth(model: Model) -> tuple[Problem, Fit, FrameRig]:
        _, rig = reduced(case_of(model, records()))
        rig = replace(rig, free_structure=True)
        problem, hypothesis = Problem(rig, coarse=True), Hypothesis(rig.nominal)
        right = believed().structure
        assert right is not None
        true = {
            f"{k}@{j}": getattr(right, k)[j - 1] for k in ("mass", "stiffness", "damping") for j in (1, 2, 3)
        }
        q = np.array([c.point(true.get(c.name, c.start)) for c in rig.nominal])
        residual = problem.residuals(hypothesis, q)[0]
        jacobian = problem.jacobian(hypothesis, q, residual)
        return problem, Fit(hypothesis, q, float(residual @ residual), residual, jacobian), rig

    problem, one, rig = at_truth(believed(stiffness=(5.16e5, 6.84e5 / 1.25, 6.84e5)))
    best, penalty = min(promoted(rig, one, 3.5), key=lambda item: item[1])
    assert best.hypothesis.causes == ("storey_stiffness@2",)
    assert penalty < deviations(one).penalty() - 3.5
    assert best.settings["storey_stiffness_e@2"] == pytest.approx(0.25, abs=0.01)
    # The same simulator, told in other words.
    np.testing.assert_allclose(problem.residuals(best.hypothesis, best.point)[0], one.residual, atol=1e-9)
    _, everywhere, rig = at_truth(
        believed(mass=(108.0, 90.0, 106.0), stiffness=(5.16e5 / 1.1, 6.84e5 / 0.92, 6.84e5 / 1.1))
    )
    assert not promoted(rig, everywhere, 3.5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "gain", "named"),
    [
        ({"stiffness": (5.16e5, 8.0e5, 6.84e5)}, 1.0, [("storey_stiffness", 2)]),
        ({}, 1.2, [("sensor_gain", 3)]),
    ],
)
def test_the_cause_is_named(
    change: dict[str, Floors], gain: float, named: list[tuple[str, int]]
) -> None:
    found = altered(records(), lambda a: gain * a, "floor3_acceleration_m_s2")
    case = case_of(believed(True, **change), found)
    answer = diagnose(case, limits=replace(LIMITS, singles=3))
    # The gap as a user computes it: every channel of every record as logged, without .1 s and the last eight samples.
    apart, given = [], case.model.with_hold(bool(answer.corrected.hold))
    for r in case.records:
        for name, values in predict(given, r).items():
            if name in r.channels and name != "time_s":
                whole, keep = np.asarray(r.channel(name)), slice(round(0.1 / DT), -8)
                apart.append(np.mean((values - whole)[keep] ** 2) / np.mean(whole[keep] ** 2))
    assert answer.gap.nominal == pytest.approx(np.sqrt(np.mean(apart)), rel=1e-9)
    assert [(e.effect, e.place) for e in answer.effects] == named
    assert answer.verdict == "effect"
    assert sum(answer.where.stages.values()) == pytest.approx(1)
    assert answer.gap.corrected < 0.2 * answer.gap.nominal


@pytest.mark.slow
def test_a_lag_beside_wrong_numbers_is_one_cause() -> None:
    wrong = {name: factor * LAW[name] for name, factor in {"alpha_b": 0.8, "c0a": 1.25, "alpha_a": 1.2}.items()}
    case = case_of(replace(believed(lag=False), parameters=LAW | wrong), records())
    answer = diagnose(case, limits=replace(LIMITS, singles=3))
    assert answer.verdict == "effect"
    assert [e.effect for e in answer.effects] == ["driver_lag"]
    assert answer.gap.corrected < answer.gap.recalibrated


def test_a_storeys_share_has_an_interval() -> None:
    found = blocks(case_of(believed(stiffness=(5.16e5, 8.0e5, 6.84e5)), records()))
    shares, ends = place_shares(found)
    assert shares["storey 2"] > 0.9
    assert ends["storey 2"][0] - 1e-9 <= shares["storey 2"] <= ends["storey 2"][1] + 1e-9
    assert ends["storey 3"] == (0.0, 0.0)
    wrong = found[[b.name for b in found].index("storey 2")]
    assert np.mean(wrong.drawn) == pytest.approx(wrong.gap**2, rel=0.15)
    assert place_shares([b for b in found if b.clean])[1] == {}


LATE = 5  # samples


@pytest.mark.slow
def test_a_late_ground_channel_is_the_nearest_cause() -> None:
    found = diagnose(case_of(believed(), altered(records(), late(LATE), "ground_acceleration_m_s2")))
    assert found.verdict == "unknown"
    assert found.outside is not None
    assert found.outside["cause"] == "ground_delay"
    assert found.outside["parameters"]["ground_delay"] == pytest.approx(LATE * DT, rel=0.02)
    assert found.outside["gap"] < 0.1 * found.gap.nominal
    assert found.where.stages["sensor"] == 1
    assert "late or early" in found.sentence


@pytest.mark.slow
@needs(CASES)
def test_soil_that_sways_and_rocks_is_no_storey() -> None:
    """Base 100 kg, 4 MN/m, 2 kN s/m, by another integrator; rocking by an inertia and a spring in kg m2 and N m/rad."""
    found = diagnose(read_case(CASES / "faults" / "19_soil"), jobs=2)
    assert found.verdict == "unknown"
    assert found.outside is not None
    assert (found.outside["cause"], found.outside["form"]) == ("foundation", "that sways and rocks")
    assert found.outside["gap"] < 1.2 * found.gap.noise_floor
    parameters = found.outside["parameters"]
    assert parameters["sway_stiffness"] == pytest.approx(4e6, rel=0.1)
    # The height of a storey is not in the records: k / I does not depend on it.
    assert parameters["rock_stiffness"] / parameters["rock_mass"] == pytest.approx(1.5e6 / 20, rel=0.1)
    assert found.where.stages["structure"] == 1
    assert "due to" not in found.sentence


def test_the_noise_of_a_frames_record_is_its_own() -> None:
    """Of white noise that is 5 % of each channel the floor is 5 % in each record, averaged or not."""
    rng, noisy = np.random.default_rng(3), []
    for r, amplitude in zip(records().values(), (1.0, 20.0, 1.0), strict=True):
        read = {c: amplitude * x for c, x in r.channels.items() if c.startswith("floor") or c == "force_N"}
        sizes = {c: 0.05 * np.sqrt(np.mean(x**2)) for c, x in read.items()}
        noisy.append(r.with_channels({c: x + sizes[c] * rng.normal(size=r.n) for c, x in read.items()}))
    case = Case("frame", Path(), believed(), tuple(noisy[:2]), ())
    for block in (1, 4):
        rig = FrameRig(believed(), case.records, block)
        found = floors(Problem(rig), channel_noise(case, rig, block)[0], {}).reshape(2, -1)
        # A command that jumps is compared as logged.
        assert found == pytest.approx(np.outer((0.05 / np.sqrt(block), 0.05), np.ones(7)), rel=0.25)


def compared(model: Model, found: dict[str, Record]) -> tuple[Compared, ...]:
    """With a damper whose law is far off: it must not matter."""
    wrong = replace(model, parameters={**model.parameters, "alpha_a": 5 * model.parameters["alpha_a"]})
    case = case_of(wrong, found)
    parts = [Part(b.kind, b.place, b.noise, not b.clean) for b in blocks(case) if b.place is not None]
    assert model.structure is not None
    return compared_parts(model.structure, case.records, reduced(case)[1].catalogue, parts)


def clipping(found: dict[str, Record], floor: int) -> dict[str, Record]:
    name = f"floor{floor}_acceleration_m_s2"
    most = 0.5 * max(float(np.abs(r.channel(name)).max()) for r in found.values())
    return altered(found, lambda a: np.clip(a, -most, most), name)


def test_nothing_is_compared_where_all_is_in_balance() -> None:
    assert compared(believed(), records()) == ()


def test_an_accelerometer_and_the_displacements_are_told_apart() -> None:
    (one,) = compared(believed(), altered(records(), lambda a: 1.2 * a, "floor2_acceleration_m_s2"))
    assert one.cause == "sensor_gain@2"
    assert one.settings == pytest.approx({"sensor_gain_g@2": 1.2}, rel=0.02)
    shifted = altered(records(), late(5), *(f"floor{j}_displacement_m" for j in (1, 2, 3)))
    (one,) = compared(believed(), shifted)
    assert one.cause == "channel_shift"
    assert one.settings is not None
    expected = 5 * records()["off"].sample_time
    assert one.settings["channel_shift_d"] == pytest.approx(expected, rel=0.1)


@pytest.mark.slow
def test_numbers_of_the_structure_are_no_unknown_cause() -> None:
    believes = believed(True, stiffness=(4.5e5, 8.0e5, 6.84e5), mass=(98.3, 98.3, 110.0))
    (one,) = compared(believes, records())
    assert one.cause is None
    assert one.after < 2 * one.noise < one.before
    assert not one.unexplained


@pytest.mark.slow
def test_a_fault_outside_the_catalogue_changes_no_simulator() -> None:
    clipped = clipping(records(), 3)
    model = believed(False)
    off = {k: 1.3 * v if k.startswith("alpha") else v for k, v in model.parameters.items()}
    case = case_of(replace(model, parameters=off), clipped)
    found = diagnose(case)
    assert found.verdict == "unknown"
    assert found.gap.corrected == pytest.approx(found.gap.nominal)
    assert max(found.where.stages, key=lambda s: found.where.stages[s]) == "sensor"
    assert "accelerometer 3" in found.sentence
    assert "handed over unchanged" in found.sentence
    shown = page(found, case.model, case.records).html()
    assert "Look for the fault on the rig: floor3_displacement_m and floor3_acceleration_m_s2" in shown


@pytest.mark.slow
def test_a_simulator_with_effects_in_its_storeys_is_not_compared() -> None:
    """Their balances do not hold them: what `corrected.json` has would be found again."""
    model = believed(True, stiffness=(5.16e5, 8.0e5, 6.84e5))
    mended = replace(model, effects=(*model.effects, Effect("storey_stiffness", {"e": 6.84 / 8 - 1}, 2)))
    for known, count in ((model, 1), (mended, 0)):
        case = case_of(known, records())
        assert len(compared_without_law(case, reduced(case)[1], blocks(case))) == count


def test_the_force_sensor_is_told_from_the_storey_that_its_damper_stands_in() -> None:
    (one,) = compared(believed(), altered(records(), lambda f: 1.2 * f, "force_N"))
    assert one.cause == "sensor_gain"
    assert one.settings == pytest.approx({"sensor_gain_g": 1.2}, rel=0.03)


def test_floors_without_a_displacement_are_compared_by_their_accelerometers() -> None:
    """Storey 1 alone has its drift; a wrong stiffness there is still found."""
    fewer = without(records(), "floor2_displacement_m", "floor3_displacement_m")
    (one,) = compared(believed(True, stiffness=(6.0e5, 6.84e5, 6.84e5)), fewer)
    assert one.cause == "storey_stiffness@1"
    assert one.settings == pytest.approx({"storey_stiffness_e@1": 5.16 / 6 - 1}, rel=0.1)


@pytest.mark.parametrize(
    ("extra", "cause", "setting", "value"),
    [
        (lambda v: 20.0 * np.tanh(v / 2e-3), "joint_friction@1", "joint_friction_coulomb@1", 20.0),
        (lambda v: 3e4 * np.abs(v) * v, "storey_damping@1", "storey_damping_quadratic@1", 3e4),
    ],
)
def test_forces_of_a_storey_by_inverse_dynamics(
    extra: Callable[[np.ndarray], np.ndarray], cause: str, setting: str, value: float
) -> None:
    """One floor moved as prescribed; the ground that does it follows from Newton's law with the force in it."""
    m, k, c, dt = 100.0, 4e5, 200.0, 1e-3
    t = dt * np.arange(8000)
    rng = np.random.default_rng(3)
    x, v, a = (np.zeros(len(t)) for _ in range(3))
    for f in (1.3, 3.1, 5.7, 8.3):
        w, size, phase = 2 * np.pi * f, 8e-3 / f, rng.uniform(0, 6)
        x += size * np.sin(w * t + phase)
        v += size * w * np.cos(w * t + phase)
        a -= size * w**2 * np.sin(w * t + phase)
    absolute = -(k * x + c * v + extra(v)) / m
    channels = {
        "ground_acceleration_m_s2": absolute - a,
        "command": np.zeros(len(t)),
        "floor1_displacement_m": x + rng.normal(0, 1e-7, len(t)),
        "floor1_acceleration_m_s2": absolute,
        "force_N": np.zeros(len(t)),
    }
    s = ShearFrame(np.array([m]), np.array([k]), np.array([c]), (0, 1))
    record = Record("moved", None, dt, channels)
    terms = frame_terms(s, (record,), Sizes(100.0, 0.01, float(np.std(v)), 1.0, 1.0, 1.0, dt))
    parts = (Part("storey", 1, 2e-3, True), Part("accelerometer", 1, 2e-3, False))
    (one,) = compared_parts(s, (record,), terms, parts)
    assert one.cause == cause
    assert one.settings is not None
    assert one.settings[setting] == pytest.approx(value, rel=0.1)


@cache
def case() -> Case:
    true = case_of(believed(), records())
    own = identify("bingham", damper_alone(true).records, extras=("driver_lag",), starts=2, threads=1).model
    return case_of(replace(true.model, law=own.law, parameters=own.parameters, effects=own.effects), records())


@cache
def problem() -> Problem:
    return Problem(reduced(case())[1], coarse=True)


def fitted(problem: Problem, name: str) -> Fit:
    hypothesis = Hypothesis((), (next(t for t in problem.rig.terms if t.cause == name),))
    return fit(problem, hypothesis, hypothesis.start(), most=8)


def test_a_storeys_cause_of_a_frame_that_is_as_its_baseline() -> None:
    """The baseline is the case's own records: nothing has changed. floor: cost of the noise over the best fit's."""
    found = fitted(problem(), "floor_mass@1")
    judged = product((1e-6, 1.0), ((None, "effect"), (problem(), "none")))
    for floor, (baseline, verdict) in judged:
        search = Search(problem(), floor * found.cost, Limits())
        search.keep(found)
        search.own = search.nominal_cost if baseline else 0.0
        rig = search.problem.rig
        assert isinstance(rig, FrameRig)
        fits, decision = frame_run.judge(search, rig)
        decision = since_baseline(search, baseline, fits, decision)
        assert likely(search, decision, fits, {}).verdict == verdict
