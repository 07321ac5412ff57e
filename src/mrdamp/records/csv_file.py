"""The CSV form of a record: text to columns and back, every fault found with its line.

A record is a header of channel names and rows of numbers, separated by commas. Only channels are read;
other columns may hold anything.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from mrdamp.errors import LARGEST, InputError
from mrdamp.records.channels import check_header, listed, show

Array = NDArray[np.float64]

_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)
_NOT_FINITE = re.compile(r"\s*[+-]?(nan|inf|infinity)\s*", re.IGNORECASE)
_LEAST = 3  # samples of a record
_ROWS = 50_000  # read and written at a time: as Python's texts and numbers they take many times their size
_STEP_TOLERANCE = 0.01  # of a step: the jitter of a time axis that still counts as uniform
_GRID_TOLERANCE = 0.05  # of a step: how far a sample may lie from the uniform grid of the whole record


def parse(
    file: str, text: str, required: Sequence[str] | None = None
) -> tuple[dict[str, Array], tuple[str, ...], float]:
    """Columns of a record's text: channels in file order, (n,) float64 each; names of the columns left out; sample
    time, s.

    file: its name, for error lines. text: the whole file, lines ended by a newline. required: channels that must be
    there (see `mrdamp.records.channels.check_header`). Raises InputError with the file, the line number and the
    channel.
    """
    text = text.rstrip()
    count, end = text.count("\n"), text.find("\n")
    head = text[:end] if count else text
    header = [name.strip() for name in head.split(",")]
    if all(is_number(name) or not name for name in header):
        raise InputError(f"{file}: no header: line 1 must name the channels (time_s,command,...)")
    if len(header) == 1 and re.search(r"[;\t]", head):
        raise InputError(f"{file}: line 1 must name the channels, separated by commas; see mrdamp convert")
    present = check_header(file, header, required)
    if count < _LEAST:
        raise InputError(f"{file}: {count} samples: at least {_LEAST} are needed")
    columns = [header.index(name) for name in present]
    channels = {name: np.empty(count) for name in present}
    at = 0
    while at < count:
        begin = end + 1
        for _ in range(min(_ROWS, count - at)):
            end = text.find("\n", end + 1)
        rows = text[begin : end if end >= 0 else None].split("\n")
        values = numbers(file, header, rows, columns, at + 2, least=1)
        for k, name in enumerate(present):
            channels[name][at : at + len(rows)] = values[:, k]
        at += len(rows)
    del text  # as large as the channels
    ignored = tuple(name for name in header if name not in present)
    if "time_s" not in channels:
        raise InputError(f"{file}: missing channel time_s; the file has {listed(header)}")
    sample_time = uniform_step(file, channels["time_s"])
    return channels, ignored, sample_time


def uniform_step(file: str, time: Array, first_line: int = 2) -> float:
    """Sample time of a printed time column (n,) s, (t[-1] - t[0]) / (n - 1), after a check that it is uniform.

    Times are printed with limited digits, so a time may be off by half of the last digit; beyond that, and 1 % of a
    step, a clock counts as non-uniform. first_line: of the file, that holds time[0]. Raises InputError: time stands,
    goes back, leaves samples out or wanders.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        steps = np.diff(time)
        sample_time = float((time[-1] - time[0]) / (len(time) - 1))
    if not np.isfinite(steps).all() or not 1e-12 < abs(sample_time) < 1e12 or np.abs(time).max() > 1e15:
        raise InputError(f"{file}: time_s runs from {time[0]:.6g} to {time[-1]:.6g}: not a clock in seconds")
    back = np.flatnonzero(steps <= 0.0)
    if back.size:
        k = int(back[0]) + 1
        raise InputError(
            f"{file}: line {first_line + k}: time_s does not increase: {time[k]:.9g} after {time[k - 1]:.9g}"
        )
    usual = float(np.median(steps))
    last_digit = np.minimum(resolution(time), 0.5 * usual)
    off = np.abs(steps - usual) - _STEP_TOLERANCE * usual - 1.01 * last_digit[1:]
    worst = int(np.argmax(off))
    if off[worst] > 0.0:
        raise InputError(
            f"{file}: line {first_line + worst + 1}: non-uniform clock: time_s steps by {steps[worst]:.6g} s,"
            f" elsewhere by {usual:.6g} s"
        )
    index = np.arange(len(time)) - 0.5 * (len(time) - 1)
    slope = float(index @ (time - time.mean()) / (index @ index))
    wander = np.abs(time - time.mean() - slope * index)
    off = wander - _GRID_TOLERANCE * usual - 0.6 * last_digit
    worst = int(np.argmax(off))
    if off[worst] > 0.0:
        raise InputError(
            f"{file}: line {first_line + worst}: non-uniform clock: time_s is {wander[worst]:.6g} s away from"
            f" steps of {slope:.9g} s"
        )
    return sample_time


