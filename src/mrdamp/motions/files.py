"""The file forms of a ground motion: one- or two-column CSV and PEER .AT2."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from mrdamp.errors import InputError
from mrdamp.records import csv_file as record_csv
from mrdamp.records.channels import listed, show

Array = NDArray[np.float64]
Parsed = tuple[float, Array, str]  # sample time in s, acceleration (n,) in m/s2, source

STANDARD_GRAVITY = 9.80665  # m/s2 per g

_COLUMNS = {"ground_acceleration_m_s2": 1.0, "acceleration_m_s2": 1.0, "acceleration_g": STANDARD_GRAVITY}
_VALUE = r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?)"


def parse_csv(file: str, text: str, sample_time: float | None) -> Parsed:
    """A CSV with one column (m/s2, ``dt_s=`` in a comment or ``sample_time``) or with time and acceleration.

    Raises:
        InputError: one line with the file and the fault.
    """
    lines = text.rstrip().split("\n")
    comments = [line for line in lines if line.startswith("#")]
    skip = 0
    while skip < len(lines) and (lines[skip].startswith("#") or not lines[skip].strip()):
        skip += 1
    if skip == len(lines):
        raise InputError(f"{file}: no samples")
    header = [cell.strip() for cell in lines[skip].split(",")]
    named = any(re.match(r"[A-Za-z_]", cell) and cell.lower() not in ("nan", "inf") for cell in header)
    if named:
        skip += 1
        name = next((name for name in _COLUMNS if name in header), None)
        if name is None:
            raise InputError(f"{file}: no acceleration column: the file has {listed(header)};"
                             f" it is one of {', '.join(_COLUMNS)}")  # fmt: skip
        column, factor = header.index(name), _COLUMNS[name]
        time_column = header.index("time_s") if "time_s" in header else None
        if time_column is None and len(header) > 1:
            raise InputError(f"{file}: no time_s column: the file has {listed(header)}")
    elif len(header) <= 2:
        column, factor, time_column = len(header) - 1, 1.0, 0 if len(header) == 2 else None
    else:
        raise InputError(f"{file}: {len(header)} columns and no header: name them, or give one or two")
    picked = [column] if time_column is None else [column, time_column]
    names = header if named else [f"column {k + 1}" for k in range(len(header))]
    table = record_csv.numbers(file, names, lines[skip:], picked, skip + 1)
    stated = _stated(file, comments, "dt_s")
    if time_column is not None:
        stated = record_csv.uniform_step(file, table[:, 1], skip + 1)
    sample_time = stated if stated is not None else sample_time
    if sample_time is None:
        raise InputError(f"{file}: no sample time: a one-column motion needs a line such as # dt_s=0.02")
    count = _stated(file, comments, "n")
    if count is not None and count != len(table):
        raise InputError(f"{file}: {len(table)} samples, its header says n={count:g}")
    source = comments[0].lstrip("# ").strip() if comments else ""
    return sample_time, table[:, 0] * factor, source


def parse_at2(file: str, text: str) -> Parsed:
    """PEER .AT2: four lines of header, the last with NPTS and DT in one of its forms, then values in g.

    The forms are ``NPTS=  4000, DT=   .0050 SEC`` and the older ``4000    0.0050    NPTS, DT``.

    Raises:
        InputError: one line with the file and the fault.
    """
    lines = text.rstrip().split("\n")
    place = next((k for k, line in enumerate(lines[:12]) if re.search("NPTS", line, re.IGNORECASE)), None)
    if place is None:
        raise InputError(f"{file}: no NPTS, DT line in the header of this .AT2 file")
    line = lines[place]
    count = re.search(r"NPTS\s*=\s*(\d{1,9})", line, re.IGNORECASE)
    step = re.search(r"\bDT\s*=\s*" + _VALUE, line, re.IGNORECASE)
    older = re.match(r"\s*(\d{1,9})\s*,?\s+" + _VALUE, line)
    if count is not None and step is not None:
        points, sample_time = int(count.group(1)), _number(step.group(1))
    elif older is not None:
        points, sample_time = int(older.group(1)), _number(older.group(2))
    else:
        raise InputError(f"{file}: line {place + 1}: NPTS and DT not understood: {show(line.strip())}")
    units = " ".join(lines[:place]).upper()
    if re.search(r"\b(VELOCITY|DISPLACEMENT) TIME SERIES", units):
        raise InputError(f"{file}: a velocity or displacement series: the .AT2 file has the acceleration")
    stated = re.search(r"UNITS\s+OF\s+(\S+)", units)
    if stated is not None and stated.group(1).strip(".,()") != "G":
        raise InputError(f"{file}: units of {show(stated.group(1))}: an .AT2 file is in units of G")
    values: list[float] = []
    for k, row in enumerate(lines[place + 1 :], start=place + 2):
        # Fortran columns may touch: a sign after a digit starts a new number.
        for cell in re.sub(r"(?<=[\d.])(?=[+-])", " ", row).split():
            if not re.fullmatch(_VALUE, cell):
                raise InputError(f"{file}: line {k}: not a number: {show(cell)}")
            values.append(_number(cell))
    if len(values) != points:
        raise InputError(f"{file}: {len(values)} samples, its header says NPTS={points}")
    title = "; ".join(" ".join(line.split()) for line in lines[: min(place, 2)] if line.strip())
    return sample_time, np.asarray(values, dtype=np.float64) * STANDARD_GRAVITY, title


def _number(text: str) -> float:
    return float(text.lower().replace("d", "e"))


def _stated(file: str, comments: list[str], key: str) -> float | None:
    """The number after ``key=`` in the comments; None where there is none."""
    for comment in comments:
        match = re.search(rf"(?:^|[\s#,;]){key}\s*=\s*(\S*)", comment)
        if match is not None:
            text = match.group(1).rstrip(",;")
            if not re.fullmatch(_VALUE, text):
                raise InputError(f"{file}: {key}={show(text)} in the header is not a number")
            return _number(text)
    return None
