"""Tables of a test rig as records: their own column names, units, separators and clocks."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mrdamp.errors import InputError
from mrdamp.records.channels import CHANNELS, is_channel, show
from mrdamp.records.csv_file import is_number
from mrdamp.records.motion import driven
from mrdamp.records.record import Record
from mrdamp.records.sampling import Array
from mrdamp.records.tables import columns_of

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
_EVEN = 0.01  # of a step: clocks that wander less are uniform
_HOLE = 5.0  # usual steps: what is longer is no jitter


class Column(NamedTuple):
    """Where a channel comes from: the file's column, and the factor (with sign) that makes its unit the channel's."""

    channel: str
    source: str
    factor: float


@dataclass(frozen=True)
class Converted:
    """A record. steps: the shortest and the longest (s) of a clock that was not uniform, else None. missing: samples
    that it leaves out, in whole steps; lines stand there."""

    record: Record
    steps: tuple[float, float] | None = None
    missing: int = 0


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
    units = _units(channel)
    name, colon, unit = source.rpartition(":")
    if not colon:
        name, unit = source, next(iter(units))
    told = re.search(r"[\[(]\s*(\S+?)\s*[\])]\s*$", name)
    if told and not colon and units.get(told[1], 1.0) != 1.0 and channel != "time_s":  # dates have none
        raise InputError(f"column {show(text)}: its name says {told[1]}; write {show(f'{text}:{told[1]}')}")
    if told and colon and units.get(told[1], units.get(unit)) != units.get(unit):
        raise InputError(f"column {show(text)}: its name says {told[1]}; allowed: that unit, or another name")
    if unit not in units:
        raise InputError(f"column {show(text)}: unit {show(unit)} is unknown; allowed: {', '.join(units)}")
    sign = -1.0 if name.startswith("-") else 1.0
    name = name.removeprefix("-").strip()
    if not name:
        raise InputError(f"column {show(text)}: no name of a column")
    return Column(channel, name, sign * units[unit])


def _units(channel: str) -> Mapping[str, float]:
    return next(known for quantity, known in UNITS.items() if quantity in channel)


def convert(path: Path | str, columns: Sequence[Column], rate: float | None = None) -> Converted:
    """A rig's table, in any form that `tables.columns_of` reads, as a record.

    A clock that wanders is replaced by a uniform one of its mean step, rounded to three digits, along straight lines.
    columns: where the channels come from; `command=0.5:A` is a constant. rate: Hz; of the file where no column is its
    time, else the record is resampled to it.

    Raises InputError: a column that is not there, a cell that is no number, a clock that stands or has holes, neither
    time nor rate, or a force that would drive the damper.
    """
    path = Path(path)
    found = [c.channel for c in columns]
    frame = any(name.startswith(("ground", "floor")) for name in found)
    for name in ("ground_acceleration_m_s2", "command") if frame else ("displacement_m", "command", "force_N"):
        if name not in found:
            constant = "; a constant is command=0:A" if name == "command" else ""
            raise InputError(f"{path}: no column is named for {name}; a record needs it{constant}")
    if frame and not any(name == "force_N" or name.startswith("floor") for name in found):
        raise InputError(f"{path}: no column is named for a floor or for force_N; a record of a frame needs one")
    if len(set(found)) < len(found):
        raise InputError(f"{path}: a channel is named twice: {', '.join(found)}")
    if rate is not None and not 0 < rate < 1e7:
        raise InputError(f"rate is {rate:g} Hz; allowed: above 0, below 1e7")
    constants, read = _constants(columns)
    # Dates have no unit: with one they are no numbers.
    time_column = next((c.source for c in read if c.channel == "time_s" and c.factor == 1.0), "")

    def check_unit(name: str, unit: str) -> None:
        for c in read:
            if c.source == name and _units(c.channel).get(unit, abs(c.factor)) != abs(c.factor):
                known = next(u for u, size in _units(c.channel).items() if size == abs(c.factor))
                raise InputError(
                    f"{path}: the row of units says {unit} for {show(name)}, the option {known}; allowed: one unit"
                )

    table = columns_of(path, [c.source for c in read], time_column, check_unit)
    n = len(next(iter(table.values())))
    values = {c.channel: c.factor * table[c.source] for c in read} | {k: np.full(n, v) for k, v in constants.items()}
    stem = re.sub(r"(\.(csv|txt|tsv|dat|asc|xlsx|mat|npz|parquet))?(\.gz)?$", "", path.name, flags=re.IGNORECASE)
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
    wander = np.abs(time - time[0] - step * np.arange(n)).max()
    if max(np.abs(steps - step).max(), wander) > _EVEN * step:
        step, ends = float(f"{step:.3g}"), (float(steps.min()), float(steps.max()))
        even = time[0] + step * np.arange(int((time[-1] - time[0]) / step * (1 + 1e-12)) + 1)
        values = {name: np.interp(even, time, x) for name, x in values.items()}
    n = len(next(iter(values.values())))
    record = _record(path, stem, {"time_s": time[0] + step * np.arange(n), **values}, step)
    missing = int(np.maximum(np.rint(steps / np.median(steps)) - 1, 0).sum())
    return Converted(record if rate is None else record.resample(1.0 / rate), ends, missing)


def _constants(columns: Sequence[Column]) -> tuple[dict[str, float], list[Column]]:
    """A command that is a constant, and the columns to read; among columns that are all named by their numbers a whole
    number from 1 on is one of them."""
    others = [c.source for c in columns if c.channel != "command"]
    numbered = all(re.fullmatch("[1-9][0-9]*", name) for name in others)
    fixed = {
        c.channel: c.factor * float(c.source)
        for c in columns
        if c.channel == "command" and is_number(c.source) and not (numbered and re.fullmatch("[1-9][0-9]*", c.source))
    }
    return fixed, [c for c in columns if c.channel not in fixed]


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
            f"{path}: sample {worst + 2}: {steps[worst] - usual:.4g} s are missing at {time[worst]:.6g} s, usual steps"
            f" are {usual:.4g} s; cut the file there"
        )


def _record(path: Path, name: str, values: Mapping[str, Array], step: float) -> Record:
    record = Record(name, None, step, values)
    if record.force is None or "displacement_m" not in record.channels:  # a frame's
        return record
    if said := driven(record.displacement, record.channel("force_N"), step):
        raise InputError(f"{path}: {said}; turn it with a minus, force_N=-NAME")
    return record
