"""Pictures of an identification: parameters over the command, models over each other, a calibrated sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mrdamp.errors import InputError
from mrdamp.pictures.series import (
    Array,
    busiest,
    finite,
    force_unit,
    length_unit,
    padded,
    thinned,
    velocity_unit,
)  # fmt: skip
from mrdamp.pictures.style import (
    COLOURS,
    INK,
    MARKERS,
    MUTED,
    axes_grid,
    figure,
    legend,
    row_title,
    styled,
    ticks,
)  # fmt: skip


@styled
def parameter_lines(
    names: Sequence[str],
    units: Sequence[str],
    commands: Array,
    values: Sequence[Array],
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
    commands = finite("commands", commands)
    rows = (len(names) + 1) // 2
    fig = figure(0.6 + 1.35 * rows)
    axes = [ax for row in axes_grid(fig, rows, 2, sharex=True) for ax in row]
    span = np.array(padded(min(0.0, float(commands.min())), float(commands.max())))
    for ax, name, unit, series, (zero, slope) in zip(axes, names, units, values, lines, strict=False):
        series = finite(name, series, commands.shape)
        ax.plot(span, zero + slope * span, color=COLOURS[1], linewidth=1.4)
        ax.plot(commands, series, "o", color=INK, markersize=4.5)
        ax.set_xlim(*span)
        low = min(float(series.min()), float((zero + slope * commands).min()))
        high = max(float(series.max()), float((zero + slope * commands).max()))
        ax.set_ylim(*padded(min(low, 0.0) if low > 0 or high < 0 else low, high))
        row_title(ax, ax, name, unit)
        ticks(ax, 4, 4)
    for ax in axes[len(names) :]:
        ax.set_visible(False)
    for ax in axes[max(0, len(names) - 2) : len(names)]:
        ax.tick_params(labelbottom=True)
        ax.set_xlabel(f"command, {command_unit}")
    legend(
        fig,
        [
            Line2D([], [], color=INK, marker="o", linestyle="", markersize=4.5),
            Line2D([], [], color=COLOURS[1]),
        ],
        ["fit at one command", "line through them"],
    )
    return fig


@styled
def model_loops(
    time: Array, displacement: Array, velocity: Array, measured: Array, simulated: Mapping[str, Array]
) -> Figure:
    """One record's loops over displacement and over velocity, every model in its own row over the measurement."""
    if not simulated:
        raise InputError("picture: model_loops has nothing to show; give at least one model")
    part = thinned(busiest(time, displacement, 2.0, velocity), 1500)
    force, force_name = force_unit(measured)
    length, length_name = length_unit(displacement)
    speed, speed_name = velocity_unit(velocity[part])
    fig = figure(0.75 + 1.6 * len(simulated))
    axes = axes_grid(fig, len(simulated), 2, sharex="col", sharey=True)
    for count, ((name, model), (left, right)) in enumerate(zip(simulated.items(), axes, strict=True)):
        model = finite(name, model, measured.shape)
        for ax, x in ((left, length * displacement), (right, speed * velocity)):
            ax.plot(x[part], force * model[part], color=COLOURS[count % len(COLOURS)], linewidth=2.0)
            ax.plot(x[part], force * measured[part], color=INK, linewidth=0.7)
            ticks(ax, 5, 5)
        row_title(left, right, name, "")
        left.set_ylabel(f"force, {force_name}")
    axes[-1][0].set_xlabel(f"displacement, {length_name}")
    axes[-1][1].set_xlabel(f"velocity, {speed_name}")
    legend(
        fig,
        [Line2D([], [], color=INK, linewidth=0.9), Line2D([], [], color=MUTED, linewidth=2.0)],
        ["measured", "model, in colour"],
    )
    return fig


@styled
def sensitivities(
    frequency: Array, amplitude: Array, sensitivity: Array, deviation: Array, mean: float
) -> Figure:
    """Charge-to-force sensitivity (pC/N) and its deviation (share) of each calibration test, by frequency (Hz)."""
    shape = np.shape(frequency)
    arrays = [
        finite(n, x, shape)
        for n, x in (
            ("frequency", frequency),
            ("amplitude", amplitude),
            ("sensitivity", sensitivity),
            ("deviation", deviation),
        )
    ]
    fig = figure(3.6)
    top, bottom = (row[0] for row in axes_grid(fig, 2, 1, sharex=True))
    handles = []
    for k, size in enumerate(sorted(set(np.round(arrays[1], 3)))):
        at = np.isclose(arrays[1], size)
        colour, marker = COLOURS[k % len(COLOURS)], MARKERS[k % len(MARKERS)]
        top.plot(arrays[0][at], arrays[2][at], marker, color=colour, markersize=5)
        bottom.plot(arrays[0][at], 100 * arrays[3][at], marker, color=colour, markersize=5)
        handles.append(Line2D([], [], color=colour, marker=marker, linestyle="", label=f"{size:.0f} N"))
    handles.append(top.axhline(mean, color=INK, linewidth=1.0, label=f"mean {mean:.1f} pC/N"))
    top.set_ylabel("sensitivity, pC/N")
    bottom.set_ylabel("deviation, %")
    bottom.set_ylim(0, padded(0.0, 100 * float(arrays[3].max()))[1])
    bottom.set_xscale("log")
    values = sorted(set(arrays[0]))
    bottom.set_xticks(values, [f"{v:.3g}" for v in values])
    bottom.minorticks_off()
    bottom.set_xlabel("frequency, Hz")
    legend(fig, handles, [str(h.get_label()) for h in handles])
    return fig
