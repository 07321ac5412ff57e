"""What the pictures of a diagnosis say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.patches import FancyBboxPatch

from mrdamp.errors import InputError
from mrdamp.pictures.diagnosis import (
    ResidualData,
    added,
    by_regime,
    chain,
    gap_map,
    loops,
    residuals,
    waterfall,
)


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


def test_the_stage_of_a_named_cause_is_lit_and_no_other() -> None:
    shares = {"driver": 0.1, "magnetics": 0.7, "sensor": 0.2}
    ax = chain(shares, named=["magnetics"]).axes[0]
    boxes = [p for p in ax.patches if isinstance(p, FancyBboxPatch)]
    labels = [t for t in ax.texts if t.get_text() in shares]
    assert [t.get_text() for t in labels] == list(shares)
    assert [to_rgba(b.get_facecolor())[3] for b in boxes] == [0.0, 1.0, 0.0]
    assert [t.get_fontweight() for t in labels] == ["normal", "bold", "normal"]


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
