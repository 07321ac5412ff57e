"""Pictures of a damper with its own force sensor: Figs. 3 to 5 of the self-sensing paper."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mrdamp.errors import InputError
from mrdamp.pictures.series import Array, force_unit, length_unit, thinned, velocity_unit
from mrdamp.pictures.style import COLOURS, DASHES, INK, axes_grid, figure, legend, row_title, styled, ticks


@styled
def calibration_signals(time: Array, force: Array, charge: Array) -> Figure:
    """Fig. 3: the driving force (n,) N and the charge (n,) pC of one test over time (n,) s."""
    fig = figure(3.2)
    top, bottom = (row[0] for row in axes_grid(fig, 2, 1, sharex=True))
    for axes, values, name, colour in (
        (top, force, "force, N", COLOURS[0]),
        (bottom, 1e-3 * charge, "charge, nC", COLOURS[1]),
    ):
        axes.plot(time, values, color=colour, linewidth=1.2)
        axes.set_ylabel(name)
        ticks(axes, 6, 4)
    bottom.set_xlabel("time, s")
    return fig


@styled
def force_histories(shown: Mapping[str, tuple[Array, Array, Array]]) -> Figure:
    """Fig. 4: by name, time (n,) s, the load cell's force and the damper's own (n,) N, each in its own row."""
    if not shown:
        raise InputError("picture: force_histories has nothing to show; give at least one record")
    scale, unit = force_unit(*(cell for _, cell, _ in shown.values()))
    fig = figure(0.7 + 1.2 * len(shown))
    rows = [row[0] for row in axes_grid(fig, len(shown), 1, sharex=True)]
    for axes, (name, (time, cell, own)) in zip(rows, shown.items(), strict=True):
        axes.plot(time, scale * own, color=COLOURS[1], linewidth=2.2)
        axes.plot(time, scale * cell, color=INK, linewidth=0.8)
        row_title(axes, axes, name, "")
        axes.set_ylabel(f"force, {unit}")
        ticks(axes, 6, 4)
    rows[-1].set_xlabel("time, s")
    handles = [Line2D([], [], color=INK, linewidth=0.9), Line2D([], [], color=COLOURS[1], linewidth=2.2)]
    legend(fig, handles, ["load cell", "the damper's own sensor"])
    return fig


@styled
def loops_by_command(shown: Mapping[str, tuple[Array, Array, Array]]) -> Figure:
    """Fig. 5: by name, displacement (m), velocity (m/s) and force (N), each (n,); all loops over each other."""
    if not shown:
        raise InputError("picture: loops_by_command has nothing to show; give at least one record")
    force, force_name = force_unit(*(f for _, _, f in shown.values()))
    length, length_name = length_unit(*(x for x, _, _ in shown.values()))
    speed, speed_name = velocity_unit(*(v for _, v, _ in shown.values()))
    fig = figure(3.2)
    left, right = axes_grid(fig, 1, 2, sharey=True)[0]
    for k, (x, v, f) in enumerate(shown.values()):
        part = thinned(slice(0, len(x)), 1500)
        for axes, along in ((left, length * x), (right, speed * v)):
            axes.plot(along[part], force * f[part], color=COLOURS[k % len(COLOURS)], ls=DASHES[k % len(DASHES)], lw=1.3)
    left.set_ylabel(f"force, {force_name}")
    left.set_xlabel(f"displacement, {length_name}")
    right.set_xlabel(f"velocity, {speed_name}")
    for axes in (left, right):
        ticks(axes, 5, 5)
    legend(fig, left.get_lines(), list(shown))
    return fig
