"""Tables of a test rig as records: their own column names, units, separators and clocks."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mrdamp.errors import InputError
from mrdamp.files import decode, read_bytes
from mrdamp.records.channels import CHANNELS, is_channel, listed, show
from mrdamp.records.csv_file import numbers
from mrdamp.records.record import Record
from mrdamp.records.sampling import Array

_INCH, _POUND, _G = 0.0254, 4.4482216152605, 9.80665
#: Quantity -> unit -> its size in the channel's own.
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    "displacement": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": _INCH},
    "command": {"A": 1.0, "mA": 1e-3, "V": 1.0, "mV": 1e-3},
    "current": {"A": 1.0, "mA": 1e-3},
    "charge": {"pC": 1.0, "nC": 1e3},
    "force": {"N": 1.0, "kN": 1e3, "lbf": _POUND, "kgf": _G},
    "temperature": {"C": 1.0},
    "velocity": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "in/s": _INCH},
    "acceleration": {"m/s2": 1.0, "cm/s2": 1e-2, "mm/s2": 1e-3, "g": _G},
}
_SEPARATORS = ",;\t"
_EVEN = 0.01  # of a step: clocks that wander less are uniform
_HOLE = 5.0  # usual steps: what is longer is no jitter


class Column(NamedTuple):
    """Where a channel comes from: the file's column, and the factor (with sign) that makes its unit the channel's."""

    channel: str
    source: str
    factor: float


@dataclass(frozen=True)
class Converted:
    """A record. steps: the shortest and the longest (s) of a clock that was not uniform, else None."""

    record: Record
    steps: tuple[float, float] | None = None


def column(text: str) -> Column:
    """`CHANNEL=NAME:UNIT`, with a minus before NAME to turn the sign; no unit: the channel's own.

    Raises InputError: an unknown channel, or a unit of another quantity.
    """
    channel, equals, source = text.partition("=")
    if not equals or not is_channel(channel):
        raise InputError(
            f"column {show(text)}: allowed: CHANNEL=NAME:UNIT, such as displacement_m=LVDT:mm; channels are"
            f" {', '.join(CHANNELS)}"
        )
    units = next(known for quantity, known in UNITS.items() if quantity in channel)
    name, colon, unit = source.rpartition(":")
    if not colon:
        name, unit = source, next(iter(units))
    if unit not in units:
        raise InputError(f"column {show(text)}: unit {show(unit)} is unknown; allowed: {', '.join(units)}")
    sign = -1.0 if name.startswith("-") else 1.0
    name = name.removeprefix("-").strip()
    if not name:
        raise InputError(f"column {show(text)}: no name of a column")
    return Column(channel, name, sign * units[unit])


def convert(path: Path | str, columns: Sequence[Column], rate: float | None = None) -> Converted:
    """A rig's table as a record.

    Lines before the header, a line of units below it, other columns, `;` or tabs between cells and decimal commas with
    them are taken as they are. A clock that wanders is replaced by a uniform one of its mean step, rounded
    to three digits, by linear interpolation.

    Args:
        path: text, or packed (.gz).
        columns: where the channels come from.
        rate: Hz; of the file where no column is its time, else the record is resampled to it.

    Raises:
        InputError: one line: a column that is not there, a cell that is no number, a clock that stands or has holes,
            neither time nor rate, or a force that would drive the damper.
    """
    path = Path(path)
    found = [c.channel for c in columns]
    for name in ("displacement_m", "command", "force_N"):
        if name not in found:
            raise InputError(f"{path}: no column is named for {name}; a record needs it")
    if len(set(found)) < len(found):
        raise InputError(f"{path}: a channel is named twice: {', '.join(found)}")
    if rate is not None and not 0 < rate < 1e7:
        raise InputError(f"rate is {rate:g} Hz; allowed: above 0, below 1e7")
    values = _table(path, columns)
    stem = re.sub(r"(\.(csv|txt|tsv|dat|asc))?(\.gz)?$", "", path.name, flags=re.IGNORECASE)
    if "time_s" not in values:
        if rate is None:
            raise InputError(
                f"{path}: no column is named for time_s: name one, or give the file's rate in Hz"
            )
        return Converted(_record(path, stem, values, 1.0 / rate))
    time = values.pop("time_s")
    steps = np.diff(time)
    _check(path, time, steps)
    step, ends = float(np.mean(steps)), None
    if np.abs(steps - step).max() > _EVEN * step:
        step, ends = float(f"{step:.3g}"), (float(steps.min()), float(steps.max()))
        even = time[0] + step * np.arange(int((time[-1] - time[0]) / step * (1 + 1e-12)) + 1)
        values = {name: np.interp(even, time, x) for name, x in values.items()}
    n = len(values["force_N"])
    record = _record(path, stem, {"time_s": time[0] + step * np.arange(n), **values}, step)
    return Converted(record if rate is None else record.resample(1.0 / rate), ends)


def _check(path: Path, time: Array, steps: Array) -> None:
    back = np.flatnonzero(steps <= 0)
    if back.size:
        k = int(back[0])
        raise InputError(
            f"{path}: sample {k + 2}: the time does not increase: {time[k + 1]:.9g} s after {time[k]:.9g} s; where "
            "only its digits are too few, leave the column out and give the rate"
        )
    usual, worst = float(np.median(steps)), int(np.argmax(steps))
    if steps[worst] > _HOLE * usual:
        raise InputError(
            f"{path}: sample {worst + 2}: {steps[worst]:.4g} s are missing at {time[worst]:.6g} s, usual steps are "
            f"{usual:.4g} s; cut the file there"
        )


def _record(path: Path, name: str, values: Mapping[str, Array], step: float) -> Record:
    record = Record(name, None, step, values)
    power = float(np.mean(record.channel("force_N") * record.velocity()))
    if power < 0:
        raise InputError(
            f"{path}: the damper would drive the rig (mean of force times velocity {power:.3g} W): one of the two "
            "counts the other way; turn it with a minus, force_N=-NAME"
        )
    return record


def _table(path: Path, columns: Sequence[Column]) -> dict[str, Array]:
    """The named columns in their channels' units, each (n,)."""
    lines = decode(str(path), read_bytes(path)).rstrip().split("\n")
    wanted = {c.source for c in columns}
    for separator in _SEPARATORS:
        for k, line in enumerate(lines[:200]):
            header = _cells(line, separator)
            if wanted <= set(header):
                return _values(path, lines, k, header, separator, columns)
    separator = max(_SEPARATORS, key=lines[0].count)
    heads = max((_cells(line, separator) for line in lines[:200]), key=lambda cells: len(wanted & set(cells)))
    missing = ", ".join(show(name) for name in sorted(wanted - set(heads)))
    raise InputError(f"{path}: no column {missing}; the file has {listed(heads)}")


def _cells(line: str, separator: str) -> list[str]:
    return [cell.strip().strip('"') for cell in line.split(separator)]


def _values(
    path: Path, lines: list[str], at: int, header: list[str], separator: str, columns: Sequence[Column]
) -> dict[str, Array]:
    rows = [row.rstrip(separator) if row.count(separator) == len(header) else row for row in lines[at + 1 :]]
    first = at + 2
    if rows and not re.search(r"\d", rows[0]):  # units
        rows, first = rows[1:], first + 1
    if separator != ",":
        rows = [row.replace(",", ".").replace(separator, ",") for row in rows]
    table = numbers(str(path), header, rows, [header.index(c.source) for c in columns], first)
    return {c.channel: c.factor * table[:, k] for k, c in enumerate(columns)}
