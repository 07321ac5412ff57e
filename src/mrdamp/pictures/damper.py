"""Pictures of a damper: measured against simulated, the errors, and wanted against true force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.patches import Patch

from mrdamp.errors import InputError
from mrdamp.pictures import style

if TYPE_CHECKING:
    from mrdamp.inverse.tracking import Track
    from mrdamp.records import Record

_MOST = 6  # rows of an overview


@dataclass(frozen=True, eq=False)
class LoopData:
    """A record and its simulation.

    time (n,) s; displacement (n,) m; velocity (n,) m/s; command (n,) in command_unit; measured and
    simulated force (n,) N. note: the end of the row's title after the name ("held out, error 0.12").
    Raises InputError on shapes that do not fit, on numbers that are not finite, on times that do not increase.
    """

    name: str
    time: style.Array
    displacement: style.Array
    velocity: style.Array
    command: style.Array
    measured: style.Array
    simulated: style.Array
    command_unit: str = "A"
    note: str = ""

    def __post_init__(self) -> None:
        style.check_series(self, "displacement", "velocity", "command", "measured", "simulated")


def overview(records: Sequence[LoopData]) -> Figure:
    """Loops, or histories where a command changes, of the six records of the largest forces, in their order."""
    strongest = sorted(records, key=lambda r: -float(np.std(r.measured)))[:_MOST]
    shown = [r for r in records if r in strongest]
    return (histories if any(_changes(r, slice(None)) for r in shown) else loops)(shown)


@style.styled
def loops(records: Sequence[LoopData], periods: float = 3.0) -> Figure:
    """Hysteresis loops, a row a record: force over displacement and over velocity, measured over simulated.

    Shown are so many mean periods of the motion, where the piston moves fastest.
    """
    style.require_some("loops", records, "record")
    fig = loop_rows(records, periods, [style.SIMULATED] * len(records), 1.75, sharey="row")
    fig.align_ylabels()
    _measured_and_simulated(fig)
    return fig


def loop_rows(
    records: Sequence[LoopData], periods: float, colours: Sequence[str], height: float, **shared: Any
) -> Figure:
    """Measured loops over simulated ones in a colour each, without a legend; shared: axes."""
    parts = [style.thinned(style.busiest(r.time, r.displacement, periods, r.velocity), 1500) for r in records]
    force, force_name = style.force_unit(*(r.measured for r in records))
    length, length_name = style.length_unit(*(r.displacement for r in records))
    speed, speed_name = style.velocity_unit(*(r.velocity[p] for r, p in zip(records, parts, strict=True)))
    fig = style.figure(0.75 + height * len(records))
    axes = style.axes_grid(fig, len(records), 2, **shared)
    for record, part, colour, (left, right) in zip(records, parts, colours, axes, strict=True):
        for ax, x in ((left, length * record.displacement[part]), (right, speed * record.velocity[part])):
            ax.plot(x, force * record.simulated[part], color=colour, linewidth=2.0)
            ax.plot(x, force * record.measured[part], color=style.INK, linewidth=0.7)
            style.ticks(ax, 5, 5)
        style.row_title(left, right, record.name, record.note)
        left.set_ylabel(f"force, {force_name}")
    axes[-1][0].set_xlabel(f"displacement, {length_name}")
    axes[-1][1].set_xlabel(f"velocity, {speed_name}")
    return fig


@style.styled
def histories(records: Sequence[LoopData]) -> Figure:
    """Force over time, measured over simulated, and below it their difference on the same scale.

    Shown are six mean periods of the motion, where the piston moves fastest. A command that changes there is drawn
    below.
    """
    style.require_some("histories", records, "record")
    parts = [style.busiest(r.time, r.displacement, 6.0, r.velocity) for r in records]
    force, force_name = style.force_unit(*(r.measured for r in records))
    # One grid for all: subfigures would not line up.
    rows: list[tuple[LoopData, slice, str]] = []
    heights: list[float] = []
    for record, part in zip(records, parts, strict=True):
        low, high = _range(record, part)
        error_low, error_high = style.padded(*_extent(record.measured[part] - record.simulated[part]))
        rows += [(record, part, "force"), (record, part, "residual")]
        heights += [1.0, max((error_high - error_low) / (high - low), 0.3)]
        if _changes(record, part):
            rows.append((record, part, "command"))
            heights.append(0.3)
    fig = style.figure(0.5 + sum(1.3 * height + 0.22 for height in heights) + 0.2 * len(records))
    grid = GridSpec(len(rows), 1, figure=fig, height_ratios=heights)
    top: Axes | None = None
    for k, (record, part, what) in enumerate(rows):
        time = record.time[part]
        ax = fig.add_subplot(grid[k], sharex=None if what == "force" else top)
        if what == "force":
            top = ax
            low, high = _range(record, part)
            ax.plot(
                *style.outline(time, force * record.simulated[part], style.BINS),
                color=style.SIMULATED,
                linewidth=2.0,
            )
            ax.plot(
                *style.outline(time, force * record.measured[part], style.BINS),
                color=style.INK,
                linewidth=0.8,
            )
            ax.set_ylim(force * low, force * high)
            ax.set_xlim(time[0], time[-1])
            ax.set_ylabel(f"force, {force_name}")
            style.row_title(ax, ax, record.name, record.note)
            style.ticks(ax, 6, 5)
        elif what == "residual":
            residual = force * (record.measured[part] - record.simulated[part])
            ax.axhline(0.0, color=style.MUTED, linewidth=0.7)
            ax.plot(*style.outline(time, residual, style.BINS), color=style.COLOURS[0], linewidth=0.9)
            # As many newton an inch as above: the error is seen at its true size.
            span = force * (high - low) * heights[k]
            middle = sum(_extent(residual)) / 2
            ax.set_ylim(middle - span / 2, middle + span / 2)
            ax.set_ylabel(f"error, {force_name}")
            style.ticks(ax, 6, max(2, round(5 * heights[k])))
        else:
            ax.plot(
                *style.outline(time, record.command[part], style.BINS), color=style.COLOURS[2], linewidth=1.2
            )
            least, most = _extent(record.command[part])
            ax.set_ylim(*style.padded(min(0.0, least), most))
            ax.set_ylabel(record.command_unit)
            style.ticks(ax, 6, 2)
        last = k + 1 == len(rows) or rows[k + 1][2] == "force"
        ax.tick_params(labelbottom=last)
        if k + 1 == len(rows):
            ax.set_xlabel("time, s")
    fig.align_ylabels()
    commands = any(what == "command" for _, _, what in rows)
    _measured_and_simulated(
        fig, ("error", style.COLOURS[0]), *([("command", style.COLOURS[2])] if commands else [])
    )
    return fig


@style.styled
def channels(record: Record) -> Figure:
    """Every channel of a record over time, a row each, in its units."""
    shown = {name: values for name, values in record.channels.items() if name != "time_s"}
    fig = style.figure(0.5 + 0.9 * len(shown))
    rows = style.column(fig, len(shown), sharex=True)
    for ax, (name, values) in zip(rows, shown.items(), strict=True):
        ax.plot(*style.outline(record.time, values, style.BINS), color=style.COLOURS[0], linewidth=0.9)
        ax.set_title(name)
        style.ticks(ax, 6, 3)
    rows[-1].set_xlabel("time, s")
    return fig


@style.styled
def error_bars(names: Sequence[str], errors: Sequence[float], held_out: Sequence[bool]) -> Figure:
    """Free-run error by record, the held-out ones first and in colour.

    errors: RMS error over the standard deviation of the measured force, one per name. held_out: of each,
    whether nothing was fitted to it. A few bars that are much longer than the rest are cut, which an arrow shows; the
    values are next to the bars.
    """
    style.require_some("error_bars", names, "record")
    if not len(names) == len(errors) == len(held_out):
        counts = f"{len(names)} names, {len(errors)} errors and {len(held_out)} halves"
        raise InputError(f"picture: error_bars has {counts}; give as many of each")
    values = style.finite("errors", errors, (len(names),))
    order = sorted(range(len(names)), key=lambda k: not held_out[k])
    split = sum(map(bool, held_out))
    usual = float(np.quantile(values, 0.9, method="lower"))
    limit = max(0.01, min(float(values.max()), 2.5 * usual))
    place = np.arange(len(names)) + np.where(np.arange(len(names)) >= split, 0.6 * (split > 0), 0.0)
    fig = style.figure(0.95 + 0.215 * (float(place[-1]) + 1))
    ax = fig.subplots()
    colour = [style.COLOURS[0] if k < split else style.REFERENCE for k in range(len(names))]
    shown = np.array([values[k] for k in order])
    ax.barh(place, np.minimum(shown, limit), 0.68, color=colour)
    for y in place[shown > limit]:
        ax.plot(1.025 * limit, y, ">", color=style.INK, markersize=4)
    right = ax.twinx()
    right.set_yticks(place, [f"{value:.3f}" if value < 0.9995 else style.short(value) for value in shown])
    right.spines["left"].set_visible(False)
    ax.set_yticks(place, [style.elide(names[k], 172, 8.5) for k in order], fontsize=8.5)
    for side in (ax, right):
        side.set_ylim(place[-1] + 0.6, place[0] - 0.6)
        side.grid(False, axis="y")
        side.tick_params(axis="y", length=0)
    ax.set_xlim(0, 1.04 * limit)
    ax.set_xlabel("RMS error / standard deviation of force", loc="right")
    style.ticks(ax, 5)
    colours = {"held out": style.COLOURS[0]} if split else {}
    colours |= {"fitted to": style.REFERENCE} if split < len(names) else {}
    style.legend(fig, [Patch(color=colour) for colour in colours.values()], list(colours))
    return fig


@style.styled
def force_tracking(tracks: Sequence[Track], command_unit: str = "A", seconds: float = 1.5) -> Figure:
    """Each run's force over the wanted one, its command below: the part of so many seconds with the largest force.

    tracks: of one wanted force. Raises InputError where there is none.
    """
    style.require_some("force_tracking", tracks, "run")
    first = tracks[0]
    step = float(first.time[1] - first.time[0])
    count = min(len(first.time), round(seconds / step))
    energy = np.concatenate([[0.0], np.cumsum(first.wanted**2)])
    start = int(np.argmax(energy[count:] - energy[:-count]))
    window = slice(start, start + count)
    part = style.thinned(window, 1200)
    scale, unit = style.force_unit(*(t.force for t in tracks))
    top = max(float(t.command.max()) for t in tracks)
    fig = style.figure(0.7 + 1.75 * len(tracks))
    heights = [height for _ in tracks for height in (1.0, 0.5)]
    axes = style.column(fig, 2 * len(tracks), sharex=True, height_ratios=heights)
    for k, run in enumerate(tracks):
        above, below = axes[2 * k], axes[2 * k + 1]
        above.plot(run.time[part], scale * run.wanted[part], color=style.INK, linewidth=0.9)
        colour = style.COLOURS[k % len(style.COLOURS)]
        above.plot(run.time[part], scale * run.force[part], color=colour, linewidth=1.5, zorder=1.9)
        style.row_title(above, above, run.name, f"RMS error {100 * run.relative_error:.1f} %")
        above.set_ylabel(f"force, {unit}")
        # Held between samples: a corner where it changes.
        below.step(*style.staircase(run.time[window], run.command[window]), where="post", color=colour, linewidth=1.0)
        below.set_ylim(*style.padded(0.0, top))
        below.set_ylabel(command_unit)
        style.ticks(above, 6, 4)
        style.ticks(below, 6, 2)
    axes[-1].set_xlim(float(first.time[start]), float(first.time[start + count - 1]))
    axes[-1].set_xlabel("time, s; below each force the command")
    fig.align_ylabels(axes)
    true = {"color": style.MUTED, "linewidth": 1.5}
    style.line_legend(fig, {"wanted": {"color": style.INK, "linewidth": 0.9}, "true force, in colour": true})
    return fig


def _measured_and_simulated(fig: Figure, *others: tuple[str, str]) -> None:
    """Legend: measured, simulated, and other lines by name and colour."""
    looks = {
        "measured": {"color": style.INK, "linewidth": 0.9},
        "simulated": {"color": style.SIMULATED, "linewidth": 2.0},
    }
    style.line_legend(fig, looks | {name: {"color": colour, "linewidth": 1.2} for name, colour in others})


def _extent(values: style.Array) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _range(record: LoopData, part: slice) -> tuple[float, float]:
    both = np.concatenate([record.measured[part], record.simulated[part]])
    return style.padded(*_extent(both))


def _changes(record: LoopData, part: slice) -> bool:
    command = record.command[part]
    return float(np.ptp(command)) > 0.02 * max(style.peak(record.command), 1e-12)
