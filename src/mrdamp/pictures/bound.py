"""Pictures of the way to a clairvoyant command: shares by controller, and how the searches went."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from mrdamp.errors import InputError
from mrdamp.pictures.style import (
    COLOURS,
    DASHES,
    MUTED,
    SIMULATED,
    axes_grid,
    controllers_of,
    elide,
    figure,
    interval_legend,
    legend,
    styled,
    ticks,
)

Array = NDArray[np.float64]
_LEFT = -1.0  # shares below are drawn at the edge


@dataclass(frozen=True)
class Share:
    """A controller's share of the way with its interval (NaN: none), and that of every load (loads,)."""

    name: str
    mean: float
    low: float
    high: float
    loads: Array
    marked: bool = False


@styled
def shares(panels: Mapping[str, Sequence[Share]]) -> Figure:
    """Shares by controller, one panel a bound: dot with interval, a tick for each load; 0 passive-on, 1 the bound.

    panels: title -> the same controllers in the same order. Shares below -1 are drawn at -1.
    """
    names = controllers_of("shares", panels)
    fig = figure(0.9 + 0.22 * len(names))
    axes = axes_grid(fig, 1, len(panels), sharey=True)[0]
    for ax, (title, rows) in zip(axes, panels.items(), strict=True):
        ax.axvline(0.0, color=MUTED, linewidth=0.7)
        ax.axvline(1.0, color=MUTED, linewidth=0.7, linestyle=DASHES[2])
        for y, s in enumerate(rows):
            colour = SIMULATED if s.marked else COLOURS[0]
            at = np.maximum(s.loads[np.isfinite(s.loads)], _LEFT)
            ax.plot(
                at, np.full(len(at), y), marker="|", markersize=6, color=MUTED, linestyle="none", alpha=0.7
            )
            if np.isfinite(s.low):
                span = np.maximum([s.low, s.high], _LEFT)
                ax.plot(span, [y, y], color=colour, linewidth=3.2, alpha=0.35, solid_capstyle="butt")
            if np.isfinite(s.mean):
                ax.plot([max(s.mean, _LEFT)], [y], marker="o", markersize=4.5, color=colour, linestyle="none")
        ax.set_xlim(_LEFT - 0.06, 1.06)
        ax.set_title(elide(title.removeprefix("clairvoyant-"), 90, 9))
        ax.grid(False, axis="y")
        ax.tick_params(axis="y", length=0)
        ticks(ax, 3)
    axes[0].set_yticks(np.arange(len(names)), [elide(name, 110, 9) for name in names])
    axes[0].set_ylim(len(names) - 0.4, -0.6)
    interval_legend(fig, "all runs", "95 %", "one motion")
    return fig


@styled
def search_paths(panels: Mapping[str, Mapping[str, Sequence[float]]]) -> Figure:
    """The best value so far over the steps of each search; panels: bound -> start -> values."""
    if not panels or not all(panels.values()):
        raise InputError("picture: search_paths has nothing to show; give at least one search")
    names = list(dict.fromkeys(name for lines in panels.values() for name in lines))
    looks: dict[str, dict[str, Any]] = {
        name: {"color": COLOURS[k % len(COLOURS)], "linestyle": DASHES[k // len(COLOURS) % len(DASHES)]}
        for k, name in enumerate(names)
    }
    fig = figure(2.8)
    axes = axes_grid(fig, 1, len(panels))[0]
    for ax, (title, lines) in zip(axes, panels.items(), strict=True):
        for name, values in lines.items():
            ax.plot(np.arange(len(values)), np.asarray(values, dtype=np.float64), **looks[name])
        ax.set_title(elide(title.removeprefix("clairvoyant-"), 100, 9))
        ax.set_xlabel("step")
        ticks(ax, 4, 5)
    legend(fig, [Line2D([], [], **looks[name]) for name in names], [elide(name, 110, 9) for name in names])
    return fig
