"""Which records a simulator was identified on: their names and hashes, as a model file and a case carry them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from mrdamp.errors import InputError
from mrdamp.files import decode, read_bytes
from mrdamp.model import Model
from mrdamp.records import Record

#: Key of a model file and of a case.json.
IDENTIFIED_ON = "identified_on"
_DIGITS = 16


def text_hash(path: Path) -> str:
    """First hex digits of the SHA-256 of a file's text; packed or not, and whatever its line ends, it is the same."""
    return hashlib.sha256(decode(str(path), read_bytes(path)).encode()).hexdigest()[:_DIGITS]


def write_identified(model: Model, records: Iterable[Record], out: Path) -> None:
    """Writes a model with the names and hashes of the records that it was fitted to, by which `mrdamp case` recognises
    them; those that were not read from a file are left out."""
    paths = dict.fromkeys(r.path for r in records if r.path is not None)
    used = [{"record": path.name, "sha256": text_hash(path)} for path in paths]
    replace(model, extra={**model.extra, IDENTIFIED_ON: used} if used else model.extra).write(out)


def hashes(where: str, entry: Any) -> frozenset[str]:
    """Hashes of an entry. Raises InputError if it has another form."""
    if not isinstance(entry, list) or not all(isinstance(e, dict) and isinstance(e.get("sha256"), str) for e in entry):
        raise InputError(f"{where}: {IDENTIFIED_ON!r} must be a list of {{\"record\", \"sha256\"}}, got {entry!r}")
    return frozenset(e["sha256"] for e in entry)
