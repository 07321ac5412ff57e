"""Pictures can be read: no text over another, none cut off, colours that stand out."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
import pytest
from matplotlib.figure import Figure

from mrdamp import pictures
from mrdamp.pictures import style
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
@pytest.mark.parametrize("names", [["sine"], ["one", LONG, "triangle_2.5Hz_2.5mm_random_current"]])
def test_pictures_of_records_are_readable(names: Sequence[str]) -> None:
    records = [loop(name, scale=0.2 + 3 * k, note="held out, error 0.123") for k, name in enumerate(names)]
    readable(pictures.loops(records))
    readable(pictures.histories(records))


@pytest.mark.parametrize("count", [1, 2, 17, 47])
def test_error_bars_are_readable(count: int) -> None:
    names = [LONG if k % 3 == 1 else f"test_{k}" for k in range(count)]
    errors = np.linspace(0.04, 0.9, count)
    readable(pictures.error_bars(names, errors.tolist(), [k % 2 == 0 for k in range(count)]))
    marks = {"hyperbolic tangent, quick fit": 0.14, "modified Bouc-Wen": 0.12}
    readable(pictures.error_bars(names, errors.tolist(), [True] * count, marks))


@pytest.mark.parametrize(("storeys", "count"), [(1, 1), (1, 2), (3, 4), (10, 6)])
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


def test_a_picture_stays_as_it_is_when_it_is_drawn_again() -> None:
    fig = pictures.error_bars(["a", "b"], [0.1, 0.2], [True, False])
    places = []
    for _ in range(3):
        fig.savefig(io.BytesIO(), format="svg")
        places.append(fig.axes[0].get_position().bounds)
    np.testing.assert_allclose(places[2], places[0], atol=0.01)


def test_colours_stand_out_from_the_page() -> None:
    for light, dark in style.DARK.items():
        if light == style.GRID:
            continue
        least = 4.5 if light in (style.INK, style.MUTED) else 3.0
        assert 1.05 / (_luminance(light) + 0.05) >= least, light
        assert (_luminance(dark) + 0.05) / (_luminance("#14181d") + 0.05) >= least, dark
    assert len(set(style.COLOURS)) == len(style.DASHES) == len(style.MARKERS) == 6
