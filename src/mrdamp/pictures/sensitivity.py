"""Pictures of a sensitivity study: which effect is found in which size, and what is taken for what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from mrdamp.pictures.style import COLOURS, INK, REFERENCE, SIMULATED, figure, legend, styled

#: Outcome -> colour, opacity, sign in the cell, words.
_LOOK: Mapping[str, tuple[str, float, str, str]] = {
    "named": (COLOURS[0], 1.0, "+", "named"),
    "unsure": (COLOURS[0], 0.45, "±", "in a tie"),
    "already": (COLOURS[2], 0.6, "=", "there already"),
    "unknown": (REFERENCE, 0.55, "?", "unknown"),
    "parameters": (REFERENCE, 0.3, "p", "parameters"),
    "none": (REFERENCE, 0.12, "–", "nothing new"),
    "wrong": (SIMULATED, 1.0, "×", "another named"),
    "failed": (COLOURS[3], 0.8, "!", "failed"),
}
#: Outcomes that have a cell; a picture needs one at least.
DRAWN = frozenset(_LOOK)


@styled
def detection(
    effects: Sequence[str], sizes: Sequence[float], outcomes: Sequence[Mapping[float, str]]
) -> Figure:
    """Outcome of every effect (rows) by size (columns, shares of the RMS force); an empty cell was not tried or has
    no strength that reaches the size."""
    fig = figure(0.2 * len(effects) + 1.1)
    ax = fig.add_subplot()
    ax.grid(visible=False)
    for j, found in enumerate(outcomes):
        for k, size in enumerate(sizes):
            look = _LOOK.get(found.get(size, ""))
            if look is None:
                continue
            colour, alpha, sign, _ = look
            ax.add_patch(
                Rectangle((k - 0.48, j - 0.46), 0.96, 0.92, facecolor=colour, alpha=alpha, linewidth=0)
            )
            ax.text(k, j, sign, ha="center", va="center", fontsize=8, color="white" if alpha >= 0.8 else INK)
    ax.set_xticks(range(len(sizes)), [f"{100 * s:.3g} %" for s in sizes])
    ax.set_yticks(range(len(effects)), list(effects), fontsize=8.5)
    ax.set_xlim(-0.55, len(sizes) - 0.45)
    ax.set_ylim(len(effects) - 0.45, -0.55)
    ax.set_xlabel("size: change of the residual over the RMS force")
    there = [look for outcome, look in _LOOK.items() if any(outcome in found.values() for found in outcomes)]
    handles = [Patch(facecolor=colour, alpha=alpha, linewidth=0) for colour, alpha, *_ in there]
    legend(fig, handles, [f"{sign} {words}" for *_, sign, words in there])
    return fig


@styled
def confusion(counts: Sequence[Sequence[int]], rows: Sequence[str], columns: Sequence[str]) -> Figure:
    """Counts of answers (columns) by truth (rows); the first columns are named as the rows are."""
    table = np.asarray(counts, dtype=float)
    share = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    fig = figure(0.155 * len(rows) + 1.75)
    ax = fig.add_subplot()
    ax.grid(visible=False)
    for j, k in zip(*np.nonzero(table), strict=True):
        colour = COLOURS[0] if rows[j] == columns[k] else SIMULATED
        alpha = 0.25 + 0.75 * share[j, k]
        ax.add_patch(Rectangle((k - 0.48, j - 0.48), 0.96, 0.96, facecolor=colour, alpha=alpha, linewidth=0))
        pale = share[j, k] < 0.5
        ax.text(
            k, j, f"{table[j, k]:.0f}", ha="center", va="center", fontsize=7, color=INK if pale else "white"
        )
    ax.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
    ax.set_yticks(range(len(rows)), rows, fontsize=7)
    ax.set_xlim(-0.6, len(columns) - 0.4)
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_xlabel("answered")
    ax.set_ylabel("true")
    return fig
