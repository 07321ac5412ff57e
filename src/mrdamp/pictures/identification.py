"""Pictures of an identification: parameters over the command, models over each other, a calibrated sensor, and
Figs. 3 to 5 of the self-sensing paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mrdamp.errors import InputError
from mrdamp.pictures import style
from mrdamp.pictures.damper import LoopData, loop_rows


@style.styled
def parameter_lines(
    names: Sequence[str],
    units: Sequence[str],
    commands: style.Array,
    values: Sequence[style.Array],
    lines: Sequence[tuple[float, float]],
    command_unit: str = "A",
) -> Figure:
    """Parameters fitted at each constant command, with the straight line through them.

    commands (n,); values: one (n,) per name; lines: (value at command 0, slope) per name.
    """
    if not names or not len(names) == len(units) == len(values) == len(lines):
        raise InputError(
            "picture: parameter_lines needs as many units, values and lines as names, at least one"
        )
    commands = style.finite("commands", commands)
    rows = (len(names) + 1) // 2
    fig = style.figure(0.6 + 1.35 * rows)
    axes = [ax for row in style.axes_grid(fig, rows, 2, sharex=True) for ax in row]
    span = np.array(style.padded(min(0.0, float(commands.min())), float(commands.max())))
    for ax, name, unit, series, (zero, slope) in zip(axes, names, units, values, lines, strict=False):
        series = style.finite(name, series, commands.shape)
        ax.plot(span, zero + slope * span, color=style.COLOURS[1], linewidth=1.4)
        ax.plot(commands, series, "o", color=style.INK, markersize=4.5)
        ax.set_xlim(*span)
        low = min(float(series.min()), float((zero + slope * commands).min()))
        high = max(float(series.max()), float((zero + slope * commands).max()))
        ax.set_ylim(*style.padded(min(low, 0.0) if low > 0 or high < 0 else low, high))
        style.row_title(ax, ax, name, unit)
        style.ticks(ax, 4, 4)
    for ax in axes[len(names) :]:
        ax.set_visible(False)
    for ax in axes[max(0, len(names) - 2) : len(names)]:
        ax.tick_params(labelbottom=True)
        ax.set_xlabel(f"command, {command_unit}")
    dots = {"color": style.INK, "marker": "o", "linestyle": "", "markersize": 4.5}
    style.line_legend(fig, {"fit at one command": dots, "line through them": {"color": style.COLOURS[1]}})
    return fig


@style.styled
def model_loops(
    time: style.Array,
    displacement: style.Array,
    velocity: style.Array,
    measured: style.Array,
    simulated: Mapping[str, style.Array],
) -> Figure:
    """One record's loops over displacement and over velocity, every model in its own row over the measurement."""
    style.require_some("model_loops", simulated, "model")
    motion = time, displacement, velocity, np.zeros_like(time), measured
    rows = [LoopData(name, *motion, model) for name, model in simulated.items()]
    colours = [style.COLOURS[k % len(style.COLOURS)] for k in range(len(rows))]
    fig = loop_rows(rows, 2.0, colours, 1.6, sharex="col", sharey=True)
    coloured = {"color": style.MUTED, "linewidth": 2.0}
    style.line_legend(fig, {"measured": {"color": style.INK, "linewidth": 0.9}, "model, in colour": coloured})
    return fig


