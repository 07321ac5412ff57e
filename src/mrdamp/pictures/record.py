"""Picture of a record."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from mrdamp.pictures.damper import BINS
from mrdamp.pictures.series import outline
from mrdamp.pictures.style import COLOURS, axes_grid, figure, styled, ticks

if TYPE_CHECKING:
    from mrdamp.records import Record


@styled
def channels(record: Record) -> Figure:
    """Every channel over time, a row each, in the units of the record."""
    shown = {name: values for name, values in record.channels.items() if name != "time_s"}
    fig = figure(0.5 + 0.9 * len(shown))
    rows = [row[0] for row in axes_grid(fig, len(shown), 1, sharex=True)]
    for ax, (name, values) in zip(rows, shown.items(), strict=True):
        ax.plot(*outline(record.time, values, BINS), color=COLOURS[0], linewidth=0.9)
        ax.set_title(name)
        ticks(ax, 6, 3)
    rows[-1].set_xlabel("time, s")
    return fig
