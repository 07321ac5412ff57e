"""Where a baseline may speak: records of the regimes that it covers.

Outside them the simulator's error is unknown, and what looks like a change may have been there before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mrdamp.diagnosis.case.folder import Case
from mrdamp.records import Record
from mrdamp.records.sampling import derivative
from mrdamp.records.smoothing import smoothed

#: A record is beyond the baseline if its amplitude, speed or command is more than this factor outside the baseline's
#: range. One record of some 170 is in 24 opened cases whose baseline is of the same program. Of an unchanged damper in
#: a sweep of .4 times the least amplitude of its baseline a seal friction of 183 N was told as a change.
BEYOND = 2.0


def within(case: Case) -> tuple[Case, dict[str, str]]:
    """A damper's case with the records in the regimes of its baseline, with all of them if none is, and how the others
    leave these regimes, by name."""
    how = {r.name: beyond(r, case.baseline) for r in case.records} if case.baseline else {}
    left = {name: text for name, text in how.items() if text}
    kept = [k for k, r in enumerate(case.records) if r.name not in left]
    if not left or not kept:
        return case, left
    repeats = tuple((r, None if k is None else kept.index(k)) for r, k in case.repeats if k is None or k in kept)
    return replace(case, records=tuple(case.records[k] for k in kept), repeats=repeats), left


def beyond(record: Record, baseline: Sequence[Record]) -> str:
    """How a damper's record leaves the regimes of its baseline; empty if it does not."""
    quantities = (
        ("amplitude", "mm", lambda r: 5e2 * float(np.ptp(r.displacement)), True),
        ("RMS speed", "mm/s", _speed, True),
        ("command", "", lambda r: float(np.max(np.abs(r.command))), False),
    )
    out = []
    for name, unit, of, below in quantities:
        own, others = of(record), [of(r) for r in baseline]
        low, high = min(others), max(others)
        if own > BEYOND * high or (below and own < low / BEYOND):
            out.append(f"{name} {own:.3g} {unit}".rstrip() + f" (baseline {low:.3g} to {high:.3g})")
    return ", ".join(out)


def _speed(record: Record) -> float:
    """mm/s."""
    v = derivative(smoothed(np.asarray(record.displacement)), record.sample_time)
    return 1e3 * float(np.sqrt(np.mean(v**2)))