def render(columns: Mapping[str, Array], digits: int = 9) -> str:
    """CSV text of equally long columns, ``digits`` significant digits; the inverse of `parse`."""
    return "".join(rendered(columns, digits))


def rendered(columns: Mapping[str, Array], digits: int = 9) -> Iterator[str]:
    """The same in parts.

    Time has three digits more, and as many as a step needs: it is a small part of a time, of an epoch's above all.
    Raises InputError for a column that is not finite.
    """
    for name, values in columns.items():
        if (bad := np.flatnonzero(~np.isfinite(values))).size:
            raise InputError(f"{name} is no finite number from sample {bad[0] + 1} on: nothing is written")
    more = 3
    if len(time := np.asarray(columns.get("time_s", ()))) > 1 and time[-1] != time[0]:
        step = abs(float(time[-1] - time[0])) / (len(time) - 1)
        more = min(max(more, math.ceil(math.log10(float(np.abs(time).max()) / step)) + 4 - digits), 17 - digits)
    formats = [f"%.{digits + more if name == 'time_s' else digits}g" for name in columns]
    row = ",".join(formats)
    tables = (
        np.column_stack([values[first : first + _ROWS] for values in columns.values()]).tolist()
        for first in range(0, len(next(iter(columns.values()))), _ROWS)
    )
    parts = ("\n".join(row % tuple(values) for values in table) + "\n" for table in tables)
    return chain([",".join(columns) + "\n"], parts)


def numbers(
    file: str, names: Sequence[str], rows: list[str], picked: list[int], first_line: int = 2, least: int = _LEAST
) -> Array:
    """(n, len(picked)) finite numbers of the rows' columns `picked`; the others may hold anything.

    file: its name, for the error line. names: of all columns. rows: the lines, one a sample, from first_line of the
    file on; least: how many. Raises InputError: a picked column twice, too few rows, a ragged row, a cell that is not a
    number, NaN or infinity, with its line.
    """
    if twice := [names[k] for k in picked if names.count(names[k]) > 1]:
        raise InputError(f"{file}: two columns are named {show(twice[0])}; rename one")
    if len(rows) < least:
        raise InputError(f"{file}: {len(rows)} samples: at least {least} are needed")
    commas = np.fromiter((row.count(",") for row in rows), dtype=np.int64, count=len(rows))
    ragged = np.flatnonzero(commas != len(names) - 1)
    if ragged.size:
        k = int(ragged[0])
        found = "is empty" if not rows[k].strip() else f"has {commas[k] + 1} cells"
        raise InputError(f"{file}: line {first_line + k} {found}, {len(names)} columns are needed")
    try:
        values = np.loadtxt(rows, delimiter=",", comments=None, usecols=picked, ndmin=2, dtype=np.float64)
    except (ValueError, OverflowError):
        values = None
    if values is None or values.shape != (len(rows), len(picked)):
        raise _not_a_number(file, names, rows, picked, first_line)
    bad = np.argwhere(~(np.abs(values) <= LARGEST))
    if bad.size:
        row, column = (int(index) for index in bad[0])
        cell = float(values[row, column])
        what = "NaN" if math.isnan(cell) else f"{cell:g}" if math.isfinite(cell) else "infinite"
        where = f"{file}: line {first_line + row}: {names[picked[column]]}"
        raise InputError(f"{where} is {what}: every cell must be a finite number up to {LARGEST:g}")
    return values


def is_number(cell: str) -> bool:
    """Whether a cell is a number, or NaN or infinity."""
    return bool(_NUMBER.fullmatch(cell) or _NOT_FINITE.fullmatch(cell))


def _not_a_number(
    file: str, names: Sequence[str], rows: list[str], picked: list[int], first_line: int
) -> InputError:
    for k, row in enumerate(rows):
        cells = row.split(",")
        for column in picked:
            cell = cells[column]
            if not is_number(cell):
                what = f"is not a number: {show(cell.strip())}" if cell.strip() else "is empty"
                return InputError(f"{file}: line {first_line + k}: {names[column]} {what}")
    return InputError(f"{file}: the rows are not a table of numbers")


def resolution(time: Array) -> Array:
    """(n,) s: what the last printed digit of each time is worth.

    The number of decimals is found for each decade of time on its own, since a column may be printed with
    so many decimals or with so many significant digits.
    """
    size = np.abs(time)
    decade = np.floor(np.log10(np.maximum(size, 1e-9))).astype(np.int64)
    out = 4.0 * np.spacing(size)
    for here in np.unique(decade):
        mask = decade == here
        out[mask] += 10.0 ** -_decimals(time[mask])
    return out


def _decimals(time: Array) -> int:
    """Fewest decimals that print these times exactly (to the accuracy of a double)."""
    for decimals in range(16):
        scaled = time * 10.0**decimals
        if (np.abs(scaled - np.round(scaled)) <= 1e-6 + 4.0 * np.spacing(np.abs(scaled))).all():
            return decimals
    return 16
