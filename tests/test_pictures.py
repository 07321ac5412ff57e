"""Pictures: the numbers that are drawn, in the unit on the axis; text that can be read, colours that stand out."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import FillBetweenPolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle, StepPatch
from matplotlib.text import Text
from matplotlib.transforms import Affine2D, Bbox

from mrdamp import pictures
from mrdamp.pictures import LoopData, style
from mrdamp.pictures.compare import Bar, search_paths, share_ranking
from mrdamp.pictures.damper import overview
from mrdamp.simulation.criteria import Criteria, evaluate
from mrdamp.structures import ShearFrame
from refusals import refuses

LONG = "a_record_with_a_name_that_goes_on_and_on_for_no_reason_at_all_2.5Hz_10.0mm"
TIME = np.arange(0.0, 4.0, 0.002)
CONTROLLERS = ("uncontrolled", "passive-off", "best constant 0.75 V", "passive-on", "clipped-optimal", LONG)


def loop(name: str = "sine_2.5Hz_5mm", scale: float = 1.0, **changes: Any) -> LoopData:
    """5 mm (times scale) at 2.5 Hz, 1000 N, simulated 10 % too small."""
    w = 2 * np.pi * 2.5
    x, v = 5e-3 * scale * np.sin(w * TIME), 5e-3 * scale * w * np.cos(w * TIME)
    force = 1000.0 * np.tanh(60 * v / scale)
    given = {"displacement": x, "velocity": v, "measured": force, "simulated": 0.9 * force}
    return LoopData(name, **{"time": TIME, "command": np.ones_like(x), **given, **changes})


def runs(storeys: int, count: int) -> tuple[dict[str, np.ndarray], dict[str, Criteria]]:
    """Storey j of controller k drifts by 0.01 (N - j) / (1 + k) m."""
    frame = ShearFrame(np.full(storeys, 1e3), np.full(storeys, 1e6), np.full(storeys, 1e3))
    wave = np.sin(12 * TIME) * np.exp(-((TIME - 2) ** 2))
    wave /= np.abs(wave).max()
    drift, criteria = {}, {}
    for k, name in enumerate(CONTROLLERS[:count]):
        drift[name] = np.column_stack([0.01 * (storeys - j) / (1 + k) * wave for j in range(storeys)])
        acceleration = 50 * np.cumsum(drift[name], axis=1) * (1 + k) ** 0.5
        damper = {"force": 2000.0 * k * wave, "command": np.where(wave > 0, 0.5 * k, 0.0)} if k else {}
        criteria[name] = evaluate(frame, TIME, drift[name], acceleration, **damper)
    return drift, criteria


def one_run(storeys: int) -> Criteria:
    return runs(storeys, 1)[1]["uncontrolled"]


def lines(ax: Axes) -> list[np.ndarray]:
    """(n, 2) points of each line that is more than two points long."""
    return [np.asarray(line.get_xydata()) for line in ax.lines if len(np.atleast_1d(line.get_xdata())) > 2]


def bars(ax: Axes) -> list[float]:
    return [p.get_width() for p in ax.patches if isinstance(p, Rectangle) and p.get_height() > 0.5]


def texts(fig: Figure) -> list[tuple[Text, Bbox]]:
    """What is written and where, in points, after the layout."""
    fig.set_dpi(4 * 72)
    fig.draw_without_rendering()
    scale = Affine2D().scale(0.25)
    hidden = {label for ax in fig.axes for axis in (ax.xaxis, ax.yaxis) for label in _not_drawn(axis)}
    found = [artist for artist in fig.findobj(Text) if isinstance(artist, Text) and artist not in hidden]
    shown = [text for text in found if text.get_visible() and text.get_text().strip()]
    return [(text, text.get_window_extent().transformed(scale)) for text in shown]


def _not_drawn(axis: Axis) -> list[Text]:
    """Labels of ticks beyond the limits, which an axis keeps and does not draw."""
    low, high = sorted(axis.get_view_interval())
    slack = 1e-9 * (high - low)
    beyond = (t for t in (*axis.majorTicks, *axis.minorTicks) if not low - slack <= t.get_loc() <= high + slack)
    return [label for t in beyond for label in (t.label1, t.label2)]


# --- a damper --------------------------------------------------------------------------------
def test_loops_show_force_over_displacement_and_velocity() -> None:
    fig = pictures.loops([loop()])
    left, right = fig.axes
    assert left.get_xlabel() == "displacement, mm"
    assert right.get_xlabel() == "velocity, mm/s"
    assert left.get_ylabel() == "force, N"
    for ax, peak in ((left, 5.0), (right, 5.0 * 2 * np.pi * 2.5)):
        simulated, measured = lines(ax)
        np.testing.assert_allclose(np.abs(measured[:, 0]).max(), peak, rtol=1e-3)
        np.testing.assert_allclose(np.abs(measured[:, 1]).max(), 1000 * np.tanh(60 * 0.0785398), rtol=1e-3)
        np.testing.assert_allclose(simulated[:, 1], 0.9 * measured[:, 1])
    simulated_line, measured_line = left.lines
    assert measured_line.get_color() == style.INK
    assert measured_line.get_linewidth() < 1 < simulated_line.get_linewidth()


def test_units_follow_the_size() -> None:
    big = loop(measured=2e5 * np.sin(TIME), displacement=0.3 * np.sin(TIME), velocity=2 * np.cos(TIME))
    left, right = pictures.loops([big]).axes
    assert (left.get_xlabel(), left.get_ylabel()) == ("displacement, cm", "force, kN")
    assert right.get_xlabel() == "velocity, m/s"
    measured = lines(left)[1]
    assert np.abs(measured[:, 0]).max() == pytest.approx(30, rel=1e-2)
    assert np.abs(measured[:, 1]).max() == pytest.approx(200, rel=1e-2)
    assert np.abs(lines(right)[1][:, 0]).max() == pytest.approx(2, rel=1e-2)


def test_the_window_is_where_the_piston_moves_fastest_and_not_furthest() -> None:
    slow, fast = 20e-3 * np.sin(2 * np.pi * TIME), 5e-3 * np.sin(2 * np.pi * 10 * TIME)
    x = np.where(TIME < 2.0, slow, fast)
    both = loop(displacement=x, velocity=np.gradient(x, TIME))
    force, error = pictures.histories([both], periods=2).axes
    assert force.get_xlim()[0] >= 1.9
    assert np.ptp(pictures.histories([loop()], periods=2).axes[0].get_xlim()) == pytest.approx(0.8, abs=0.05)
    assert error.get_xlim() == force.get_xlim()
    assert np.abs(lines(pictures.loops([both], periods=2).axes[0])[1][:, 0]).max() < 6


def test_the_error_is_measured_less_simulated_on_the_same_scale() -> None:
    offset = loop(simulated=loop().measured - 120.0)
    fig = pictures.histories([offset])
    fig.savefig(io.BytesIO(), format="svg")
    force, error = fig.axes
    for line in lines(error):
        np.testing.assert_allclose(line[:, 1], 120.0)
    scales = [np.ptp(ax.get_ylim()) / ax.get_position().height for ax in (force, error)]
    assert scales[1] == pytest.approx(scales[0], rel=0.03)


def test_a_command_that_changes_is_drawn() -> None:
    assert len(pictures.histories([loop()]).axes) == 2
    switched = loop(command=np.where(np.sin(9 * TIME) > 0, 2.0, 0.0), command_unit="V")
    fig = pictures.histories([switched])
    assert len(fig.axes) == 3
    assert fig.axes[2].get_ylabel() == "V"
    assert set(np.unique(lines(fig.axes[2])[0][:, 1])) == {0.0, 2.0}
    assert len(overview([switched]).axes) == 3


def test_an_overview_is_of_the_six_largest_forces_in_their_order() -> None:
    """Of seven, the third is the smallest."""
    sizes = (5, 6, 1, 4, 3, 2, 7)
    fig = overview([loop(str(n), measured=n * TIME, simulated=n * TIME) for n in sizes])
    assert [ax.get_title("left") for ax in fig.axes[::2]] == [str(n) for n in sizes if n > 1]


def test_error_bars_put_the_held_out_first() -> None:
    names, errors = ["a", "b", "a", "d"], [0.1, 0.2, 0.3, 0.4]  # two records of one name are two bars
    fig = pictures.error_bars(names, errors, [False, True, False, True], {"mark": 0.25})
    ax = fig.axes[0]
    assert [text.get_text() for text in ax.get_yticklabels()] == ["b", "d", "a", "a"]
    np.testing.assert_allclose(bars(ax), [0.2, 0.4, 0.1, 0.3])
    drawn = [to_hex(p.get_facecolor()) for p in ax.patches]
    assert drawn == [style.COLOURS[0]] * 2 + [style.REFERENCE] * 2
    place = [p.get_y() for p in ax.patches if isinstance(p, Rectangle)]
    assert place == sorted(place)
    assert ax.yaxis_inverted()
    assert [text.get_text() for text in fig.axes[1].get_yticklabels()] == ["0.200", "0.400", "0.100", "0.300"]
    assert list(np.asarray(ax.lines[0].get_xdata())) == [0.25, 0.25]
    assert "mark 0.25" in [text.get_text() for text, _ in texts(fig)]


def test_a_very_long_bar_is_cut_and_says_its_value() -> None:
    fig = pictures.error_bars([f"r{k}" for k in range(10)], [0.1] * 9 + [12.3], [True] * 10)
    ax, values = fig.axes
    assert max(bars(ax)) < 0.3
    assert values.get_yticklabels()[9].get_text() == "12.3"
    assert [line.get_marker() for line in ax.lines] == [">"]


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: loop(measured=np.zeros(3)), r"measured has shape \(3,\)"),
        (lambda: loop(simulated=np.full(len(TIME), np.nan)), "simulated has a value that is not finite at sample 0"),
        (lambda: loop("s", time=np.zeros(len(TIME))), "s: time does not increase"),
        (lambda: pictures.loops([]), "loops has nothing to show"),
        (lambda: pictures.histories([]), "histories has nothing to show"),
        (lambda: pictures.error_bars([], [], []), "error_bars has nothing to show"),
        (lambda: pictures.error_bars(["a"], [0.1, 0.2], [True]), "1 names, 2 errors and 1 halves"),
        (lambda: pictures.drifts(TIME, {}), "drifts has nothing to show"),
        (lambda: pictures.drifts(TIME, {"a": TIME}), r"drift has shape \(2000,\)"),
        (lambda: pictures.drifts(TIME, {"a": np.ones((3, 3))}), r"drift has shape \(3, 3\)"),
        (lambda: pictures.controllers({}), "controllers has nothing to show"),
        (lambda: pictures.profile({"a": one_run(2), "b": one_run(3)}), "b has 3 storeys and a has 2"),
        (lambda: pictures.command_history(TIME, {"a": TIME}, {"b": TIME}), "name the same"),
        (lambda: share_ranking({"clairvoyant": []}), "share_ranking has nothing to show"),
        (lambda: search_paths({"clairvoyant": {}}), "search_paths has nothing to show"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(make: Callable[[], object], said: str) -> None:
    refuses(make, said)


# --- a frame ---------------------------------------------------------------------------------
def test_drifts_by_storey_the_top_one_first() -> None:
    drift, _ = runs(3, 4)
    whole, *storeys = pictures.drifts(TIME, drift).axes
    assert whole.get_title("left").startswith("storey 1,")
    assert [ax.get_title("left") for ax in storeys] == ["storey 3", "storey 2", "storey 1"]
    for storey, ax in zip((3, 2, 1), storeys, strict=True):
        peaks = [np.abs(line[:, 1]).max() for line in lines(ax)]
        np.testing.assert_allclose(peaks, [10 * (4 - storey) / (1 + k) for k in range(4)], rtol=1e-3)
    colours = [line.get_color() for line in storeys[0].lines]
    assert colours == [style.REFERENCE, *style.COLOURS[:3]]
    assert [np.abs(line[:, 1]).max() for line in lines(whole)] == pytest.approx([30, 15, 10, 7.5], rel=1e-3)


def test_controllers_are_compared_with_the_first() -> None:
    _, criteria = runs(3, 3)
    fig = pictures.controllers(criteria, "V")
    drift, acceleration, force, command = fig.axes
    np.testing.assert_allclose(bars(drift), [1, 1 / 2, 1 / 3], rtol=1e-9)
    np.testing.assert_allclose(bars(acceleration), [1, 2**0.5 / 2, 3**0.5 / 3], rtol=1e-9)
    np.testing.assert_allclose(bars(force), [0, 2000, 4000], rtol=1e-9)
    np.testing.assert_allclose(bars(command), [criteria[name].mean_command for name in criteria], rtol=1e-9)
    assert (force.get_xlabel(), command.get_xlabel()) == ("N", "V")
    assert [text.get_text() for text in drift.get_yticklabels()] == list(CONTROLLERS[:3])
    assert drift.yaxis_inverted()


def test_profile_over_the_height() -> None:
    _, criteria = runs(3, 2)
    left, right = pictures.profile(criteria, ground_peak=3.4).axes
    steps = [p for p in left.patches if isinstance(p, StepPatch)]
    for k, step in enumerate(steps):
        values, edges, _ = step.get_data()
        np.testing.assert_allclose(values, 10 * np.array([3, 2, 1]) / (1 + k), rtol=1e-9)
        np.testing.assert_allclose(edges, [0, 1, 2, 3])
    for name, line in zip(criteria, lines(right), strict=True):
        np.testing.assert_allclose(line[:, 0], [3.4, *criteria[name].peak_acceleration])
        np.testing.assert_allclose(line[:, 1], [0, 1, 2, 3])
    assert left.get_xlabel() == "peak storey drift, mm"
    assert [text.get_text() for text in left.get_yticklabels()] == ["ground", "1", "2", "3"]
    bare = lines(pictures.profile(criteria).axes[1])[0]
    np.testing.assert_allclose(bare[:, 1], [1, 2, 3])


def test_command_history_holds_the_command() -> None:
    force = 12_000 * np.sin(30 * TIME)
    command = np.where(force > 0, 2.25, 0.0)
    above, below = pictures.command_history(TIME, {"a": command}, {"a": force}, "V").axes
    assert (above.get_ylabel(), below.get_ylabel()) == ("force, kN", "V")
    assert np.abs(lines(above)[0][:, 1]).max() == pytest.approx(12, rel=1e-3)
    assert -above.get_ylim()[0] == pytest.approx(above.get_ylim()[1])
    assert 12 < above.get_ylim()[1] < 15
    step = below.lines[0]
    assert step.get_drawstyle() == "steps-post"
    start, stop = below.get_xlim()
    shown = (start <= TIME) & (stop >= TIME)
    time, level = np.asarray(step.get_xdata()), np.asarray(step.get_ydata())
    held = level[np.searchsorted(time, TIME[shown], side="right") - 1]
    np.testing.assert_array_equal(held[:-1], command[shown][:-1])
    assert any(isinstance(c, FillBetweenPolyCollection) for c in below.collections)


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
