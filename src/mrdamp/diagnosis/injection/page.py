"""Page of a sensitivity study."""

from __future__ import annotations

from collections.abc import Sequence

from mrdamp.diagnosis.injection.sensitivity import AS_THEY_ARE, Answer, Study, due
from mrdamp.diagnosis.injection.summary import confusion, findings, own_effects, percent, sentence
from mrdamp.pictures.sensitivity import DRAWN, detection
from mrdamp.pictures.sensitivity import confusion as confusion_picture
from mrdamp.report import Cell, Page


def page(study: Study, answers: Sequence[Answer]) -> Page:
    """Detection by effect and size, confusions, effects that cannot be shown, and every trial."""
    state = (
        ""
        if not (left := len(due(study, answers)))
        else f"{len(answers)} trials done so far, at most {left} to come."
    )
    out = Page(f"Detection limits on {study.case.name}", sentence(study, answers), state)
    found = findings(answers)
    if any(outcome in DRAWN for f in found for outcome in f.outcomes.values()):
        sizes = sorted({s for f in found for s in f.outcomes})
        out.figure(
            "Detection by effect and size",
            detection([f.effect for f in found], sizes, [f.outcomes for f in found]),
            "Each effect is injected into the case's own records, which are then diagnosed. Empty cell: no"
            " strength of the effect changes the residual by so much, or it was not found in a larger size.",
            "A table of outcomes: effects in rows, sizes as shares of the RMS force in columns.",
        )
        rows: list[list[Cell]] = [
            [
                f.effect,
                percent(f.named_from) if f.named_from is not None else None,
                ", ".join(f"{k} {v:.3g}" for k, v in f.parameters.items()) or None,
                ", ".join(f.taken_for) or None,
            ]
            for f in found
        ]
        heads = ["effect", "named from", "parameters", "mistaken for"]
        if all(row[-1] is None for row in rows):
            heads, rows = heads[:-1], [row[:-1] for row in rows]
        out.table(
            "Detection limit",
            heads,
            rows,
            "Named from: the least size from which on every larger one is named. Parameters as injected, SI units.",
        )
        names, columns, counts = confusion(answers)
        if len(columns) > 1:
            out.figure(
                "Confusion",
                confusion_picture(counts, names, columns),
                "Answers over all sizes. Blue: the injected effect.",
                "A table of counts of answers by the injected effect, on its diagonal where answers are right.",
            )
    for heading, reasons in (
        ("Effects that these records cannot show", study.never),
        ("Not tried", study.untried),
    ):
        if reasons:
            out.table(heading, ["effect", "why"], [[e, w] for e, w in reasons.items()])
    own = own_effects(answers)
    if own is not None:
        (as_is,) = (a for a in answers if a.effect == AS_THEY_ARE)
        out.text("Unchanged records", as_is.sentence or f"verdict {as_is.verdict}")
    out.table(
        "Every trial",
        ["effect", "size", "answer", "named", "gap before", "after", "s"],
        [
            [
                a.effect,
                percent(a.size),
                a.error or (a.verdict if a.reached else "out of reach"),
                ", ".join(a.named) or None,
                a.nominal_gap,
                a.corrected_gap,
                round(a.seconds),
            ]
            for a in answers
        ],
    )
    return out
