"""Draws the shares of the first table of docs/diagnosis/README.md: `python -m tools.diagnosis_picture`.

Each `N of M` of a row is a share with its Wilson interval: causes named, and controls without an invented cause.
Writes docs/pictures/diagnosis.png.
"""

from __future__ import annotations

import re
import sys
import textwrap
from pathlib import Path

from matplotlib.figure import Figure

from mrdamp.pictures.style import COLOURS, axes_grid, figure, styled
from studies.blindtest.score import Share

_DOCS = Path(__file__).resolve().parents[1] / "docs"
_PANELS = ("single causes named", "controls right")


def rows(text: str) -> list[tuple[str, tuple[Share | None, ...]]]:
    """Bench, and the shares of both columns; rows without a share of controls have None there."""
    out = []
    for line in text.splitlines():
        cells = [c.strip() for c in line.strip("|").split("|")]
        if len(cells) != 5 or "](" not in cells[0]:
            continue
        found = [re.match(r"(\d+) of (\d+)", c) for c in cells[3:]]
        shares = tuple(Share(int(m[1]), int(m[2])) if m else None for m in found)
        if shares[1] is not None:
            out.append((f"{re.sub(r'[][]|[(].*', '', cells[0])} ({cells[1]})", shares))
    return out


@styled
def draw(benches: list[tuple[str, tuple[Share | None, ...]]]) -> Figure:
    """One row for each bench, one panel for each column: share with its 95 % interval."""
    fig = figure(0.8 + 0.42 * len(benches))
    axes = axes_grid(fig, 1, 2, sharey=True)[0]
    for k, (ax, title) in enumerate(zip(axes, _PANELS, strict=True)):
        for y, (_, shares) in enumerate(benches):
            share = shares[k]
            if share is None:
                continue
            low, high = share.interval
            ax.plot([low, high], [y, y], color=COLOURS[0], linewidth=3.2, alpha=0.35)
            ax.plot([share.value], [y], "o", color=COLOURS[0], markersize=4.5)
            ax.annotate(f"{share.right} of {share.of}", (share.value, y), (0, 4), textcoords="offset points",
                        ha="right" if share.value > 0.8 else "center", fontsize=7)  # fmt: skip
        ax.set_xlim(0.0, 1.03)
        ax.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", ".25", ".5", ".75", "1"])
        ax.set_title(title, fontsize=9)
    labels = [textwrap.fill(name, 26) for name, _ in benches]
    axes[0].set_yticks(range(len(benches)), labels, fontsize=8)
    axes[0].set_ylim(len(benches) - 0.5, -0.7)
    return fig


def main() -> int:
    """The command line of this script."""
    benches = rows((_DOCS / "diagnosis" / "README.md").read_text(encoding="utf-8"))
    if not benches:
        print("docs/diagnosis/README.md: no row with shares in the first table", file=sys.stderr)
        return 1
    draw(benches).savefig(_DOCS / "pictures" / "diagnosis.png", dpi=150)
    return 0


if __name__ == "__main__":
    sys.exit(main())
