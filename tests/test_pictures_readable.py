"""Pictures can be read: no text over another, none cut off, colours that stand out, scales with plain numbers."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from matplotlib.figure import Figure

from mrdamp import pictures
from mrdamp.pictures import style
from mrdamp.pictures.compare import Bar, ranking, search_paths, share_ranking
from mrdamp.pictures.diagnosis import probabilities
from refusals import refuses
from studies.blindtest.pictures import shrinking
from test_pictures import LONG, TIME, loop, runs, texts


def readable(fig: Figure) -> None:
    """No text leaves the picture, none lies over another, and all of it is at least 8.5 points high."""
    found = texts(fig)
    assert found
    width, height = (72 * inch for inch in fig.get_size_inches())
    assert width == pytest.approx(374)
    for text, box in found:
        name = text.get_text()
        assert float(text.get_fontsize()) >= 8.5, name
        assert box.x0 > -0.5, name
        assert box.y0 > -0.5, name
        assert box.x1 < width + 0.5, name
        assert box.y1 < height + 0.5, name
    for k, (text, box) in enumerate(found):
        for other, second in found[k + 1 :]:
            across = min(box.x1, second.x1) - max(box.x0, second.x0)
            along = min(box.y1, second.y1) - max(box.y0, second.y0)
            assert across < 0.5 or along < 0.5, f"{text.get_text()!r} lies over {other.get_text()!r}"


def _luminance(colour: str) -> float:
    """Relative luminance of WCAG 2, 0 to 1."""
    parts = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


# --- legible, in every number ----------------------------------------------------------------
def test_pictures_of_records_are_readable() -> None:
    names = ("one", LONG, "triangle_2.5Hz_2.5mm_random_current")
    records = [loop(name, scale=0.2 + 3 * k, note="held out, error 0.123") for k, name in enumerate(names)]
    readable(pictures.loops(records))
    readable(pictures.histories(records))


@pytest.mark.parametrize("count", [1, 30])
def test_error_bars_are_readable(count: int) -> None:
    names = [LONG if k % 3 == 1 else f"test_{k}" for k in range(count)]
    errors = np.linspace(0.04, 0.9, count)
    readable(pictures.error_bars(names, errors.tolist(), [k % 2 == 0 for k in range(count)]))
    marks = {"hyperbolic tangent, quick fit": 0.14, "modified Bouc-Wen": 0.12}
    readable(pictures.error_bars(names, errors.tolist(), [True] * count, marks))


@pytest.mark.parametrize(("storeys", "count"), [(1, 1), (3, 6)])
def test_pictures_of_frames_are_readable(storeys: int, count: int) -> None:
    drift, criteria = runs(storeys, count)
    readable(pictures.drifts(TIME, drift))
    readable(pictures.controllers(criteria))
    readable(pictures.profile(criteria, ground_peak=3.0))
    force = {name: 1e4 * values[:, 0] for name, values in drift.items()}
    readable(pictures.command_history(TIME, {name: 0 * f for name, f in force.items()}, force))


def test_names_are_written_as_they_are() -> None:
    name = "$x_1$ {y} \\alpha"
    for fig in (pictures.loops([loop(name)]), pictures.error_bars([name], [0.1], [True])):
        written = [text for text, _ in texts(fig) if text.get_text() == name]
        assert len(written) == 1
        assert not written[0].get_parse_math()


def test_colours_stand_out_from_the_page() -> None:
    for light, dark in style.DARK.items():
        if light == style.GRID:
            continue
        least = 4.5 if light in (style.INK, style.MUTED) else 3.0
        assert 1.05 / (_luminance(light) + 0.05) >= least, light
        assert (_luminance(dark) + 0.05) / (_luminance("#14181d") + 0.05) >= least, dark
    assert len(set(style.COLOURS)) == len(style.DASHES) == len(style.MARKERS) == 6


# --- scales
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
    bars = [Bar(name, 0.0, 0.0, 0.0, np.zeros(1)) for name in ("passive-off", "passive-on")]
    assert ranking({"switching": bars}).axes[0].get_xlim()[1] > 0


@pytest.mark.parametrize(("count", "told"), [(7, "1 other"), (9, "3 others")])
def test_the_rest_is_counted(count: int, told: str) -> None:
    labels = written(probabilities({f"cause_{k}": 1 / count for k in range(count)}), "yaxis")
    assert told in labels


def test_shares_are_drawn_from_minus_one_to_the_bound() -> None:
    nan = float("nan")
    rows = [
        Bar("worse", -3.0, -4.0, 0.5, np.array([-5.0, nan, 0.2])),
        Bar("none", nan, nan, nan, np.array([nan])),
        Bar("half", 0.5, 0.4, 0.6, np.array([0.5]), marked=True),
    ]
    fig = share_ranking({"clairvoyant": rows, "clairvoyant-drift": rows})
    ax = fig.axes[0]
    dots = [line for line in ax.get_lines() if line.get_marker() == "o"]
    assert [line.get_xdata()[0] for line in dots] == [-1.0, 0.5]  # type: ignore[index]
    low, high = ax.get_xlim()
    assert low < -1
    assert high > 1
    assert [a.get_title(loc="left") for a in fig.axes[:2]] == ["clairvoyant", "drift"]
    refuses(lambda: share_ranking({"clairvoyant": []}), "nothing to show")
    refuses(lambda: search_paths({"clairvoyant": {}}), "nothing to show")