@style.styled
def sensitivities(
    frequency: style.Array,
    amplitude: style.Array,
    sensitivity: style.Array,
    deviation: style.Array,
    mean: float,
) -> Figure:
    """Charge-to-force sensitivity (pC/N) and its deviation (share) of each calibration test, by frequency (Hz)."""
    shape = np.shape(frequency)
    given = {"frequency": frequency, "amplitude": amplitude, "sensitivity": sensitivity, "deviation": deviation}
    arrays = [style.finite(name, x, shape) for name, x in given.items()]
    fig = style.figure(3.6)
    top, bottom = style.column(fig, 2, sharex=True)
    handles = []
    for k, size in enumerate(sorted(set(np.round(arrays[1], 3)))):
        at = np.isclose(arrays[1], size)
        colour, marker = style.COLOURS[k % len(style.COLOURS)], style.MARKERS[k % len(style.MARKERS)]
        top.plot(arrays[0][at], arrays[2][at], marker, color=colour, markersize=5)
        bottom.plot(arrays[0][at], 100 * arrays[3][at], marker, color=colour, markersize=5)
        handles.append(Line2D([], [], color=colour, marker=marker, linestyle="", label=f"{size:g} N"))
    handles.append(top.axhline(mean, color=style.INK, linewidth=1.0, label=f"mean {mean:.1f} pC/N"))
    top.set_ylabel("sensitivity, pC/N")
    bottom.set_ylabel("deviation, %")
    bottom.set_ylim(0, style.padded(0.0, 100 * float(arrays[3].max()))[1])
    bottom.set_xscale("log")
    values = sorted(set(arrays[0]))
    bottom.set_xticks(values, [f"{v:.3g}" for v in values])
    bottom.minorticks_off()
    bottom.set_xlabel("frequency, Hz")
    style.legend(fig, handles, [str(h.get_label()) for h in handles])
    return fig


@style.styled
def calibration_signals(time: style.Array, force: style.Array, charge: style.Array) -> Figure:
    """Fig. 3: the driving force (n,) N and the charge (n,) pC of one test over time (n,) s."""
    fig = style.figure(3.2)
    top, bottom = style.column(fig, 2, sharex=True)
    for axes, values, name, colour in (
        (top, force, "force, N", style.COLOURS[0]),
        (bottom, 1e-3 * charge, "charge, nC", style.COLOURS[1]),
    ):
        axes.plot(time, values, color=colour, linewidth=1.2)
        axes.set_ylabel(name)
        style.ticks(axes, 6, 4)
    bottom.set_xlabel("time, s")
    return fig


@style.styled
def force_histories(shown: Mapping[str, tuple[style.Array, style.Array, style.Array]]) -> Figure:
    """Fig. 4: by name, time (n,) s, the load cell's force and the damper's own (n,) N, each in its own row."""
    style.require_some("force_histories", shown, "record")
    scale, unit = style.force_unit(*(cell for _, cell, _ in shown.values()))
    fig = style.figure(0.7 + 1.2 * len(shown))
    rows = style.column(fig, len(shown), sharex=True)
    for axes, (name, (time, cell, own)) in zip(rows, shown.items(), strict=True):
        axes.plot(time, scale * own, color=style.COLOURS[1], linewidth=2.2)
        axes.plot(time, scale * cell, color=style.INK, linewidth=0.8)
        style.row_title(axes, axes, name, "")
        axes.set_ylabel(f"force, {unit}")
        style.ticks(axes, 6, 4)
    rows[-1].set_xlabel("time, s")
    own_sensor = {"color": style.COLOURS[1], "linewidth": 2.2}
    style.line_legend(
        fig, {"load cell": {"color": style.INK, "linewidth": 0.9}, "the damper's own sensor": own_sensor}
    )
    return fig


@style.styled
def loops_by_command(shown: Mapping[str, tuple[style.Array, style.Array, style.Array]]) -> Figure:
    """Fig. 5: by name, displacement (m), velocity (m/s) and force (N), each (n,); all loops over each other."""
    style.require_some("loops_by_command", shown, "record")
    force, force_name = style.force_unit(*(f for _, _, f in shown.values()))
    length, length_name = style.length_unit(*(x for x, _, _ in shown.values()))
    speed, speed_name = style.velocity_unit(*(v for _, v, _ in shown.values()))
    fig = style.figure(3.2)
    left, right = style.axes_grid(fig, 1, 2, sharey=True)[0]
    for k, (x, v, f) in enumerate(shown.values()):
        part = style.thinned(slice(0, len(x)), 1500)
        look: dict[str, Any] = {"color": style.COLOURS[k % len(style.COLOURS)], "lw": 1.3}
        look["ls"] = style.DASHES[k % len(style.DASHES)]
        for axes, along in ((left, length * x), (right, speed * v)):
            axes.plot(along[part], force * f[part], **look)
    left.set_ylabel(f"force, {force_name}")
    left.set_xlabel(f"displacement, {length_name}")
    right.set_xlabel(f"velocity, {speed_name}")
    for axes in (left, right):
        style.ticks(axes, 5, 5)
    style.legend(fig, left.get_lines(), list(shown))
    return fig
