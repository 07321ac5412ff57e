"""Which records of a set are held out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mrdamp.errors import InputError

if TYPE_CHECKING:
    from mrdamp.records.record import Record

#: Share of the largest command within which two commands are the same.
_SAME_COMMAND = 0.02


def refuse_copies(records: Sequence[Record]) -> None:
    """Raises InputError where two records hold the same samples: held out, a copy would judge the fit to itself, and as
    a repeat or a baseline it would have no noise."""
    seen: dict[tuple[tuple[str, bytes], ...], Record] = {}
    for record in records:
        # Stamps do not count: another start of the clock makes no other test.
        channels = sorted((name, x.tobytes()) for name, x in record.channels.items() if name != "time_s")
        other = seen.setdefault(tuple(channels), record)
        if other is not record:
            raise InputError(f"{record.label}: it holds the same samples as {other.label}; leave one of them out")


def held_out(records: Sequence[Record]) -> set[int]:
    """Numbers of the records to hold out of a set of two or more, see `mrdamp.records.read_records`."""
    first = [k for k, record in enumerate(records) if "repeat" not in record.name.lower()]
    if len(first) < 2:
        first = list(range(len(records)))
    validation = _within_the_rest(records, first, set(first[2::3]) or {first[-1]})
    for k in sorted(set(range(len(records))) - set(first)):
        if min(first, key=lambda other: _input_difference(records[k], records[other])) in validation:
            validation.add(k)
    return validation


def _within_the_rest(records: Sequence[Record], first: Sequence[int], chosen: set[int]) -> set[int]:
    """The held-out records, exchanged for others where their commands go beyond those of the rest."""
    if any("command" not in records[k].channels for k in first):
        return chosen
    largest = {k: float(np.abs(records[k].command).max()) for k in first}
    least = {k: float(np.abs(records[k].command).min()) for k in first}
    slack = _SAME_COMMAND * max(largest.values())

    def beyond(held: set[int]) -> list[int]:
        rest = [k for k in first if k not in held]
        high, low = max(largest[k] for k in rest), min(least[k] for k in rest)
        return [k for k in sorted(held) if largest[k] > high + slack or least[k] < low - slack]

    for k in beyond(chosen):
        for other in first:
            exchanged = (chosen - {k}) | {other}
            if other not in chosen and len(beyond(exchanged)) < len(beyond(chosen)):
                chosen = exchanged
                break
    return chosen


def _input_difference(a: Record, b: Record) -> float:
    """How far the inputs of two tests are apart: 0 the same, infinite where they cannot be compared."""
    names = [name for name in ("displacement_m", "ground_acceleration_m_s2", "command") if name in a.channels]
    if a.n != b.n or any(name not in b.channels for name in names):
        return float("inf")
    size = [float(np.abs(a.channels[name]).max()) or 1.0 for name in names]
    return sum(
        float(np.abs(a.channels[name] - b.channels[name]).mean()) / scale
        for name, scale in zip(names, size, strict=True)
    )
