"""Scores for rigs whose law is not the simulator's: named and invented causes, remaining gap relative to the
law's error."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from studies.blindtest import score
from studies.blindtest.score import Row, Share

#: Boundary of two groups of cases by the simulator's error without the cause, relative to the RMS; half are
#: drawn below it.
PARTED = 0.06
#: Ratio of the gaps from which on a corrected simulator counts as worse than the nominal one, as in the
#: shared scorer.
_WORSE = 1.02
#: Gap by which two integrators of one simulator differ: on the exact benches .0004 to .0016 without a cause.
_INTEGRATORS = 0.002
#: Cases of each column of a table: of all, by the records of the rig's baseline, by the base error, by the rig.
GROUPS: dict[str, Callable[[Row], bool]] = {
    "all": lambda r: True,
    "with baseline records": lambda r: r.baseline,
    "without": lambda r: not r.baseline,
    "base below 6 %": lambda r: r.misfit < PARTED,
    "6 % and more": lambda r: r.misfit >= PARTED,
    "damper": lambda r: r.rig == "damper",
    "frame": lambda r: r.rig == "frame",
}
COLUMNS = ["figure", *GROUPS, "to reach"]


def is_misfit(rows: Sequence[Row]) -> bool:
    """True for cases of rigs whose law is not the simulator's."""
    return any(math.isfinite(r.misfit) for r in rows)


def groups(rows: Sequence[Row]) -> list[list[Row]]:
    """The rows of each of `GROUPS`."""
    return [[r for r in rows if belongs(r)] for belongs in GROUPS.values()]


def table(rows: Sequence[Row]) -> list[list[str]]:
    """Rows of `COLUMNS`: one per figure."""
    by_group = [_figures(group) for group in groups(rows)]
    return [[name, *(figures[name] for figures in by_group), _WANTED.get(name, "")] for name in by_group[0]]


_WANTED = {
    "single effects named": "0.85",
    "controls without an invented cause": "0.95",
    "stage": "0.90",
    "expected calibration error": "0.05",
    "left over base, median": "1.15",
    "worse than nominal": "0",
}


def _figures(rows: Sequence[Row]) -> dict[str, str]:
    single = [r for r in rows if r.want == "effect"]
    own = [r for r in rows if r.want == "own"]
    placed = [r for r in rows if r.want in ("effect", "unknown")]
    left = [r.after / r.base for r in rows if math.isfinite(r.after) and r.base > 0]
    return {
        "single effects named": _share(single),
        "of these, well above the misfit": _share([r for r in single if not r.weak]),
        "of these, near visibility": _share([r for r in single if r.weak]),
        "controls without an invented cause": _share(own),
        "unknown recognised": _share([r for r in rows if r.want == "unknown"]),
        "stage": _text(Share(sum(r.stage_right for r in placed), len(placed))),
        "expected calibration error": _number(score.calibration_error(rows)),
        "the same for exact probabilities": _number(score.exact_calibration_error(rows)[0]),
        "left over base, median": _number(float(np.median(left)) if left else math.nan),
        "left over base, worst": _number(max(left, default=math.nan)),
        "worse than nominal": f"{sum(worse(r) for r in rows)}/{len(rows)}",
    }


def worse(row: Row) -> bool:
    """True if the handed-over simulator is worse than the nominal one on tests outside the case, or missing.
    """
    return not row.after <= _WORSE * row.before + _INTEGRATORS


def _share(rows: Sequence[Row]) -> str:
    return _text(Share(sum(r.right for r in rows), len(rows)))


def _text(share: Share) -> str:
    return f"{share.right}/{share.of} = {share.value:.3f}" if share.of else "–"


def _number(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else "–"
