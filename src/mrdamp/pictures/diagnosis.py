"""Pictures of a diagnosis: where in chain and regime the gap lies, what causes it, how far it shrinks."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Patch

from mrdamp.errors import InputError
from mrdamp.pictures import style

#: The measurement is grey, as what others are compared with always is.
BEFORE, AFTER, NAMED = style.COLOURS[1], style.COLOURS[0], style.COLOURS[2]
_BINS = 7  # of the gap map, a side
_FEWEST = 20  # samples of a bin that is drawn
_HEAT = LinearSegmentedColormap.from_list("gap", ["#f4f6f8", "#f3b27a", style.COLOURS[1], "#7d2e00"])


@dataclass(frozen=True, eq=False)
class ResidualData:
    """A record's channel, measured and simulated before and after the correction.

    time (n,) s; velocity (n,) m/s of the piston; command (n,); measured, nominal, corrected (n,) in `unit`;
    displacement (n,) m of the piston, for loops.
    """

    name: str
    time: style.Array
    velocity: style.Array
    command: style.Array
    measured: style.Array
    nominal: style.Array
    corrected: style.Array
    unit: str = "N"
    note: str = ""
    displacement: style.Array | None = None

    def __post_init__(self) -> None:
        style.check_series(self, "velocity", "command", "measured", "nominal", "corrected")
        if self.displacement is not None:
            style.check_series(self, "displacement")


def _simulators(records: Sequence[ResidualData]) -> dict[str, str]:
    """Name -> colour of the simulators to draw: the corrected one is left out where it is the nominal one."""
    same = all(np.array_equal(r.nominal, r.corrected) for r in records)
    return {"nominal": BEFORE} if same else {"nominal": BEFORE, "corrected": AFTER}


@style.styled
def waterfall(
    steps: Sequence[tuple[str, float, tuple[float, float]]], floor: float, ceiling: float | None = None
) -> Figure:
    """Gap on held-out records, step by step: name, gap, 95 % interval; lines for noise floor and ceiling.

    A step whose name extends that of the one above is labelled by the addition. Bars are cut at twice the larger of the
    first and the last: free parameters that do not hold on a left-out record can have any gap.
    """
    style.require_some("waterfall", steps, "step")
    fig = style.figure(0.75 + 0.36 * len(steps))
    ax = fig.subplots()
    y = np.arange(len(steps))
    gaps = 100 * np.array([gap for _, gap, _ in steps])
    most = 2 * max(gaps[0], gaps[-1])
    cut = gaps > most
    ends = np.minimum(100 * np.array([interval for *_, interval in steps]), most)
    ax.barh(y, np.minimum(gaps, most), height=0.6, color=[BEFORE, *[AFTER] * (len(steps) - 1)])
    ax.hlines(y, ends[:, 0], ends[:, 1], color=style.INK, linewidth=1.4)
    ax.axvline(100 * floor, color=style.MUTED, linestyle="--", linewidth=1.0)
    looks = {"noise floor": {"color": style.MUTED, "linestyle": "--"}, "95 % interval": {"color": style.INK}}
    if ceiling is not None:
        ax.axvline(100 * ceiling, color=style.MUTED, linestyle=":", linewidth=1.4)
        looks["regression"] = {"color": style.MUTED, "linestyle": ":"}
    gaps = np.minimum(gaps, most)
    top = max(float(ends.max()), float(gaps.max())) or 1.0
    for k, gap in enumerate(gaps):
        text = f"more than {gap:.2g} %" if cut[k] else f"{gap:.2g} %"
        ax.text(max(gap, ends[k, 1]) + 0.015 * top, k, text, va="center", color=style.INK, fontsize=9)
    ax.set_yticks(y, [style.elide(name, 120) for name in added([name for name, *_ in steps])])
    ax.set_xlim(0, (1.4 if cut.any() else 1.18) * top)
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("gap, % of the RMS")
    style.line_legend(fig, looks)
    return fig


def added(names: Sequence[str]) -> list[str]:
    """What each step adds to the one above: `+ b` for `+ a + b` under `+ a`."""
    above = ("", *names)
    return [
        name.removeprefix(f"{before} ") if name.startswith(f"{before} + ") else name
        for before, name in zip(above, names, strict=False)
    ]


@style.styled
def probabilities(values: Mapping[str, float], named: Collection[str] = (), most: int = 6) -> Figure:
    """Probability of each cause, the likeliest first, at most so many and the rest together."""
    ranked = sorted(values.items(), key=lambda item: -item[1])
    shown, rest = ranked[:most], sum(p for _, p in ranked[most:])
    if len(ranked) > most:
        others = len(ranked) - most
        shown = [*shown, ("1 other" if others == 1 else f"{others} others", rest)]
    fig = style.figure(0.45 + 0.3 * len(shown))
    ax = fig.subplots()
    y = np.arange(len(shown))
    p = np.array([value for _, value in shown])
    ax.barh(y, p, height=0.6, color=[NAMED if name in named else style.REFERENCE for name, _ in shown])
    for k, value in enumerate(p):
        ax.text(value + 0.015, k, f"{value:.2f}", va="center", color=style.INK, fontsize=9)
    ax.set_yticks(y, [style.elide(name, 130) for name, _ in shown])
    ax.set_xlim(0, 1.12)
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("probability")
    return fig


@style.styled
def chain(
    shares: Mapping[str, float],
    intervals: Mapping[str, tuple[float, float]] | None = None,
    named: Collection[str] = (),
    of: str = "gap",
) -> Figure:
    """The signal chain, named stages lit, each stage's share over it, with intervals where there are any."""
    names = list(shares)
    fig = style.figure(2.3)
    ax = fig.subplots()
    x = np.arange(len(names))
    values = 100 * np.array([shares[name] for name in names])
    colours = [NAMED if name in named else style.REFERENCE for name in names]
    ax.bar(x, values, width=0.62, color=colours)
    top = float(values.max())
    for k, name in enumerate(names):
        reach = values[k]
        if intervals and name in intervals:
            low, high = (100 * end for end in intervals[name])
            ax.vlines(k, low, high, color=style.INK, linewidth=1.4)
            reach = max(reach, high)
        top = max(top, reach)
        ax.text(k, reach + 2, f"{values[k]:.0f} %", ha="center", color=style.INK, fontsize=9)
    top = 1.15 * max(top, 10.0)
    for k, name in enumerate(names):
        _stage(ax, k, -0.17 * top, 0.17 * top, name, lit=name in named, size=min(7.5, 45 / len(names)))
    arrow = {"arrowstyle": "-|>", "color": style.MUTED, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
    for k in range(-1, len(names)):  # the command's way in and the reading's way out are longer
        start, end = k + (0.26 if k < 0 else 0.46), k + (0.74 if k == len(names) - 1 else 0.54)
        ax.annotate("", (end, -0.17 * top), (start, -0.17 * top), annotation_clip=False, arrowprops=arrow)
    ax.set_xlim(-0.8, len(names) - 0.2)
    ax.set_ylim(-0.3 * top, top)
    ax.axhline(0.0, color=style.MUTED, linewidth=0.7)
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.set_ylabel(f"share of the {of}")
    ax.set_xticks([])
    ax.set_yticks([])
    ax.grid(visible=False)
    return fig


def _stage(ax: Axes, x: float, y: float, height: float, name: str, *, lit: bool, size: float) -> None:
    """A stage as a box of the chain around (x, y); size: of the type, points."""
    box = FancyBboxPatch(
        (x - 0.45, y - height / 2), 0.9, height, boxstyle="round,pad=0,rounding_size=0.06", mutation_aspect=height,
        facecolor=NAMED if lit else "none", edgecolor=NAMED if lit else style.MUTED, linewidth=1.0, clip_on=False,
    )  # fmt: skip
    ax.add_patch(box)
    ax.text(x, y, name, ha="center", va="center", fontsize=size, color="white" if lit else style.INK,
            weight="bold" if lit else "normal")  # fmt: skip


@style.styled
def by_regime(
    name: str,
    rows: Sequence[tuple[str, float, tuple[float, float]]],
    whole: tuple[float, tuple[float, float] | None],
) -> Figure:
    """A parameter fitted to each regime alone: label, value, 95 % interval; the value of all records as a line, its
    interval as a band. A logarithmic axis if positive values differ by more than a factor of five."""
    style.require_some("by_regime", rows, "regime")
    fig = style.figure(0.75 + 0.3 * len(rows))
    ax = fig.subplots()
    y = np.arange(len(rows))
    values = np.array([value for _, value, _ in rows])
    ends = np.array([interval for *_, interval in rows])
    value, band = whole
    if band is not None:
        ax.axvspan(*band, color=style.GRID, linewidth=0)
    ax.axvline(value, color=style.MUTED, linestyle="--", linewidth=1.0)
    ax.hlines(y, ends[:, 0], ends[:, 1], color=AFTER, linewidth=1.6)
    ax.plot(values, y, "o", color=AFTER, markersize=5)
    drawn = np.concatenate([values, ends.ravel(), [value]])
    if drawn.min() > 0 and drawn.max() > 5 * drawn.min():
        ax.set_xscale("log")
    else:
        style.ticks(ax, 3)
        ax.ticklabel_format(axis="x", useOffset=False)
    ax.set_yticks(y, [style.elide(label, 130) for label, *_ in rows])
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.grid(axis="y", visible=False)
    ax.set_xlabel(name)
    alone, every = {"color": AFTER, "marker": "o"}, {"color": style.MUTED, "linestyle": "--"}
    style.line_legend(fig, {"regime alone, 95 % interval": alone, "all records": every})
    return fig


@style.styled
def gap_map(records: Sequence[ResidualData]) -> Figure:
    """RMS residual over velocity and command, before and after, on one scale: % of the measurement's RMS."""
    style.require_some("gap_map", records, "record")
    velocity, command = (np.concatenate([getattr(r, k) for r in records]) for k in ("velocity", "command"))
    size = [np.sqrt(np.mean(r.measured**2)) or 1.0 for r in records]
    errors = {
        k: np.concatenate([(getattr(r, k) - r.measured) / s for r, s in zip(records, size, strict=True)])
        for k in _simulators(records)
    }
    v_edges, u_edges = _edges(velocity, symmetric=True), _edges(command, symmetric=False)
    maps = [100 * _binned(velocity, command, e, v_edges, u_edges) for e in errors.values()]
    fig = style.figure(2.5)
    axes = style.axes_grid(fig, 1, len(maps), sharey=True)[0]
    top = float(np.nanmax(maps[0])) if np.isfinite(maps[0]).any() else 1.0
    mesh = None
    for ax, values, title in zip(axes, maps, errors, strict=True):
        ax.set_title(title)
        mesh = ax.pcolormesh(
            v_edges, u_edges, values.T, cmap=_HEAT, vmin=0, vmax=top, edgecolor=style.GRID, linewidth=0.3
        )
        ax.set_xlabel("velocity, m/s")
        ax.grid(visible=False)
        style.ticks(ax, 4, 5)
    axes[0].set_ylabel("command, A or V")
    assert mesh is not None
    bar = fig.colorbar(mesh, ax=axes, pad=0.01, aspect=18)
    bar.set_label("RMS residual, %")
    bar.outline.set_visible(False)
    return fig


@style.styled
def residuals(records: Sequence[ResidualData], periods: float = 5.0) -> Figure:
    """Measured less simulated over time, before and after, where the piston moves fastest; a row a record.

    A record's rows share the scale: the nominal simulator's residual, the corrected one's below it.
    """
    style.require_some("residuals", records, "record")
    drawn = _simulators(records)
    count = len(drawn)
    fig = style.figure(0.6 + 1.05 * count * len(records))
    axes = fig.subplots(count * len(records), 1, squeeze=False)[:, 0]
    for k, r in enumerate(records):
        part = style.busiest(r.time, r.velocity, periods)
        pair = axes[count * k : count * (k + 1)]
        errors = [(r.measured - getattr(r, name))[part] for name in drawn]
        top = 1.08 * max(float(np.abs(e).max()) for e in errors) or 1.0
        for ax, error, colour in zip(pair, errors, drawn.values(), strict=True):
            ax.axhline(0.0, color=style.MUTED, linewidth=0.7)
            ax.plot(*style.outline(r.time[part], error, style.BINS), color=colour, linewidth=1.2)
            ax.set_xlim(r.time[part][0], r.time[part][-1])
            ax.set_ylim(-top, top)
            ax.set_ylabel(f"error, {r.unit}")
            style.ticks(ax, 6, 4)
        for ax in pair[:-1]:
            ax.tick_params(axis="x", labelbottom=False)
        pair[0].set_title(style.elide(" · ".join(x for x in (r.name, r.note) if x), 330))
    axes[-1].set_xlabel("time, s")
    style.legend(fig, [Patch(color=colour) for colour in drawn.values()], list(drawn))
    return fig


@style.styled
def loops(record: ResidualData, periods: float = 2.0) -> Figure:
    """Force over displacement and over velocity of one record: measured, nominal and corrected, over so many periods.

    Raises InputError for a record without displacement.
    """
    if record.displacement is None:
        raise InputError(f"{record.name}: loops need its displacement")
    part = style.thinned(style.busiest(record.time, record.displacement, periods, record.velocity), 1500)
    force, force_name = style.force_unit(record.measured)
    length, length_name = style.length_unit(record.displacement)
    speed, speed_name = style.velocity_unit(record.velocity[part])
    fig = style.figure(6.2)
    axes = fig.subplots(2, 1)
    looks: dict[str, dict[str, Any]] = {"measured": {"color": style.REFERENCE, "linewidth": 3.0}}
    for name, colour in _simulators([record]).items():
        looks[name] = {"color": colour, "linewidth": 1.3, "linestyle": "-" if name == "corrected" else (0, (4, 1.5))}
    sides = (
        (length * record.displacement, f"displacement, {length_name}"),
        (speed * record.velocity, f"velocity, {speed_name}"),
    )
    for ax, (x, label) in zip(axes, sides, strict=True):
        for name, look in looks.items():
            ax.plot(x[part], force * getattr(record, name)[part], **look)
        ax.set_xlabel(label)
        ax.set_ylabel(f"force, {force_name}")
        style.ticks(ax, 6, 5)
    axes[0].set_title(style.elide(record.name, 330))
    style.line_legend(fig, looks)
    return fig


def _edges(values: style.Array, *, symmetric: bool) -> style.Array:
    """Edges of bins over all but the outermost values; one bin where the values hardly differ."""
    low, high = np.quantile(values, [0.005, 0.995])
    if symmetric:
        high = max(abs(low), abs(high))
        low = -high
    if high - low < 1e-9 * max(abs(high), 1e-9):
        middle = float(values.mean())
        half = 0.5 * abs(middle) or 0.5
        return np.array([middle - half, middle + half])
    return np.linspace(low, high, _BINS + 1)


def _binned(
    x: style.Array, y: style.Array, e: style.Array, x_edges: style.Array, y_edges: style.Array
) -> style.Array:
    """RMS of e (columns x, rows y), NaN where there are too few samples."""
    inside = (np.clip(x, x_edges[0], x_edges[-1]), np.clip(y, y_edges[0], y_edges[-1]))
    count = np.histogram2d(*inside, bins=(x_edges, y_edges))[0]
    total = np.histogram2d(*inside, bins=(x_edges, y_edges), weights=e**2)[0]
    return np.asarray(np.where(count >= _FEWEST, np.sqrt(total / np.maximum(count, 1)), np.nan))
