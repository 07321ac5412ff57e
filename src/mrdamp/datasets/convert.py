"""Sources' own files as records."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from mrdamp.errors import InputError
from mrdamp.records import Record

#: Half of the set and the record, of one file.
Converter = Callable[[Path], tuple[str, Record]]

_UTFSM_NAME = re.compile(r"(\d+)mm(\d+(?:x\d+)?)Hz(\d+(?:x\d+)?)A")
_UTFSM_HELD_OUT = {("10", "1"), ("25", "0x25")}  # other amplitudes and frequencies than the rest


def utfsm(path: Path) -> tuple[str, Record]:
    """`25mm0x25Hz0x5A.txt`: columns s, mm, mm/s and N without a head; the name contains the current."""
    match = _UTFSM_NAME.fullmatch(path.stem)
    if match is None:
        raise InputError(f"{path}: the name does not tell amplitude, frequency and current")
    try:
        columns = np.loadtxt(path, ndmin=2).T
    except ValueError as error:
        raise InputError(f"{path}: not a table of numbers: {' '.join(str(error).split())[:80]}") from None
    if len(columns) != 4 or columns.shape[1] < 3:
        raise InputError(
            f"{path}: {len(columns)} columns of {columns.shape[1]} rows; 4 of at least 3 are needed"
        )
    t, x, v, force = columns
    step = float(t[-1] - t[0]) / (len(t) - 1)
    if not step > 0 or np.abs(np.diff(t) - step).max() > 0.02 * step:
        raise InputError(f"{path}: the time does not run evenly")
    amplitude, frequency, current = (text.replace("x", ".") for text in match.groups())
    channels = {
        "displacement_m": 1e-3 * x, "velocity_m_s": 1e-3 * v, "command": np.full(len(t), float(current)),
        "force_N": force,
    }  # fmt: skip
    half = "validation" if match.groups()[:2] in _UTFSM_HELD_OUT else "train"
    name = f"sine_{int(amplitude):02d}mm_{float(frequency):.2f}Hz_{float(current):.2f}A"
    return half, Record(name, None, step, channels)


CONVERTERS: Mapping[str, Converter] = {"utfsm": utfsm}
