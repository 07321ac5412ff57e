"""Sets in the folder of MRDAMP_DATA."""

from __future__ import annotations

import os
from pathlib import Path

from mrdamp.datasets.catalogue import CATALOGUE, dataset
from mrdamp.errors import InputError
from mrdamp.records import SUFFIXES, RecordSet, read_records

VARIABLE = "MRDAMP_DATA"


def data_folder(folder: Path | str | None = None) -> Path:
    """The folder of the sets: as given, or of MRDAMP_DATA. Raises InputError where neither is there."""
    named = folder or os.environ.get(VARIABLE)
    if not named:
        raise InputError(f"no folder for data sets: set {VARIABLE}, or name one")
    return Path(named)


def found(folder: Path | str | None = None) -> dict[str, int]:
    """Number of records by set that lies in the folder; none where there is no folder."""
    try:
        root = data_folder(folder)
    except InputError:
        return {}
    halves = ("train", "validation")
    counts = {
        name: sum(file.name.endswith(SUFFIXES) for half in halves for file in (root / name / half).glob("*"))
        for name in CATALOGUE
    }
    return {name: count for name, count in counts.items() if count}


def read(name: str, folder: Path | str | None = None) -> RecordSet:
    """A set's records. Raises InputError: unknown, or not in the folder."""
    known, path = dataset(name), data_folder(folder) / name
    if not path.is_dir():
        mend = f"fetch it: mrdamp datasets {name} --fetch" if known.source else f"it is at {known.url}"
        raise InputError(f"{path}: no such folder; {mend}")
    return read_records(path)
