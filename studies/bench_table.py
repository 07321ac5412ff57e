"""Figures of scored benches with 95 % intervals, as a table: `python -m studies.bench_table ROWS.json|FOLDER ...`.

ROWS.json: rows that `studies.blindtest` or --save wrote. FOLDER: a bench of `studies.spike_bench` with the answers of
`mrdamp diagnose` in answers/CASE, which are scored first. Several are pooled. studies/rows/measured.json holds rows of
docs/diagnosis/README.md.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from mrdamp.errors import InputError
from mrdamp.model import Model
from studies.blindtest import misfit_score, rows_file, score
from studies.blindtest.run import predicted
from studies.blindtest.score import Row, Share

Group = Sequence[Row]


def of_folder(folder: Path) -> list[Row]:
    """Scored answers of a bench of measured records. Its labels hold roots of means over the tests, rows roots of sums:
    the base is put on the scale of the row's gap. Raises InputError."""
    labels = folder / "labels.json"
    if not labels.is_file():
        raise InputError(f"{folder}: no file of rows, and no bench with a labels.json")
    rows = []
    for case, label in json.loads(labels.read_text(encoding="utf-8")).items():
        own, run = folder / "answers" / case, folder / "answers" / case / "run.json"
        if not (own / "diagnosis.json").is_file():
            raise InputError(f"{own}: no answer (diagnosis.json)")
        model = Model.read(own / "corrected.json")
        gaps = score.gaps(folder / "tests" / f"{case}.npz", partial(predicted, model))
        seconds = json.loads(run.read_text(encoding="utf-8"))["seconds"] if run.is_file() else math.nan
        row = score.row(case, label, score.read_answer(own), gaps, seconds)
        rows.append(replace(row, base=label["base"] * row.before / label["gap"]))
    return rows


def table(rows: Group) -> str:
    """Markdown: a line a figure; columns by the law's error, the rig and its baseline if the rows tell them."""
    names = ["all"]
    groups: Sequence[Group] = [rows]
    if misfit_score.is_misfit(rows):
        names, groups = list(misfit_score.GROUPS), misfit_score.groups(rows)
    lines = ["| figure | " + " | ".join(names) + " |", "|---|" + "---|" * len(names)]
    for what, figure in _FIGURES.items():
        cells = [figure(g, k == 0) for k, g in enumerate(groups)]
        if cells[0]:
            lines.append(f"| {what} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _share(of: Callable[[Row], bool], right: Callable[[Row], bool] = lambda r: r.right) -> Callable[[Group, bool], str]:
    def cell(rows: Group, first: bool) -> str:
        chosen = [r for r in rows if of(r)]
        share = Share(sum(map(right, chosen)), len(chosen))
        if not chosen:
            return ""
        low, high = share.interval
        span = f"; {_short(low)} to {_short(high)}" if first else ""
        return f"{share.right} of {share.of} ({_short(share.value)}{span})"

    return cell


def _short(value: float) -> str:
    value = max(value, 0.0)  # the end of an interval at 0 may be -1e-17
    return f"{value:.2f}".replace("0.", ".", 1) if value < 1 else f"{value:.2f}"


def _single(row: Row) -> bool:
    return row.want == "effect" and len(row.causes) == 1


def _pair(row: Row) -> bool:
    return len(row.causes) == 2


def _one_of(row: Row) -> bool:
    return not row.right and not row.invented and bool(row.named & row.causes)


def _left(rows: Group, first: bool) -> str:
    ratios = [r.after / r.base for r in rows if math.isfinite(r.after) and r.base > 0]
    return f"{_short(float(np.median(ratios)))}, {_short(max(ratios))}" if ratios else ""


def _calibration(rows: Group, first: bool) -> str:
    value = score.calibration_error(rows)
    return f"{value:.3f}".lstrip("0") if math.isfinite(value) else ""


def _exact(rows: Group, first: bool) -> str:
    mean, most = score.exact_calibration_error(rows)
    return f"{mean:.3f}, {most:.3f}".replace("0.", ".") if math.isfinite(mean) else ""


def _seconds(rows: Group, first: bool) -> str:
    known = [r.seconds for r in rows if math.isfinite(r.seconds)]
    return f"{np.median(known):.0f}, {max(known):.0f}" if known else ""


_FIGURES: dict[str, Callable[[Group, bool], str]] = {
    "single effects named": _share(_single),
    "of these, base below 6 %": _share(lambda r: _single(r) and r.misfit < misfit_score.PARTED),
    "of these, base of 6 % and more": _share(lambda r: _single(r) and r.misfit >= misfit_score.PARTED),
    "of these, gap due to the cause at least the base": _share(
        lambda r: _single(r) and not r.weak and math.isfinite(r.misfit)
    ),
    "of these, .4 to .8 of the base": _share(
        lambda r: _single(r) and r.weak and math.isfinite(r.misfit)
    ),
    "named, or in a declared tie of two or three": _share(_single, lambda r: r.right_or_tied),
    "pairs named": _share(_pair),
    "one of a pair named, nothing else": _share(_pair, _one_of),
    "controls without an invented cause": _share(lambda r: r.want == "own"),
    "no false alarm": _share(lambda r: r.want in score.NOT_EFFECTS),
    "causes outside the catalogue answered with `unknown`": _share(lambda r: r.want == "unknown"),
    "right stage": _share(lambda r: r.want in ("effect", "unknown"), lambda r: r.stage_right),
    "expected calibration error": _calibration,
    "the same for exact probabilities, mean and .95 quantile": _exact,
    "gap on held-out tests over the base, median and worst": _left,
    "corrected simulator worse than the nominal one on held-out tests": _share(
        lambda r: True, misfit_score.worse
    ),
    "seconds, median and worst": _seconds,
}


def _ratio(value: float, by: float) -> str:
    """A case without a cause may have no gap before, and one of an exact law has no base."""
    return f"{value / by:.2f}" if by > 0 else "-"


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("rows", type=Path, nargs="+", metavar="ROWS.json|FOLDER")
    p.add_argument("--save", type=Path, metavar="ROWS.json", help="write all rows to one file")
    p.add_argument("--misses", action="store_true", help="list the wrong answers and the worse simulators as well")
    a = p.parse_args()
    try:
        rows = [r for path in a.rows for r in (of_folder(path) if path.is_dir() else rows_file.read(path))]
    except InputError as error:
        print(f"bench_table: {error}", file=sys.stderr)
        return 2
    if a.save:
        rows_file.write(a.save, rows)
    print(table(rows), end="")
    for r in rows if a.misses else []:
        if not r.right or misfit_score.worse(r):
            named = " + ".join(sorted(name + (f"@{place}" if place else "") for name, place in r.named))
            print(
                f"{r.case} {r.label}{' weak' if r.weak else ''} -> {r.verdict} {named} p {r.probability:.2f} "
                f"stage {r.stage} of {','.join(r.stages)} tied {[sorted(t) for t in r.tied]} "
                f"after/before {_ratio(r.after, r.before)} /base {_ratio(r.after, r.base)} {r.seconds:.0f} s"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
