"""Audit of the records before any simulation; one line for each finding."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mrdamp.diagnosis.case.folder import Case
from mrdamp.model.core import Array
from mrdamp.records.checks import clipped

#: Shares of samples above which repeated samples and coarse quantisation are reported.
_HELD, _COARSE = 0.05, 0.02


def audit(case: Case) -> Iterator[str]:
    """Findings: clipping, repeated samples, coarse quantisation, repeats without an original. A finding that
    many records share is reported once."""
    repeated: dict[str, dict[str, float]] = {}
    for record in case.records:
        for name, values in record.channels.items():
            if name in ("time_s", "command") or not float(np.ptp(values)) > 0:
                continue
            cut = clipped(values)
            if cut is not None:
                yield f"{record.name}: {name} is clipped at {cut[0]:g} for {100 * cut[1]:.1f} % of the samples"
            elif repeated_share(values) > _HELD:
                repeated.setdefault(name, {})[record.name] = 100 * repeated_share(values)
            step = quantum(values)
            if step > _COARSE * float(np.std(values)):
                yield f"{record.name}: {name} comes in steps of {step:g}"
    for name, shares in repeated.items():
        low, high = min(shares.values()), max(shares.values())
        of = next(iter(shares)) if len(shares) == 1 else f"{len(shares)} records"
        much = f"{high:.0f} %" if len(shares) == 1 else f"{low:.0f} to {high:.0f} %"
        yield f"{of}: {name} repeats its last value in {much} of the samples"
    for repeat, original in case.repeats:
        if original is None:
            yield f"{repeat.name}: no record has the same input; it is left aside"


def repeated_share(values: Array) -> float:
    """Share of samples that equal the previous one while the signal changes."""
    same = np.diff(values) == 0
    return float(np.mean(same))


def quantum(values: Array) -> float:
    """Quantisation step of a signal (n,): the smallest difference of values if there are few different
    values; else 0."""
    levels = np.unique(values)
    if len(levels) < 2 or len(levels) > 0.2 * len(values):
        return 0.0
    return float(np.min(np.diff(levels)))
