"""Scales of pictures: plain numbers on a logarithmic one, and bars that are all zero."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from matplotlib.figure import Figure

from mrdamp.errors import InputError
from mrdamp.pictures.bound import Share, search_paths, shares
from mrdamp.pictures.compare import Bar, ranking
from mrdamp.pictures.diagnosis import probabilities
from studies.blindtest.pictures import shrinking


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


def test_shares_are_drawn_from_minus_one_to_the_bound() -> None:
    nan = float("nan")
    rows = [
        Share("worse", -3.0, -4.0, 0.5, np.array([-5.0, nan, 0.2])),
        Share("none", nan, nan, nan, np.array([nan])),
        Share("half", 0.5, 0.4, 0.6, np.array([0.5]), marked=True),
    ]
    fig = shares({"clairvoyant": rows, "clairvoyant-drift": rows})
    ax = fig.axes[0]
    dots = [line for line in ax.get_lines() if line.get_marker() == "o"]
    assert [line.get_xdata()[0] for line in dots] == [-1.0, 0.5]  # type: ignore[index]
    low, high = ax.get_xlim()
    assert low < -1
    assert high > 1
    assert [a.get_title(loc="left") for a in fig.axes[:2]] == ["clairvoyant", "drift"]
    with pytest.raises(InputError, match="nothing to show"):
        shares({"clairvoyant": []})
    with pytest.raises(InputError, match="nothing to show"):
        search_paths({"clairvoyant": {}})
