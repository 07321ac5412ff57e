"""What a diagnosis says of parameters, ties and probabilities, and what its pictures show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mrdamp.diagnosis.attribution.shares import Measured
from mrdamp.diagnosis.report.changes import Change, changes, unit_of
from mrdamp.diagnosis.report.result import Candidate, Diagnosis, Gap, Named, Step, Where
from mrdamp.diagnosis.report.sentence import number, sentence, table
from mrdamp.errors import InputError
from mrdamp.model import Effect, Model
from mrdamp.pictures.diagnosis import (
    ResidualData,
    added,
    by_regime,
    gap_map,
    loops,
    residuals,
    waterfall,
)
from mrdamp.structures import dyke1996

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


@pytest.mark.parametrize(
    ("name", "unit"),
    [("c0b", "N s/m per A or V"), ("n", ""), ("floor_mass_dm@1", "kg"), ("joint_friction_coulomb@2", "N"),
     ("sensor_offset_f@1", "m/s2"), ("sensor_offset_f", "N"), ("nothing", "")],
)  # fmt: skip
def test_units(name: str, unit: str) -> None:
    assert unit_of(name) == unit


def test_a_narrow_interval_has_as_many_digits_as_it_takes() -> None:
    assert number("e", -0.149998, (-0.150004, -0.149993)) == "e = -0.149998 (-0.150004 to -0.149993)"
    assert number("tau", 0.0120349, (0.0101, 0.0139), "s") == "tau = 0.01203 s (0.0101 to 0.0139)"
    assert number("g", 1.1, (1.1, 1.1)) == "g = 1.1 (1.1 to 1.1)"


def test_the_headline_has_ties_with_their_probabilities() -> None:
    said = sentence(found())
    assert "driver_lag (the coil current lags the command; probability 0.60)" in said
    assert "do not distinguish it from saturation (probability 0.30). Nearly the same as it: sensor_lag" in said
    assert "from 20.0 % to 10.0 %, 12.0 % on records left out of the fit; noise 1.0 %." in said
    assert "agrees with the rig (probability 0.97)" in sentence(found(verdict="none", effects=()))
    hidden = found(verdict="none", effects=(), unseen=({"effect": "backlash"}, {"effect": "saturation"}))
    assert sentence(hidden).endswith("These records hardly show backlash, saturation.")
    # A fit of a smoothed motion leaves less than its file predicts of the motion as it is.
    noisy = found(gap=Gap(0.2, 0.2, 0.15, 0.01, (0.09, 0.11), left_out=0.08))
    assert "8.0 % on records left out of the fit with the noise of the motion smoothed away" in sentence(noisy)
    few = sentence(found(covered=(2, 8)))
    assert few.endswith("This is said of 2 of 8 records; the others leave the regimes of the baseline.")
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
    assert "The best correction leaves 10.0 %, 12.0 % on records left out of the fit." in sentence(unknown)
    rival = {"what": "an end stop", "gap": 0.1, "nearest_gap": 0.15}
    outside = replace(unknown, outside=rival)
    assert sentence(outside).endswith("A cause outside the catalogue has probability 0.80.")


def test_no_part_of_the_chain_is_blamed_where_nothing_has_changed() -> None:
    where = Where({"driver": 1.0}, measured=(Measured("command to force_N", ("driver",), 1.0, (0.99, 1.01), ""),))
    assert "of the nominal gap" in table(found(where=where))
    assert "100 %" not in table(found(where=where, verdict="none", effects=()))


@pytest.mark.parametrize(
    ("names", "labels"),
    [
        (["nominal", "recalibrated", "+ a", "+ a + b"], ["nominal", "recalibrated", "+ a", "+ b"]),
        (["nominal", "+ a + b"], ["nominal", "+ a + b"]),  # a alone was not fitted
        (["nominal", "+ a", "+ ab + c"], ["nominal", "+ a", "+ ab + c"]),
        (["nominal"], ["nominal"]),
    ],
)
def test_a_bar_is_labelled_by_what_it_adds(names: list[str], labels: list[str]) -> None:
    assert added(names) == labels
    ax = waterfall([(name, 0.1, (0.08, 0.12)) for name in names], 0.01).axes[0]
    assert [t.get_text() for t in ax.get_yticklabels()] == labels


def test_a_bar_at_another_figure_keeps_its_interval_in_proportion() -> None:
    assert Step("nominal", 0.2, (0.15, 0.3)).at(0.1) == Step("nominal", 0.1, (0.075, 0.15))


def test_a_bar_off_the_scale_is_cut() -> None:
    """Free parameters of 56 000 % leave the other bars to be read."""
    steps = [("nominal", 0.2, (0.18, 0.22)), ("recalibrated", 560.0, (260.0, 790.0)), ("+ a", 0.1, (0.09, 0.11))]
    ax = waterfall(steps, 0.01).axes[0]
    ends = [p.get_path().get_extents(p.get_patch_transform()).x1 for p in ax.patches]
    assert ends == pytest.approx([20.0, 40.0, 10.0])
    assert [t.get_text() for t in ax.texts] == ["20 %", "more than 40 %", "10 %"]
    assert ax.get_xlim()[1] < 60


def record(displacement: bool = True) -> ResidualData:
    t = np.arange(0.0, 4.0, 1e-3)
    x, v = 0.01 * np.sin(2 * np.pi * t), 0.02 * np.pi * np.cos(2 * np.pi * t)
    f = 1000 * v
    return ResidualData("r", t, v, 0 * t, f, 1.5 * f, 1.05 * f, displacement=x if displacement else None)


def test_residuals_before_and_after_stand_on_one_scale() -> None:
    before, after = residuals([record()]).axes
    assert before.get_ylim() == after.get_ylim()
    size = [np.abs(ax.lines[-1].get_ydata()).max() for ax in (before, after)]
    assert size[0] == pytest.approx(10 * size[1], rel=0.02)


def test_a_simulator_that_was_not_changed_is_drawn_once() -> None:
    same = replace(record(), corrected=record().nominal)
    assert len(residuals([same]).axes) == 1
    assert [len(ax.lines) for ax in loops(same).axes] == [2, 2]
    assert [ax.get_title(loc="left") for ax in gap_map([same]).axes if ax.get_title(loc="left")] == ["nominal"]


def test_loops_show_measured_nominal_and_corrected() -> None:
    for ax in loops(record()).axes:
        measured, nominal, corrected = (np.ptp(line.get_ydata()) for line in ax.lines)
        assert nominal / measured == pytest.approx(1.5, rel=1e-6)
        assert corrected / measured == pytest.approx(1.05, rel=1e-6)
    with pytest.raises(InputError, match="displacement"):
        loops(record(displacement=False))


def test_a_parameter_by_regime_has_a_row_each_and_the_value_of_all_records() -> None:
    rows = [("slow", 1.0, (0.9, 1.1)), ("fast", 6.0, (5.0, 7.0))]
    (ax,) = by_regime("driver_lag tau", rows, (1.2, (1.1, 1.3))).axes
    assert [t.get_text() for t in ax.get_yticklabels()] == ["slow", "fast"]
    assert ax.get_xscale() == "log"
    (points,) = [line for line in ax.lines if line.get_marker() == "o"]
    np.testing.assert_array_equal(points.get_xdata(), [1.0, 6.0])
    (near,) = by_regime("gain", [("slow", -1.0, (-2.0, 1.0))], (1.2, None)).axes
    assert near.get_xscale() == "linear"
    with pytest.raises(InputError):
        by_regime("gain", [], (1.0, None))
