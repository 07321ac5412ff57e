"""Scales of pictures: plain numbers on a logarithmic one, and bars that are all zero."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from matplotlib.figure import Figure

from mrdamp.pictures.blindtest import shrinking
from mrdamp.pictures.compare import Bar, ranking
from mrdamp.pictures.diagnosis import probabilities


def written(fig: Figure, axis: str) -> list[str]:
    """Labels of the first axes' ticks within its limits."""
    fig.draw_without_rendering()
    ax = getattr(fig.axes[0], axis)
    low, high = sorted(ax.get_view_interval())
    return [t.label1.get_text() for t in ax.get_major_ticks() if low <= t.get_loc() <= high]


@pytest.mark.parametrize("low", [1e-4, 1e-2, 0.1])
def test_a_logarithmic_axis_has_plain_numbers(low: float) -> None:
    before = np.geomspace(10 * low, 0.9, 12)
    labels = written(shrinking(list(before), list(0.1 * before), [True] * 12), "yaxis")
    assert len(labels) >= 3
    values = [float(label) for label in labels]  # and no formula
    assert all(0 < a < b <= 100 for a, b in itertools.pairwise(values))


def test_controllers_that_all_have_zero() -> None:
    bars = [Bar(name, 0.0, 0.0, 0.0, 0.0, False) for name in ("passive-off", "passive-on")]
    assert ranking({"switching": bars}).axes[0].get_xlim()[1] > 0


@pytest.mark.parametrize(("count", "told"), [(7, "1 other"), (9, "3 others")])
def test_the_rest_is_counted(count: int, told: str) -> None:
    labels = written(probabilities({f"cause_{k}": 1 / count for k in range(count)}), "yaxis")
    assert told in labels
