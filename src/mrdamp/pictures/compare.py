"""Pictures of controllers compared over many motions: means with intervals, drift against acceleration, amplitudes, the
way to a clairvoyant command and the searches for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import ArrayLike

from mrdamp.errors import InputError
from mrdamp.pictures import style
from mrdamp.pictures.style import Array


@dataclass(frozen=True)
class Bar:
    """A controller's mean with its interval (NaN: none) and single values (n,), as the worst case or one a load.

    marked: drawn in the colour of learned ones.
    """

    name: str
    mean: float
    low: float
    high: float
    single: Array
    marked: bool = False


@style.styled
def ranking(panels: Mapping[str, Sequence[Bar]]) -> Figure:
    """Means by controller, one panel a measure: dot with interval, and a tick at the worst case.

    panels: title -> the same controllers in the same order; a NaN mean leaves its row empty.
    """
    names = _controllers("ranking", panels)
    rows = -(-len(panels) // 2)
    fig = style.figure(0.55 + rows * (0.55 + 0.2 * len(names)))
    axes = [ax for row in style.axes_grid(fig, rows, 2, sharey=True) for ax in row]
    for ax, (title, bars) in zip(axes, panels.items(), strict=False):
        ends = np.array([v for b in bars for v in (b.mean, b.high, *b.single)])
        largest = ends.max(initial=0.0, where=np.isfinite(ends)) or 1.0
        for y, bar in enumerate(bars):
            if np.isfinite(bar.mean):
                _row(ax, y, bar)
                ax.text(1.06 * largest, y, style.short(bar.mean), va="center", fontsize=9, color=style.INK)
        ax.set_xlim(0, 1.36 * largest)
        ax.set_title(title)
        style.ticks(ax, 4)
    for ax in axes[len(panels) :]:
        ax.set_visible(False)
    style.name_rows(axes[: len(panels)], names, 128)
    drawn = any(np.isfinite(b.low) for bars in panels.values() for b in bars)
    _interval_legend(fig, "mean", "95 % of the mean" if drawn else "", "worst")
    return fig


_LEFT = -1.0  # shares below are drawn at the edge


@style.styled
def share_ranking(panels: Mapping[str, Sequence[Bar]]) -> Figure:
    """Shares of the way to a bound by controller, one panel a bound: dot with interval, a tick for each load; 0 the
    base, 1 the bound.

    panels: title -> the same controllers in the same order. Shares below -1 are drawn at -1.
    """
    names = _controllers("share_ranking", panels)
    fig = style.figure(0.9 + 0.22 * len(names))
    axes = style.axes_grid(fig, 1, len(panels), sharey=True)[0]
    for ax, (title, rows) in zip(axes, panels.items(), strict=True):
        ax.axvline(0.0, color=style.MUTED, linewidth=0.7)
        ax.axvline(1.0, color=style.MUTED, linewidth=0.7, linestyle=style.DASHES[2])
        for y, bar in enumerate(rows):
            _row(ax, y, bar, _LEFT)
        ax.set_xlim(_LEFT - 0.06, 1.06)
        ax.set_title(style.elide(title.removeprefix("clairvoyant-"), 90, 9))
        style.ticks(ax, 3)
    style.name_rows(axes, names, 110)
    _interval_legend(fig, "all runs", "95 %", "one motion")
    return fig


def _row(ax: Axes, y: float, bar: Bar, least: float = -np.inf) -> None:
    """A dot (mean), a bar (interval) and ticks (single values); what is less than `least` is drawn there."""
    colour = style.SIMULATED if bar.marked else style.COLOURS[0]
    single = np.maximum(bar.single[np.isfinite(bar.single)], least)
    alpha = 1.0 if len(bar.single) == 1 else 0.7
    ax.plot(single, np.full(len(single), y), "|", markersize=7, color=style.MUTED, alpha=alpha)
    if np.isfinite(bar.low):
        span = np.maximum([bar.low, bar.high], least)
        ax.plot(span, [y, y], color=colour, linewidth=3.2, alpha=0.35, solid_capstyle="butt")
    if np.isfinite(bar.mean):
        ax.plot([max(bar.mean, least)], [y], "o", markersize=4.5, color=colour)


def _interval_legend(fig: Figure, mean: str, interval: str, single: str) -> None:
    """Of what `_row` draws. interval: empty where there is none."""
    looks: dict[str, dict[str, Any]] = {
        mean: {"color": style.COLOURS[0], "marker": "o", "markersize": 4.5, "linestyle": "none"},
        interval: {"color": style.COLOURS[0], "linewidth": 3.2, "alpha": 0.35},
        single: {"color": style.MUTED, "marker": "|", "markersize": 7, "linestyle": "none"},
    }
    style.line_legend(fig, {name: look for name, look in looks.items() if name})


def _controllers(what: str, panels: Mapping[str, Sequence[Bar]]) -> list[str]:
    """Names of the rows of the first panel; what: the picture's name. Raises InputError where a panel is empty."""
    style.require_some(what, panels and all(panels.values()), "controller")
    return [bar.name for bar in next(iter(panels.values()))]


