"""Page and tables of a blind test."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from mrdamp.files import write_atomic
from mrdamp.pictures.sensitivity import confusion as confusion_picture
from mrdamp.report import Cell, Page
from studies.blindtest import misfit_score, pictures, rows_file, score
from studies.blindtest.score import Numbers, Row, Share

#: Target of each figure.
WANTED = {
    "single effects named": 0.95,
    "pairs named": 0.80,
    "stage": 0.98,
    "no false alarm (none, parameters)": 1.0,
    "unknown recognised": 0.95,
}
_SEVERAL = "several"
_MISFIT = "Where the law is not the rig's"


def write(out: Path, rows: Sequence[Row], seal: str, baselines: Mapping[str, Sequence[Row]]) -> None:
    """Writes index.html, results.md, rows.csv and rows.json into a folder. baselines: rows of other methods on the
    same cases."""
    figures, numbers = score.shares(rows), score.numbers(rows)
    write_atomic(out / "rows.csv", _csv(rows))
    rows_file.write(out / "rows.json", rows)
    write_atomic(out / "results.md", markdown(rows, seal, baselines))
    page = Page(
        "Blind test of the diagnosis", _summary(rows, figures, numbers), f"SHA-256 of the labels: {seal}"
    )
    page.table("Figures", _FIGURE_COLUMNS, _figure_rows(figures))
    page.table("", ["figure", "value", "to reach"], _number_rows(numbers))
    if misfit_score.is_misfit(rows):
        page.table(_MISFIT, misfit_score.COLUMNS, misfit_score.table(rows))
    if baselines:
        page.table("Beside simpler methods", *_baseline_table({"diagnosis": rows, **baselines}))
    names, columns, counts = confusion(rows)
    page.figure(
        "What was taken for what",
        confusion_picture(counts, names, columns),
        "Cases with one cause, none, wrong numbers alone, or a cause outside the catalogue. Blue: right.",
        "A table of counts of the answered causes by the true ones, mostly on its diagonal where answers are right.",
    )
    bins = score.reliability(rows)
    if bins:
        page.figure(
            "Do the probabilities hold?",
            pictures.reliability(
                [b.stated for b in bins],
                [b.share.value for b in bins],
                [b.share.interval[0] for b in bins],
                [b.share.interval[1] for b in bins],
                [b.share.of for b in bins],
            ),
            f"Expected calibration error {numbers.calibration_error:.3f}.",
            "Share of right answers over the probability that they stated, with the diagonal for comparison.",
        )
    shrunk = [r for r in rows if r.want == "effect" and math.isfinite(r.shrink)]
    if shrunk:
        page.figure(
            "Reduction of the gap",
            pictures.shrinking(
                [r.before for r in shrunk], [r.after for r in shrunk], [r.right for r in shrunk]
            ),
            "On held-out tests, without noise.",
            "Gaps of the nominal and of the corrected model by case, on a logarithmic scale.",
        )
    page.table("By cause", ["cause", "right", "of", "wrong answers"], by_cause(rows))
    page.table("Misses", ["case", "true", "answered", "gap before", "after", "s"], _misses(rows))
    page.write(out / "index.html")


_FIGURE_COLUMNS = ["figure", "right", "of", "share", "95 % interval", "to reach"]


def _figure_rows(figures: Mapping[str, Share]) -> list[list[Cell]]:
    rows: list[list[Cell]] = []
    for name, share in figures.items():
        if share.of:
            low, high = share.interval
            wanted = f"{WANTED[name]:.2f}" if name in WANTED else ""
            rows.append(
                [
                    name,
                    str(share.right),
                    str(share.of),
                    f"{share.value:.3f}",
                    f"{low:.2f} to {high:.2f}",
                    wanted,
                ]
            )
    return rows


def _number_rows(n: Numbers) -> list[list[Cell]]:
    exact, most = n.exact_calibration_error
    return [
        [f"shrink on unseen tests, median ({n.shrink_count} cases)", f"{n.shrink_median:.3f}", "0.95"],
        ["shrink on unseen tests, worst tenth", f"{n.shrink_worst_tenth:.3f}", "0.85"],
        ["expected calibration error", f"{n.calibration_error:.3f}", "0.05"],
        ["the same for exact probabilities, mean and .95 quantile", f"{exact:.3f}, {most:.3f}", ""],
        ["seconds a case, median", f"{n.seconds_median:.1f}", "30"],
        ["seconds a case, worst", f"{n.seconds_worst:.1f}", "90"],
    ]


def markdown(rows: Sequence[Row], seal: str, baselines: Mapping[str, Sequence[Row]]) -> str:
    """The tables as Markdown."""
    figures, numbers = score.shares(rows), score.numbers(rows)
    parts = [
        "# Blind test of the diagnosis\n",
        _summary(rows, figures, numbers) + "\n",
        f"SHA-256 of salt and labels, printed before the first diagnosis: `{seal}`\n",
        _table(_FIGURE_COLUMNS, _figure_rows(figures)),
        _table(["figure", "value", "to reach"], _number_rows(numbers)),
    ]
    if misfit_score.is_misfit(rows):
        parts += [f"## {_MISFIT}\n", _table(misfit_score.COLUMNS, misfit_score.table(rows))]
    if baselines:
        parts += ["## Beside simpler methods\n", _table(*_baseline_table({"diagnosis": rows, **baselines}))]
    parts += ["## By cause\n", _table(["cause", "right", "of", "wrong answers"], by_cause(rows))]
    parts += ["## Misses\n", _table(["case", "true", "answered", "gap before", "after", "s"], _misses(rows))]
    return "\n".join(parts)


def confusion(rows: Sequence[Row]) -> tuple[list[str], list[str], list[list[int]]]:
    """Names of the rows and columns, and counts, for cases with at most one cause; places are ignored."""
    pairs = Counter((_true(r), _answered(r)) for r in rows if len(r.causes) <= 1)
    names = sorted({t for t, _ in pairs}, key=_order)
    columns = sorted({*names, *(a for _, a in pairs)}, key=_order)
    return names, columns, [[pairs[(t, a)] for a in columns] for t in names]


def by_cause(rows: Sequence[Row]) -> list[list[Cell]]:
    """By cause (pairs included): right cases, cases, and the answers of the others."""
    causes = sorted({name for r in rows for name in _parts(r)}, key=_order)
    table: list[list[Cell]] = []
    for cause in causes:
        own = [r for r in rows if cause in _parts(r)]
        others = Counter(answer_text(r) for r in own if not r.right)
        text = ", ".join(f"{what} ({n})" if n > 1 else what for what, n in others.most_common())
        table.append([cause, str(sum(r.right for r in own)), str(len(own)), text])
    return table


def _summary(rows: Sequence[Row], figures: Mapping[str, Share], n: Numbers) -> str:
    named = {
        "single effects": "single effects named",
        "pairs": "pairs named",
        "unknown causes recognised": "unknown recognised",
        "no false alarm": "no false alarm (none, parameters)",
        "no false cause": "controls without an invented cause",
    }
    parts = [f"{words} {figures[name].value:.2f}" for words, name in named.items() if figures[name].of]
    return (
        f"{figures['all'].right} of {len(rows)} cases answered correctly; {', '.join(parts)}; on unseen tests the gap "
        f"shrinks by {n.shrink_median:.2f} (median)."
    )


def _baseline_table(methods: Mapping[str, Sequence[Row]]) -> tuple[list[str], list[list[Cell]]]:
    columns = [
        "method",
        "single",
        "pairs",
        "no false alarm",
        "unknown",
        "stage",
        "shrink median",
        "worst tenth",
        "s",
    ]
    keys = [
        "single effects named",
        "pairs named",
        "no false alarm (none, parameters)",
        "unknown recognised",
        "stage",
    ]
    table: list[list[Cell]] = []
    for name, rows in methods.items():
        shares, n = score.shares(rows), score.numbers(rows)
        values = [*(shares[k].value for k in keys), n.shrink_median, n.shrink_worst_tenth]
        table.append(
            [name, *(f"{v:.2f}" if math.isfinite(v) else "–" for v in values), f"{n.seconds_median:.1f}"]
        )
    return columns, table


def _misses(rows: Sequence[Row]) -> list[list[Cell]]:
    return [
        [
            r.case,
            r.label + (" (weak)" if r.weak else ""),
            answer_text(r),
            _gap(r.before),
            _gap(r.after),
            f"{r.seconds:.0f}",
        ]
        for r in rows
        if not r.right
    ]


def _gap(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else "–"


def _parts(r: Row) -> list[str]:
    return sorted({name for name, _ in r.causes}) or [r.label]


def _true(r: Row) -> str:
    return next(iter(r.causes))[0] if r.causes else r.want


def _answered(r: Row) -> str:
    names = {name for name, _ in r.named}
    if len(names) == 1:
        (name,) = names
        wrong_place = r.causes and name == next(iter(r.causes))[0] and not r.right
        return f"{name}, elsewhere" if wrong_place else name
    return _SEVERAL if names else r.verdict


def answer_text(r: Row) -> str:
    """The answer: effects with their places, or the verdict."""
    if not r.named:
        return r.verdict
    return " + ".join(sorted(name + (f"@{place}" if place else "") for name, place in r.named))


def _order(name: str) -> tuple[bool, bool, str]:
    return (
        name in ("none", "own", "parameters", "unknown", "failed", "timeout", _SEVERAL),
        name.startswith("~"),
        name,
    )


def _table(columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    lines = [" | ".join(columns), " | ".join("---" for _ in columns)]
    lines += [" | ".join(str(cell) for cell in row) for row in rows]
    return "\n".join(f"| {line} |" for line in lines) + "\n"


def _csv(rows: Sequence[Row]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(
        "case rig label weak answered right right_or_tied stage stage_right probability gap_before gap_after seconds "
        "error".split()
    )
    for r in rows:
        numbers = [f"{v:.6g}" for v in (r.probability, r.before, r.after, r.seconds)]
        head = [r.case, r.rig, r.label, int(r.weak), answer_text(r), int(r.right), int(r.right_or_tied)]
        writer.writerow([*head, r.stage or "", int(r.stage_right), *numbers, r.error])
    return out.getvalue()
