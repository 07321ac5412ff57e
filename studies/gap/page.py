"""The table, picture and page of a gap study."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from mrdamp import __version__
from mrdamp.gap import CRITERIA
from mrdamp.pictures.style import COLOURS, REFERENCE, axes_grid, elide, figure, legend, styled
from mrdamp.report import Cell, Page
from studies.gap.real import NONE
from studies.gap.study import Row, Study

_SCORES = (
    ("real", "tuned on the nominal simulator"),
    ("blind", "tuned on a blindly randomised one"),
    ("retuned", "tuned on the corrected one"),
    ("randomised", "tuned on draws from its intervals"),
    ("direct", "tuned on the real frame itself"),
)
COLUMNS = ("real frame", "diagnosis", "nominal error", "corrected error", "closed", "95 % interval")


def gap_rows(study: Study) -> list[tuple[str, ...]]:
    """Rows under `COLUMNS`."""
    return [
        (
            r.cause,
            " + ".join(r.named) or r.verdict,
            f"{100 * r.nominal:.1f} %",
            f"{100 * r.corrected:.1f} %",
            f"{100 * r.closed:.0f} %",
            f"{100 * r.interval[0]:.0f} to {100 * r.interval[1]:.0f} %" if r.interval else "one motion: none",
        )
        for r in study.rows
    ]


def ways(study: Study) -> list[tuple[str, str]]:
    """Ways of tuning that there are scores of: attribute of `Row`, and what to call it."""
    rows = [r for r in study.rows if r.retuned is not None]
    return [
        (name, text) for name, text in _SCORES if rows and all(getattr(r, name) is not None for r in rows)
    ]


def score_rows(study: Study) -> list[tuple[Cell, ...]]:
    """Scores on the real frames, a column for each of `ways`; none for a controller that is not tuned."""
    return [
        (r.cause, *(getattr(r, name) for name, _ in ways(study))) for r in study.rows if r.retuned is not None
    ]


def page(study: Study) -> Page:
    """The whole page."""
    caused = [r for r in study.rows if r.cause != NONE]
    said = []
    if study.law:
        said.append(
            f"The real damper has another law than the simulator's ({study.law}), which leaves "
            f"{100 * study.misfit:.0f} % of its force on the bench."
        )
    if caused:
        named = sum(r.named == (r.cause,) for r in caused)
        closed = float(np.median([r.closed for r in caused]))
        said += [
            f"Each real frame differs from the simulator by one effect. The diagnosis named it on {named} of "
            f"{len(caused)}.",
            f"The corrected simulator closed {100 * closed:.0f} % of the gap in the controller's criteria (median).",
        ]
    if len(caused) < len(study.rows):
        invented = any(r.named for r in study.rows if r.cause == NONE)
        said.append(f"On the frame without an effect {'a' if invented else 'no'} cause was named.")
    out = Page(
        f"Sim-to-real gap of {study.controller}",
        " ".join(said),
        f"mrdamp {__version__}, `python -m studies.gap`",
    )
    out.figure(
        "Error of the simulator",
        errors(study),
        "Mean relative error of the simulator in peak and RMS drift and acceleration, on held-out motions. Without an "
        f"effect, rig and nominal simulator differ by {100 * study.alike:.1f} %.",
        "Bars: "
        + ", ".join(f"{r.cause} {100 * r.nominal:.0f} % to {100 * r.corrected:.0f} %" for r in study.rows),
    )
    out.table("", COLUMNS, gap_rows(study))
    names = [n.replace("_", " ").replace("rms", "RMS") for n in CRITERIA]
    rows = [(r.cause, *(_pair(r, name) for name in CRITERIA)) for r in study.rows]
    out.table("", ("real frame", *names), rows, "Relative error, nominal and corrected, %.")
    table = score_rows(study)
    if table:
        out.table(
            "Score of the controller",
            ("real frame", *(_short(text) for _, text in ways(study))),
            table,
            "Columns: what the controller was tuned on. Score on the real frame, smaller is better: mean of peak drift "
            "and peak acceleration over those of the "
            f"frame without a damper in the nominal simulator. There {study.controller} has {study.promised:.3f}.",
        )
        out.figure("", scores(study), "Score on the real frame by the simulator that it was tuned on.",
                   "Bars of the table above.")  # fmt: skip
    return out


@styled
def errors(study: Study) -> Figure:
    """Bars a real frame: the simulator's error before and after the correction."""
    fig = figure(0.7 + 0.42 * len(study.rows))
    ax = axes_grid(fig, 1, 1)[0][0]
    y = np.arange(len(study.rows))
    before, after = (100 * np.array([getattr(r, k) for r in study.rows]) for k in ("nominal", "corrected"))
    ax.barh(y - 0.19, before, height=0.36, color=REFERENCE)
    ax.barh(y + 0.19, after, height=0.36, color=COLOURS[0])
    ax.set_yticks(y, [elide(r.cause, 120) for r in study.rows])
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.axvline(100 * study.alike, color="black", linestyle=":", linewidth=1)
    ax.set_xlabel("error in the controller's criteria, %")
    marks = [
        Patch(color=REFERENCE),
        Patch(color=COLOURS[0]),
        Line2D([], [], color="black", linestyle=":", linewidth=1),
    ]
    legend(fig, marks, ["nominal", "corrected", "rig without an effect"])
    return fig


@styled
def scores(study: Study) -> Figure:
    """Bars a real frame: the score by the simulator that the controller was tuned on."""
    rows = [r for r in study.rows if r.retuned is not None]
    fig = figure(0.9 + 0.72 * len(rows))
    ax = axes_grid(fig, 1, 1)[0][0]
    shown = ways(study)
    of = dict(
        zip([name for name, _ in _SCORES], (REFERENCE, *(COLOURS[k] for k in (5, 0, 2, 1))), strict=True)
    )
    colours = [of[name] for name, _ in shown]
    y, width = np.arange(len(rows)), 0.8 / len(shown)
    for k, ((name, _), colour) in enumerate(zip(shown, colours, strict=True)):
        ax.barh(
            y + (k - (len(shown) - 1) / 2) * width,
            [getattr(r, name) for r in rows],
            height=width,
            color=colour,
        )
    ax.set_yticks(y, [elide(r.cause, 120) for r in rows])
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("score on the real frame")
    legend(fig, [Patch(color=c) for c in colours], [text for _, text in shown])
    return fig


def _short(text: str) -> str:
    return text.removeprefix("tuned on ").removeprefix("the ").removeprefix("a ")


def _pair(row: Row, name: str) -> str:
    before, after = row.errors[name]
    return f"{100 * before:.1f} to {100 * after:.1f}"
