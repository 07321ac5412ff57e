"""Pictures of a blind test: how far stated probabilities hold, and the shrinking gap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from mrdamp.pictures.style import (
    COLOURS,
    MUTED,
    REFERENCE,
    SIMULATED,
    figure,
    legend,
    log_percent,
    styled,
    ticks,
)


@styled
def reliability(
    stated: Sequence[float],
    found: Sequence[float],
    low: Sequence[float],
    high: Sequence[float],
    of: Sequence[int],
) -> Figure:
    """Share of right answers by the probability that they gave themselves, with 95 % intervals and counts."""
    fig = figure(2.9)
    ax = fig.add_subplot()
    ideal = ax.plot([0, 1], [0, 1], color=REFERENCE, linewidth=1.0)[0]
    error = [np.subtract(found, low), np.subtract(high, found)]
    ax.errorbar(stated, found, yerr=np.abs(error), fmt="none", color=COLOURS[0], linewidth=1.0)
    dots = ax.plot(stated, found, "o", color=COLOURS[0], markersize=4)[0]
    for x, y, n in zip(stated, found, of, strict=True):
        ax.annotate(str(n), (x, y), (5, -9), textcoords="offset points", fontsize=8, color=MUTED)
    ax.set_xlim(0, 1.02)
    ax.set_ylim(-0.02, 1.04)
    ax.set_xlabel("probability that the answer states")
    ax.set_ylabel("share of right answers")
    ticks(ax, 5, 5)
    legend(fig, [ideal, dots], ["as it should be", "answers (their number beside)"])
    return fig


@styled
def shrinking(before: Sequence[float], after: Sequence[float], right: Sequence[bool]) -> Figure:
    """Gap of the nominal and of the corrected model on unseen tests, case by case, in order of the nominal gap."""
    order = np.argsort(before)
    fig = figure(2.7)
    ax = fig.add_subplot()
    x = np.arange(len(order))
    b, a = (100 * np.asarray(values)[order] for values in (before, after))
    ok = np.asarray(right, dtype=bool)[order]
    ax.vlines(x, a, b, color=REFERENCE, linewidth=0.6)
    nominal = ax.plot(x, b, ".", color=MUTED, markersize=4)[0]
    good = ax.plot(x[ok], a[ok], "o", color=COLOURS[0], markersize=3.5)[0]
    missed = ax.plot(x[~ok], a[~ok], "s", color=SIMULATED, markersize=3.5)[0]
    log_percent(ax)
    ax.set_xticks([])
    ax.set_xlabel("cases with an effect")
    ax.set_ylabel("gap on unseen tests, %")
    legend(fig, [nominal, good, missed], ["nominal", "corrected, right cause", "corrected, wrong cause"])
    return fig
