"""A frame's storeys and accelerometers without the damper's law, and other laws of its damper, on records of SciPy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest

from frame_case import altered, believed, case_of, late, records, without
from mrdamp.diagnosis import frame_run
from mrdamp.diagnosis.attribution.frame_blocks import blocks
from mrdamp.diagnosis.attribution.frame_damper import damper_alone
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.channels.comparison import Compared
from mrdamp.diagnosis.channels.frame_comparison import Part, compared_parts
from mrdamp.diagnosis.evidence.changed import since_baseline
from mrdamp.diagnosis.evidence.judgement import likely
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.frame_run import compared_without_law, reduced
from mrdamp.diagnosis.hypotheses.frame_effects import frame_terms
from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Sizes
from mrdamp.diagnosis.problem.frame import FrameRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.report.page import page
from mrdamp.diagnosis.run import diagnose
from mrdamp.identify import identify
from mrdamp.model import Effect, Model
from mrdamp.records import Record
from mrdamp.structures import ShearFrame


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
