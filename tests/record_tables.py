"""Small record files for tests, and the line a bad one is refused with."""

from __future__ import annotations

from pathlib import Path

from mrdamp.records import read_record
from refusals import refusal_of

HEADER = "time_s,displacement_m,command,force_N"


def table(n: int = 50, dt: float = 0.002, header: str = HEADER) -> list[str]:
    """Lines of a good record."""
    width = header.count(",")
    rows = [",".join([f"{k * dt:.10g}", *(f"{k * 0.25 + j:.6g}" for j in range(width))]) for k in range(n)]
    return [header, *rows]


def write(folder: Path, lines: list[str], name: str = "a.csv") -> Path:
    path = folder / name
    path.write_text("\n".join(lines) + "\n")
    return path


def message(path: Path, required: tuple[str, ...] | None = None) -> str:
    return refusal_of(path, lambda: read_record(path, required))
