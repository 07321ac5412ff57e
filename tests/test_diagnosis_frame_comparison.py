"""A frame's storeys and accelerometers compared without the damper's law, on records that SciPy integrated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from frame_case import altered, believed, case_of, records
from mrdamp.diagnosis.attribution.frame_blocks import blocks
from mrdamp.diagnosis.channels.comparison import Compared
from mrdamp.diagnosis.channels.frame_comparison import Part, compared_parts
from mrdamp.diagnosis.frame_run import compared_without_law, reduced
from mrdamp.diagnosis.hypotheses.frame_effects import frame_terms
from mrdamp.diagnosis.hypotheses.terms import Sizes
from mrdamp.diagnosis.report.page import page
from mrdamp.diagnosis.run import diagnose
from mrdamp.model import Effect, Model
from mrdamp.records import Record
from mrdamp.structures import ShearFrame


@pytest.fixture(scope="module")
def measured() -> dict[str, Record]:
    return records()


def compared(model: Model, found: dict[str, Record]) -> tuple[Compared, ...]:
    """With a damper whose law is far off: it must not matter."""
    wrong = replace(model, parameters={**model.parameters, "alpha_a": 5 * model.parameters["alpha_a"]})
    case = case_of(wrong, found)
    parts = [Part(b.kind, b.place, b.noise, not b.clean) for b in blocks(case) if b.place is not None]
    assert model.structure is not None
    return compared_parts(model.structure, case.records, reduced(case)[1].catalogue, parts)


def clipping(found: dict[str, Record], floor: int) -> dict[str, Record]:
    """The records with a floor's accelerometer clipped at half of its largest reading."""
    name = f"floor{floor}_acceleration_m_s2"
    most = 0.5 * max(float(np.abs(r.channel(name)).max()) for r in found.values())
    return {
        k: r.with_channels({name: np.clip(np.asarray(r.channel(name)), -most, most)}) for k, r in found.items()
    }


def test_nothing_is_compared_where_all_is_in_balance(measured: dict[str, Record]) -> None:
    assert compared(believed(), measured) == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "cause", "setting", "value"),
    [
        ({"stiffness": (5.16e5, 8.0e5, 6.84e5)}, "storey_stiffness@2", "storey_stiffness_e@2", 6.84 / 8 - 1),
        ({"damping": (125.0, 50.0, 800.0)}, "storey_damping@3", "storey_damping_e@3", 50 / 800 - 1),
        ({"mass": (98.3, 110.0, 98.3)}, "floor_mass@2", "floor_mass_dm@2", 98.3 - 110),
    ],
)
def test_a_wrong_storey_is_named_whatever_the_damper(
    measured: dict[str, Record],
    change: dict[str, tuple[float, float, float]],
    cause: str,
    setting: str,
    value: float,
) -> None:
    (one,) = compared(believed(True, **change), measured)
    assert one.cause == cause
    assert one.settings is not None
    assert one.settings[setting] == pytest.approx(value, rel=0.1)
    assert one.nats > 5
    assert not one.unexplained


def test_an_accelerometer_and_the_displacements_are_told_apart(measured: dict[str, Record]) -> None:
    (one,) = compared(believed(), altered(measured, "floor2_acceleration_m_s2", 1.2))
    assert one.cause == "sensor_gain@2"
    assert one.settings == pytest.approx({"sensor_gain_g@2": 1.2}, rel=0.02)
    late = 5  # samples
    shifted = {
        k: r.with_channels(
            {
                name: np.concatenate([np.zeros(late), np.asarray(r.channel(name))[:-late]])
                for name in (f"floor{j}_displacement_m" for j in (1, 2, 3))
            }
        )
        for k, r in measured.items()
    }
    (one,) = compared(believed(), shifted)
    assert one.cause == "channel_shift"
    assert one.settings is not None
    expected = late * measured["off"].sample_time
    assert one.settings["channel_shift_d"] == pytest.approx(expected, rel=0.1)


@pytest.mark.slow
def test_numbers_of_the_structure_are_no_unknown_cause(measured: dict[str, Record]) -> None:
    """Two stiffnesses and a mass that are off: no single effect, and nothing outside the catalogue."""
    believes = believed(True, stiffness=(4.5e5, 8.0e5, 6.84e5), mass=(98.3, 98.3, 110.0))
    (one,) = compared(believes, measured)
    assert one.cause is None
    assert one.after < 2 * one.noise < one.before
    assert not one.unexplained


@pytest.mark.slow
def test_a_fault_outside_the_catalogue_changes_no_simulator(measured: dict[str, Record]) -> None:
    """A clipped accelerometer beside a damper whose law is off: neither is mended by something else."""
    clipped = clipping(measured, 3)
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
def test_a_simulator_with_effects_in_its_storeys_is_not_compared(measured: dict[str, Record]) -> None:
    """Their balances do not hold them: what `corrected.json` has would be found again."""
    model = believed(True, stiffness=(5.16e5, 8.0e5, 6.84e5))
    mended = replace(model, effects=(*model.effects, Effect("storey_stiffness", {"e": 6.84 / 8 - 1}, 2)))
    for known, count in ((model, 1), (mended, 0)):
        case = case_of(known, measured)
        assert len(compared_without_law(case, reduced(case)[1], blocks(case))) == count


def test_the_force_sensor_is_told_from_the_storey_that_its_damper_stands_in(measured: dict[str, Record]) -> None:
    (one,) = compared(believed(), altered(measured, "force_N", 1.2))
    assert one.cause == "sensor_gain"
    assert one.settings == pytest.approx({"sensor_gain_g": 1.2}, rel=0.03)


def test_floors_without_a_displacement_are_compared_by_their_accelerometers(measured: dict[str, Record]) -> None:
    """Storey 1 alone has its drift; a wrong stiffness there is still found."""
    gone = {"floor2_displacement_m", "floor3_displacement_m"}
    fewer = {
        k: Record(r.name, None, r.sample_time, {c: v for c, v in r.channels.items() if c not in gone})
        for k, r in measured.items()
    }
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
