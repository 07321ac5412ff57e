"""Scored rows of a bench as a JSON file, so that its figures can be computed again without its cases."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mrdamp.errors import InputError
from mrdamp.files import read_bytes, write_atomic
from studies.blindtest.score import Row


def write(file: Path, rows: Sequence[Row]) -> None:
    """Writes rows, a line for each. NaN is null."""
    lines = [json.dumps({k: _plain(v) for k, v in dataclasses.asdict(r).items()}) for r in rows]
    write_atomic(file, "[\n" + ",\n".join(lines) + "\n]\n")


def read(file: Path) -> list[Row]:
    """The rows of a file. Raises InputError if it is not one of `write`."""
    try:
        return [_row(entry) for entry in json.loads(read_bytes(file))]
    except (ValueError, TypeError, AttributeError, KeyError) as error:
        raise InputError(f"{file}: no file of scored rows: {error}") from None


def _plain(value: Any) -> Any:
    if isinstance(value, frozenset):
        return sorted(
            (_plain(v) for v in value), key=lambda v: [x or "" for x in v] if isinstance(v, list) else v
        )
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _row(entry: dict[str, Any]) -> Row:
    numbers = {f.name: math.nan for f in dataclasses.fields(Row) if f.type == "float"}
    return Row(
        **{
            **entry,
            **{name: entry[name] if entry[name] is not None else nan for name, nan in numbers.items()},
            "stages": tuple(entry["stages"]),
            "named": frozenset((name, place) for name, place in entry["named"]),
            "tied": tuple(frozenset(tie) for tie in entry["tied"]),
            "also": frozenset(entry["also"]),
        }
    )
