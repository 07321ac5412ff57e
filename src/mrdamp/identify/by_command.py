"""The papers' way to a law: one fit for each constant command, then lines through the parameters.

Zapateiro et al., Eqs. (7) and (8): sets of parameters at constant commands, and those that vary with the command
taken as p = p_a + p_b u.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mrdamp.errors import InputError
from mrdamp.identify.fit import Fit, RecordError, error, identify, pooled
from mrdamp.model import Model, effects_from
from mrdamp.records import Record

Progress = Callable[[str, float], None]

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
    """Fits at constant commands, the lines through their parameters, and the law that the lines make."""

    fits: tuple[tuple[float, Fit], ...]
    lines: tuple[Line, ...]
    model: Model
    train: tuple[RecordError, ...]
    held_out: tuple[RecordError, ...]

    @property
    def held_out_nrmse(self) -> float:
        """RMS error over the standard deviation of the force of the law of lines, held-out records pooled."""
        return pooled(self.held_out)


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
    starts: int = 2,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> ByCommand:
    """Fits the law at each constant command and draws lines through the parameters.

    Coefficients that the law has per command get a line; the others (n, m0 ...) their mean over the commands.
    Raises InputError where fewer than two constant commands are in the records.
    """
    groups = constant_groups(train)
    if len(groups) < 2:
        raise InputError(
            f"{train[0].label}: lines through the parameters need 2 constant commands; the records have {len(groups)}"
        )
    fits = []
    for count, (u, records) in enumerate(groups):
        if progress:
            progress(f"command {u:g}", count / len(groups))
        fit = identify(
            law, records, extras=extras, dependence="constant", starts=starts, seed=seed, threads=threads
        )
        fits.append((u, fit))
    commands = [u for u, _ in fits]
    parameters: dict[str, float] = {}
    lines = []
    stems = {m.stem for m in fits[0][1].space.maps} if fits[0][1].space else set()
    attributes = {
        name: [fit.model.attributes[name] for _, fit in fits] for name in fits[0][1].model.attributes
    }
    for name, values in attributes.items():
        zero, slope = float(np.mean(values)), 0.0
        if name[:-1] in stems and name.endswith("a"):
            slope, zero = (float(c) for c in np.polyfit(commands, values, 1))
        elif name[:-1] in stems:
            continue  # the slope at one command: none
        distance = np.asarray(values) - zero - slope * np.asarray(commands)
        lines.append(
            Line(name, tuple(commands), tuple(values), zero, slope, float(np.sqrt(np.mean(distance**2))))
        )
        parameters[name] = zero
        if name[:-1] in stems:
            parameters[f"{name[:-1]}b"] = slope
    model = _model(fits[0][1].model, parameters, commands)
    if progress:
        progress("evaluating", 1.0)
    constant = [record for _, records in groups for record in records]
    return ByCommand(
        tuple(fits),
        tuple(lines),
        model,
        tuple(error(model, record) for record in constant),
        tuple(error(model, record) for record in held_out),
    )


def _model(first: Model, attributes: dict[str, float], commands: Sequence[float]) -> Model:
    own = {name: attributes.get(name, value) for name, value in first.parameters.items()}
    command_range = {"command_min": min(commands), "command_max": max(commands)}
    return replace(
        first, parameters={**own, **command_range}, effects=effects_from(attributes), name=f"{first.law} by command"
    )
