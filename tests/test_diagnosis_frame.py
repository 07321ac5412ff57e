"""A frame's diagnosis on records that SciPy integrated: a fault in simulator or sensor, few channels, a soft base."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from frame_case import DT, LAW, altered, believed, case_of, late, records
from modules import CASES, needs
from mrdamp.diagnosis.attribution.frame_blocks import blocks, place_shares
from mrdamp.diagnosis.case.folder import Case, read_case
from mrdamp.diagnosis.evidence.structure_numbers import deviations, promoted
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.frame_run import LIMITS, reduced
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.frame import FrameRig
from mrdamp.diagnosis.problem.noise import channel_noise, floors
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.run import diagnose
from mrdamp.model import Effect, Model
from mrdamp.simulation.predict import predict

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
