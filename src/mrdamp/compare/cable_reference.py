"""The reference numbers of a taut cable: best viscous, active and ideal semi-active damping, without dimensions.

Six cases: the damper at .01, .02 and .05 of the length, the load spread evenly or as the first mode; white noise, full
state, weight of the force squared 1e-3, mode damping .005. See `mrdamp.control.taut_cable`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from mrdamp.compare import tables
from mrdamp.control.taut_cable import CableResult, ControlledCable, reference_result
from mrdamp.parallel import mapped
from mrdamp.structures.taut_cable import Load

#: Of control, where the fundamental's period is 2 pi. The semi-active figure depends on it: docs/control.md.
PERIOD = 1e-3
Case = tuple[float, Load]

#: Motion over the best viscous damper's: uncontrolled, active, ideal semi-active.
REFERENCE: Mapping[Case, tuple[float, float, float]] = {
    (0.01, "uniform"): (1.42394, 0.23456, 0.30638),
    (0.02, "uniform"): (1.75931, 0.28434, 0.36515),
    (0.05, "uniform"): (2.55905, 0.39485, 0.47643),
    (0.01, "mode1"): (1.42127, 0.23670, 0.30318),
    (0.02, "mode1"): (1.75247, 0.28735, 0.36361),
    (0.05, "mode1"): (2.53414, 0.39992, 0.47837),
}
COLUMNS = ("uncontrolled", "active", "semi-active")


@dataclass(frozen=True)
class TableRow:
    """A case: what was found and the deviations from the reference, percent, as COLUMNS."""

    case: Case
    found: CableResult
    deviation: tuple[float, float, float]


def table(
    period: float = PERIOD, jobs: int = 1, seed: int = 0, progress: Callable[[str, float], None] | None = None
) -> tuple[TableRow, ...]:
    """The six cases; period: of control, without dimension."""
    cases = tuple(REFERENCE)
    run = partial(reference_result, period=period, seed=seed)
    results = mapped(run, [(ControlledCable(at, load=load),) for at, load in cases], jobs)
    rows = []
    for k, (case, found) in enumerate(zip(cases, results, strict=True), start=1):
        if progress:
            progress("cable", k / len(cases))
        values = found.uncontrolled, found.active, found.semi_active
        deviation = tuple(100 * (v / r - 1) for v, r in zip(values, REFERENCE[case], strict=True))
        rows.append(TableRow(case, found, (deviation[0], deviation[1], deviation[2])))
    return tuple(rows)


def shown(rows: Sequence[TableRow]) -> tables.Table:
    """Ratios with the deviation from the reference in percent."""
    heads = ("x_d / L, load", "best viscous", *COLUMNS, "semi-active force")
    body = []
    for row in rows:
        f = row.found
        values = zip((f.uncontrolled, f.active, f.semi_active), row.deviation, strict=True)
        cells = (f"{v:.4f} ({d:+.2f})" for v, d in values)
        body.append((f"{row.case[0]:g}, {row.case[1]}", f"{f.best_viscous:.3f}", *cells, f"{f.force:.2f}"))
    note = (
        "RMS motion over that with the best viscous damper, in parentheses the deviation from the reference in "
        "percent; the force over the best viscous damper's RMS force. White noise, full state, control period "
        f"{PERIOD:g} of a fundamental period of 2 pi."
    )
    return tables.Table(heads, body, note)


def to_dict(rows: Sequence[TableRow]) -> list[dict[str, Any]]:
    """For JSON."""
    return [
        {"damper_at": row.case[0], "load": row.case[1], **vars(row.found), "deviation_percent": row.deviation}
        for row in rows
    ]
