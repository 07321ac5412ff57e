"""Small record files for tests, the line a bad one is refused with, and the tests kept beside a case."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mrdamp.model.core import Array
from mrdamp.records import read_record
from refusals import refusal_of

HEADER = "time_s,displacement_m,command,force_N"


def table(n: int = 50, dt: float = 0.002, header: str = HEADER) -> list[str]:
    width = header.count(",")
    rows = [",".join([f"{k * dt:.10g}", *(f"{k * 0.25 + j:.6g}" for j in range(width))]) for k in range(n)]
    return [header, *rows]


def write(folder: Path, lines: list[str], name: str = "a.csv") -> Path:
    path = folder / name
    path.write_text("\n".join(lines) + "\n")
    return path


def channels_by_test(file: Path) -> dict[str, dict[str, Array]]:
    """Tests that are kept beside a case, in an npz file of arrays named test/channel."""
    arrays, tests = np.load(file), dict[str, dict[str, Array]]()
    for key in arrays.files:
        test, channel = key.split("/")
        tests.setdefault(test, {})[channel] = np.asarray(arrays[key], dtype=float)
    return tests


def message(path: Path, required: tuple[str, ...] | None = None) -> str:
    return refusal_of(path, lambda: read_record(path, required))
