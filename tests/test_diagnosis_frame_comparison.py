"""A frame's storeys and accelerometers compared without the damper's law, on records that SciPy integrated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from frame_case import altered, believed, case_of, records
from mrdamp.diagnosis.attribution.frame_blocks import blocks
from mrdamp.diagnosis.channels.comparison import Compared
from mrdamp.diagnosis.channels.frame_comparison import Part, compared_parts
from mrdamp.diagnosis.evidence.penalties import of_parts
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.frame_run import apart_from_the_law, reduced
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.run import diagnose
from mrdamp.model import Effect, Model
from mrdamp.records import Record


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


def test_nothing_is_compared_where_all_is_in_balance(measured: dict[str, Record]) -> None:
    assert compared(believed(), measured) == ()


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


def test_numbers_of_the_structure_are_no_unknown_cause(measured: dict[str, Record]) -> None:
    """Two stiffnesses and a mass that are off: no single effect, and nothing outside the catalogue."""
    believes = believed(True, stiffness=(4.5e5, 8.0e5, 6.84e5), mass=(98.3, 98.3, 110.0))
    (one,) = compared(believes, measured)
    assert one.cause is None
    assert one.after < 2 * one.noise < one.before
    assert not one.unexplained


def test_what_no_effect_explains_has_no_cause(measured: dict[str, Record]) -> None:
    """A clipped reading is none of the catalogue's."""
    name = "floor3_acceleration_m_s2"
    most = 0.5 * max(float(np.abs(r.channel(name)).max()) for r in measured.values())
    clipped = {
        k: r.with_channels({name: np.clip(np.asarray(r.channel(name)), -most, most)})
        for k, r in measured.items()
    }
    (one,) = compared(believed(), clipped)
    assert one.cause is None
    assert one.unexplained


def test_a_cause_in_a_part_that_is_in_balance_pays(measured: dict[str, Record]) -> None:
    case = case_of(believed(), measured)
    terms = {t.name: t for t in reduced(case)[1].catalogue}
    fit = Fit(Hypothesis((), (terms["storey_damping@1"],)), np.zeros(1), 1.0, np.zeros(1), np.zeros((1, 1)))
    assert of_parts(fit, {"storey 1", "accelerometer 2"}) > 0
    assert of_parts(fit, {"storey 2", "accelerometer 1"}) == 0


@pytest.mark.slow
def test_a_fault_outside_the_catalogue_changes_no_simulator(measured: dict[str, Record]) -> None:
    """A clipped accelerometer beside a damper whose law is off: neither is mended by something else."""
    name = "floor3_acceleration_m_s2"
    most = 0.5 * max(float(np.abs(r.channel(name)).max()) for r in measured.values())
    clipped = {
        k: r.with_channels({name: np.clip(np.asarray(r.channel(name)), -most, most)})
        for k, r in measured.items()
    }
    model = believed(False)
    off = {k: 1.3 * v if k.startswith("alpha") else v for k, v in model.parameters.items()}
    found = diagnose(case_of(replace(model, parameters=off), clipped))
    assert found.verdict == "unknown"
    assert found.gap.corrected == pytest.approx(found.gap.nominal)
    assert max(found.where.stages, key=lambda s: found.where.stages[s]) == "sensor"
    assert "accelerometer 3" in found.sentence
    assert "handed over unchanged" in found.sentence


def test_a_simulator_with_effects_in_its_storeys_is_not_compared(measured: dict[str, Record]) -> None:
    """Their balances do not hold them: what `corrected.json` has would be found again."""
    model = believed(True, stiffness=(5.16e5, 8.0e5, 6.84e5))
    mended = replace(model, effects=(*model.effects, Effect("storey_stiffness", {"e": 6.84 / 8 - 1}, 2)))
    for known, count in ((model, 1), (mended, 0)):
        case = case_of(known, measured)
        assert len(apart_from_the_law(case, reduced(case)[1], blocks(case))) == count
