"""Pictures of force tracking: wanted and true force, and the command, of several inverses under each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from mrdamp.pictures.series import force_unit, padded, staircase, thinned
from mrdamp.pictures.style import (
    COLOURS,
    INK,
    MUTED,
    column,
    figure,
    line_legend,
    require_some,
    row_title,
    styled,
    ticks,
)

if TYPE_CHECKING:
    from mrdamp.inverse.tracking import Track

@styled
def force_tracking(tracks: Sequence[Track], command_unit: str = "A", seconds: float = 1.5) -> Figure:
    """Each run's force over the wanted one, its command below: the part of so many seconds with the largest force.

    tracks: of one wanted force. Raises InputError where there is none.
    """
    require_some("force_tracking", tracks, "run")
    first = tracks[0]
    step = float(first.time[1] - first.time[0])
    count = min(len(first.time), round(seconds / step))
    energy = np.concatenate([[0.0], np.cumsum(first.wanted**2)])
    start = int(np.argmax(energy[count:] - energy[:-count]))
    window = slice(start, start + count)
    part = thinned(window, 1200)
    scale, unit = force_unit(*(t.force for t in tracks))
    top = max(float(t.command.max()) for t in tracks)
    fig = figure(0.7 + 1.75 * len(tracks))
    heights = [height for _ in tracks for height in (1.0, 0.5)]
    axes = column(fig, 2 * len(tracks), sharex=True, height_ratios=heights)
    for k, run in enumerate(tracks):
        above, below = axes[2 * k], axes[2 * k + 1]
        above.plot(run.time[part], scale * run.wanted[part], color=INK, linewidth=0.9)
        colour = COLOURS[k % len(COLOURS)]
        above.plot(run.time[part], scale * run.force[part], color=colour, linewidth=1.5, zorder=1.9)
        row_title(above, above, run.name, f"RMS error {100 * run.relative_error:.1f} %")
        above.set_ylabel(f"force, {unit}")
        # Held between samples: a corner where it changes.
        below.step(*staircase(run.time[window], run.command[window]), where="post", color=colour, linewidth=1.0)
        below.set_ylim(*padded(0.0, top))
        below.set_ylabel(command_unit)
        ticks(above, 6, 4)
        ticks(below, 6, 2)
    axes[-1].set_xlim(float(first.time[start]), float(first.time[start + count - 1]))
    axes[-1].set_xlabel("time, s; below each force the command")
    fig.align_ylabels(axes)
    true = {"color": MUTED, "linewidth": 1.5}
    line_legend(fig, {"wanted": {"color": INK, "linewidth": 0.9}, "true force, in colour": true})
    return fig
