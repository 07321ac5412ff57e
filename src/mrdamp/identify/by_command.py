"""The foam-damper paper's way to a law: values at each constant command, then lines through them.

Zapateiro et al., Eqs. (7) and (8): sets of parameters at constant commands, and those that vary with the command
taken as p = p_a + p_b u.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mrdamp.errors import InputError
from mrdamp.identify.fit import Fit, RecordError, error, identify, model_of
from mrdamp.model import Model
from mrdamp.parallel import Progress
from mrdamp.records import Record

#: Share of the largest command within which a record's command counts as constant, and two as the same.
_SAME = 0.02


class Line(NamedTuple):
    """p = zero + slope u through the fitted values of one parameter; scatter: RMS distance from it."""

    parameter: str
    commands: tuple[float, ...]
    values: tuple[float, ...]
    zero: float
    slope: float
    scatter: float


@dataclass(frozen=True)
class ByCommand:
    """The law of the lines, as a fit; the lines; and the law at each constant command with its errors by record."""

    fit: Fit
    lines: tuple[Line, ...]
    at: tuple[tuple[float, Model, tuple[RecordError, ...]], ...]


def constant_groups(records: Sequence[Record]) -> list[tuple[float, list[Record]]]:
    """Records with a constant command, gathered by it: (command, records), the smallest first."""
    largest = max(float(np.abs(record.command).max()) for record in records)
    groups: list[tuple[float, list[Record]]] = []
    for record in sorted(records, key=lambda r: float(np.median(r.command))):
        u = float(np.median(record.command))
        if float(np.ptp(record.command)) > _SAME * max(largest, 1e-12):
            continue
        if groups and abs(u - groups[-1][0]) <= _SAME * largest:
            groups[-1][1].append(record)
        else:
            groups.append((u, [record]))
    return groups


def identify_by_command(
    law: str,
    train: Sequence[Record],
    held_out: Sequence[Record] = (),
    *,
    extras: Sequence[str] = ("offset",),
    follows: Sequence[str] | None = None,
    starts: int = 2,
    seed: int = 0,
    progress: Progress | None = None,
) -> ByCommand:
    """Fits the law to all constant commands and draws lines through the coefficients that follow the command.

    These have a value of their own at each command. The others (n, A, m0, ...) are one number for all commands, fitted
    together with them: fitted apart, numbers that are coupled have no mean that is a law. follows: see
    `mrdamp.identify.laws.space`. Raises InputError where fewer than two constant commands are in the records.
    """
    groups = constant_groups(train)
    if len(groups) < 2:
        raise InputError(
            f"{train[0].label}: lines through the parameters need 2 constant commands; the records have {len(groups)}"
        )
    commands = tuple(u for u, _ in groups)
    fit = identify(
        law, [record for _, records in groups for record in records], held_out, extras=extras, dependence=commands,
        follows=follows, starts=starts, seed=seed, progress=progress,
    )  # fmt: skip
    assert fit.space is not None
    point = np.array(fit.point)
    at = [(u, model_of(fit.space, point, u), records) for u, records in groups]
    lines = []
    for stem in (m.stem for m in fit.space.maps if not m.constant):
        values = np.array([model.parameters[f"{stem}a"] for _, model, _ in at])
        zero, slope = (fit.model.parameters[f"{stem}{part}"] for part in "ab")
        scatter = float(np.sqrt(np.mean((values - zero - slope * np.array(commands)) ** 2)))
        lines.append(Line(f"{stem}a", commands, tuple(values.tolist()), zero, slope, scatter))
    errors = tuple((u, model, tuple(error(model, r) for r in records)) for u, model, records in at)
    return ByCommand(replace(fit, model=replace(fit.model, name=f"{law} by command")), tuple(lines), errors)
