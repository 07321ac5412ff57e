"""Pictures of a frame under a ground motion: drifts, floors, controllers and their commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from mrdamp.errors import InputError
from mrdamp.pictures import style
from mrdamp.simulation.criteria import Criteria


@style.styled
def drifts(time: ArrayLike, drift: Mapping[str, ArrayLike]) -> Figure:
    """Storey drifts under each controller; the first is what the others are compared with.

    time (n,) s; drift: controller -> (n, N) m. On top the whole motion of the storey that drifts most;
    below it every storey, the top one first, over twelve mean periods where the first drifts most.
    """
    t = style.time_axis("time", time)
    runs = _runs("drifts", t, drift)
    names = list(runs)
    reference = runs[names[0]]
    storeys = reference.shape[1]
    worst = int(np.argmax(np.abs(reference).max(axis=0)))
    scale, unit = style.length_unit(*runs.values())
    window = style.busiest(t, reference[:, worst], 12.0)
    part = style.thinned(window, 3000)
    colour = style.colours(names)
    high = 1.05 if storeys <= 4 else 0.8
    fig = style.figure(0.6 + 1.25 + high * storeys)
    axes = style.column(fig, storeys + 1, height_ratios=[1.1, *[high] * storeys])
    top = axes[0]
    for name, run in runs.items():
        top.plot(*style.outline(t, scale * run[:, worst], 500), color=colour[name], linewidth=0.8)
    ends = t[window.start], t[window.stop - 1]
    top.axvspan(*ends, facecolor="none", edgecolor=style.INK, linewidth=0.8, linestyle=(0, (3, 2)))
    top.set_xlim(t[0], t[-1])
    top.set_title(f"storey {worst + 1}, whole motion (dashed: the part below)")
    for row, ax in enumerate(axes[1:]):
        storey = storeys - 1 - row
        for k, (name, run) in enumerate(runs.items()):
            ax.plot(t[part], scale * run[part, storey], **_look(k, name, colour))
        ax.set_xlim(t[part][0], t[part][-1])
        ax.set_title(f"storey {storey + 1}")
        ax.tick_params(labelbottom=row == storeys - 1)
    for ax in axes:
        style.ticks(ax, 7, 4 if storeys <= 4 else 3)
    fig.supylabel(f"drift, {unit}", fontsize=9.5)
    axes[-1].set_xlabel("time, s")
    style.line_legend(fig, {name: _look(k, name, colour) for k, name in enumerate(names)})
    return fig


@style.styled
def controllers(criteria: Mapping[str, Criteria], command_unit: str = "A") -> Figure:
    """Bars by controller: peak drift and acceleration over those of the first, peak force, mean command.

    The first one is the frame without a damper.
    """
    names, base = _reference("controllers", criteria)
    ratios = {name: c.relative_to(base) for name, c in criteria.items()}
    forces = np.array([criteria[name].peak_force for name in names])
    scale, unit = style.force_unit(forces)
    panels = (
        ("peak drift", "over uncontrolled", [ratios[n]["J1"] for n in names]),
        ("peak acceleration", "over uncontrolled", [ratios[n]["J2"] for n in names]),
        ("peak damper force", unit, [scale * f for f in forces]),
        ("mean command", command_unit, [criteria[n].mean_command for n in names]),
    )
    colour = style.colours(names)
    fig = style.figure(1.5 + 2 * 0.235 * len(names))
    axes = [ax for row in style.axes_grid(fig, 2, 2, sharey=True) for ax in row]
    for k, (ax, (title, label, values)) in enumerate(zip(axes, panels, strict=True)):
        largest = max(max(values), 1.0 if k < 2 else 0.0) or 1.0
        ax.barh(range(len(names)), values, 0.68, color=[colour[n] for n in names])
        for y, (value, name) in enumerate(zip(values, names, strict=True)):
            none = k >= 2 and criteria[name].peak_force == 0
            ax.text(
                value + 0.025 * largest, y, "no damper" if none else style.short(value),
                va="center", fontsize=9, color=style.MUTED if none else style.INK,
            )  # fmt: skip
        ax.set_xlim(0, 1.28 * largest)
        ax.set_title(title)
        ax.set_xlabel(label)
        style.ticks(ax, 4)
    style.name_rows(axes, names, 112)
    return fig


@style.styled
def profile(criteria: Mapping[str, Criteria], ground_peak: float | None = None) -> Figure:
    """Peak drift by storey and peak absolute acceleration by floor, over the height of the frame.

    ground_peak: m/s2 at the ground, None: the lines begin at the first floor.
    """
    names, base = _reference("profile", criteria)
    storeys = len(base.peak_drift)
    for name in names:
        if len(criteria[name].peak_drift) != storeys:
            other = len(criteria[name].peak_drift)
            raise InputError(f"picture: {name} has {other} storeys and {names[0]} has {storeys}")
    scale, unit = style.length_unit(*(c.peak_drift for c in criteria.values()))
    colour = style.colours(names)
    fig = style.figure(1.35 + (0.62 if storeys < 5 else 0.34) * max(storeys, 2))
    [[left, right]] = style.axes_grid(fig, 1, 2, sharey=True)
    floors = np.arange(storeys + 1)
    looks = {}
    for k, (name, c) in enumerate(criteria.items()):
        look = _look(k, name, colour)
        left.stairs(scale * c.peak_drift, floors, baseline=None, orientation="horizontal", **look)
        look |= {"marker": style.MARKERS[k % len(style.MARKERS)], "markersize": 4.5}
        ground = [] if ground_peak is None else [ground_peak]
        right.plot(np.append(ground, c.peak_acceleration), floors[1 - len(ground) :], **look)
        looks[name] = look
    left.set_ylim(-0.05 * storeys, 1.05 * storeys)
    left.set_yticks(floors, ["ground", *map(str, floors[1:])])
    left.set_ylabel("floor")
    left.set_xlabel(f"peak storey drift, {unit}")
    right.set_xlabel("peak acceleration, m/s²")
    for ax in (left, right):
        ax.set_xlim(left=0)
        style.ticks(ax, 5)
    style.line_legend(fig, looks)
    return fig


@style.styled
def command_history(
    time: ArrayLike,
    command: Mapping[str, ArrayLike],
    force: Mapping[str, ArrayLike],
    command_unit: str = "A",
    order: Sequence[str] | None = None,
) -> Figure:
    """The damper's force and the command that made it, for each controller, where the force is largest.

    time (n,) s; command: controller -> (n,) in command_unit, held between samples; force: controller ->
    (n,) N, the same controllers. order: the controllers of the other pictures, so that each has one colour in
    all of them; None: these, after an uncontrolled frame.
    """
    t = style.time_axis("time", time)
    commands = {name: style.finite(f"{name}: command", values, t.shape) for name, values in command.items()}
    if not commands or set(force) != set(commands):
        raise InputError(f"picture: commands of {list(command)} and forces of {list(force)}; name the same")
    forces = {name: style.finite(f"{name}: force", force[name], t.shape) for name in commands}
    names = list(commands)
    window = style.busiest(t, forces[names[-1]], 12.0)
    part = style.thinned(window, 4000)
    scale, unit = style.force_unit(*forces.values())
    most = style.peak(*commands.values()) or 1.0
    largest = style.padded(-style.peak(*forces.values()), style.peak(*forces.values()))
    colour = style.colours(["uncontrolled", *names]) | style.colours(order or [])
    fig = style.figure(0.45 + 1.85 * len(names))
    axes = style.column(fig, 2 * len(names), sharex=True, height_ratios=[2, 1] * len(names))
    for name, above, below in zip(names, axes[::2], axes[1::2], strict=True):
        above.axhline(0.0, color=style.MUTED, linewidth=0.7)
        above.plot(t[part], scale * forces[name][part], color=colour[name], linewidth=1.3)
        above.set_ylim(scale * largest[0], scale * largest[1])
        above.set_ylabel(f"force, {unit}")
        above.set_title(style.elide(name, 318, 9.5, "bold"))
        switched, level = style.staircase(t[window], commands[name][window])
        below.fill_between(switched, level, step="post", color=colour[name], alpha=0.35, linewidth=0)
        below.plot(switched, level, drawstyle="steps-post", color=colour[name], linewidth=1.0)
        below.set_ylim(min(0.0, float(commands[name].min())) - 0.08 * most, 1.12 * most)
        below.set_ylabel(command_unit)
        style.ticks(above, 7, 4)
        style.ticks(below, 7, 2)
    axes[-1].set_xlim(t[part][0], t[part][-1])
    axes[-1].set_xlabel("time, s")
    return fig


def _runs(what: str, time: style.Array, drift: Mapping[str, ArrayLike]) -> dict[str, style.Array]:
    runs = {name: np.asarray(values, dtype=np.float64) for name, values in drift.items()}
    style.require_some(what, runs, "controller")
    first = next(iter(runs.values()))
    storeys = first.shape[1] if first.ndim == 2 else 0
    shape = len(time), max(storeys, 1)
    return {name: style.finite(f"{name}: drift", values, shape) for name, values in runs.items()}


def _look(k: int, name: str, colour: Mapping[str, str]) -> dict[str, Any]:
    """Line of the k-th controller: the first one broad, the others distinguished by dashes as well."""
    return {
        "color": colour[name],
        "linewidth": 2.2 if k == 0 else 1.3,
        "linestyle": style.DASHES[max(k - 1, 0) % len(style.DASHES)],
    }


def _reference(what: str, criteria: Mapping[str, Criteria]) -> tuple[list[str], Criteria]:
    names = list(criteria)
    style.require_some(what, names, "controller")
    return names, criteria[names[0]]