@style.styled
def search_paths(panels: Mapping[str, Mapping[str, Sequence[float]]]) -> Figure:
    """The best value so far over the steps of each search; panels: bound -> start -> values."""
    style.require_some("search_paths", panels and all(panels.values()), "search")
    names = list(dict.fromkeys(name for lines in panels.values() for name in lines))
    count = len(style.COLOURS)
    looks: dict[str, dict[str, Any]] = {
        name: {"color": style.COLOURS[k % count], "linestyle": style.DASHES[k // count % len(style.DASHES)]}
        for k, name in enumerate(names)
    }
    fig = style.figure(2.8)
    axes = style.axes_grid(fig, 1, len(panels))[0]
    for ax, (title, lines) in zip(axes, panels.items(), strict=True):
        for name, values in lines.items():
            ax.plot(np.arange(len(values)), np.asarray(values, dtype=np.float64), **looks[name])
        ax.set_title(style.elide(title.removeprefix("clairvoyant-"), 100, 9))
        ax.set_xlabel("step")
        style.ticks(ax, 4, 5)
    style.line_legend(fig, {style.elide(name, 110, 9): look for name, look in looks.items()})
    return fig


@style.styled
def trade_off(
    drift: Mapping[str, float], acceleration: Mapping[str, float], marked: Sequence[str] = ()
) -> Figure:
    """Mean peak acceleration over mean peak drift, both over the uncontrolled; the best corner is below on the left.

    drift, acceleration: controller -> ratio. Controllers are numbered; the list is to the right of the axes.
    """
    names = list(drift)
    style.require_some("trade_off", names, "controller")
    fig = style.figure(max(3.4, 0.6 + 0.19 * len(names)))
    [[ax, key]] = style.axes_grid(fig, 1, 2, width_ratios=[1.5, 1.0])
    points = np.array([[drift[name], acceleration[name]] for name in names])
    span = np.maximum(np.ptp(points, axis=0), 1e-9)
    for k, (name, place) in enumerate(zip(names, _label_places(points / span * _AXES), strict=True), start=1):
        colour = style.SIMULATED if name in marked else style.COLOURS[0]
        ax.plot([drift[name]], [acceleration[name]], marker="o", markersize=4, color=colour, linestyle="none")
        ax.annotate(
            str(k), points[k - 1], xytext=tuple(place), textcoords="offset points", fontsize=9, color=colour,
            ha="center", va="center", arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.5, "shrinkA": 4},
        )  # fmt: skip
        key.text(
            0.0, 1 - (k - 0.5) / len(names), f"{k}  {style.elide(name, 124, 9)}", transform=key.transAxes, fontsize=9,
            va="center", color=style.SIMULATED if name in marked else style.INK,
        )  # fmt: skip
    key.set_axis_off()
    ax.set_xlabel("J1, peak drift over uncontrolled")
    ax.set_ylabel("J2, peak acceleration over uncontrolled")
    ax.margins(0.14)
    style.ticks(ax, 5, 6)
    return fig


_AXES = np.array([140.0, 165.0])  # points, about what the data spans in trade_off


def _label_places(points: Array) -> list[Array]:
    """Where each label stands off its point, in typographic points, clear of the other points and labels."""
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    offsets = np.concatenate(
        [r * np.column_stack([np.cos(angles), np.sin(angles)]) for r in (9.0, 16.0, 24.0, 33.0)]
    )
    taken, places = list(points), []
    for point in points:
        spots = point + offsets
        clear = np.min([np.hypot(*(spots - other).T) for other in taken], axis=0)
        # The nearest spot that is clear, or the clearest one; the offsets begin with the nearest.
        best = int(np.argmax(clear >= 8.5)) if clear.max() >= 8.5 else int(clear.argmax())
        taken.append(spots[best])
        places.append(offsets[best])
    return places


@style.styled
def by_amplitude(
    amplitudes: ArrayLike, panels: Mapping[str, Mapping[str, ArrayLike]], marked: Sequence[str] = ()
) -> Figure:
    """A measure's mean over the amplitude, one panel a measure.

    panels: title -> controller -> (n,) for amplitudes (n,). At most six controllers.
    """
    x = np.asarray(amplitudes, dtype=np.float64)
    names = list(next(iter(panels.values()), {}))
    if not names or len(names) > len(style.DASHES):
        raise InputError(f"picture: by_amplitude has {len(names)} controllers; allowed: 1 to {len(style.DASHES)}")
    fig = style.figure(2.75)
    axes = style.axes_grid(fig, 1, len(panels), sharex=True)[0]
    others = iter((style.REFERENCE, *style.COLOURS[:1], *style.COLOURS[2:]))
    colour = {name: style.SIMULATED if name in marked else next(others) for name in names}
    looks: dict[str, dict[str, Any]] = {
        name: {"color": colour[name], "linestyle": style.DASHES[k], "marker": style.MARKERS[k], "markersize": 4.5}
        for k, name in enumerate(names)
    }
    for ax, (title, lines) in zip(axes, panels.items(), strict=True):
        for name, values in lines.items():
            ax.plot(x, np.asarray(values, dtype=np.float64), **looks[name])
        ax.set_title(title)
        ax.set_xlabel("amplitude")
        style.ticks(ax, 5, 5)
    style.line_legend(fig, looks)
    return fig


@style.styled
def deviations(rows: Mapping[str, Sequence[float]], columns: Sequence[str]) -> Figure:
    """Deviations in percent, one group of bars a row. rows: name -> up to len(columns) values."""
    style.require_some("deviations", rows, "controller")
    fig = style.figure(2.4)
    [[ax]] = style.axes_grid(fig, 1, 1)
    width = 0.8 / len(rows)
    handles: list[Artist] = []
    for k, values in enumerate(rows.values()):
        place = np.arange(len(values)) + (k - (len(rows) - 1) / 2) * width
        ax.bar(place, values, 0.9 * width, color=style.COLOURS[k % len(style.COLOURS)])
        handles.append(Rectangle((0, 0), 1, 1, color=style.COLOURS[k % len(style.COLOURS)]))
    ax.axhline(0.0, color=style.MUTED, linewidth=0.7)
    ax.set_xticks(np.arange(len(columns)), columns)
    ax.set_ylabel("deviation, %")
    ax.grid(False, axis="x")
    style.legend(fig, handles, list(rows))
    return fig
