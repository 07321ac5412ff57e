"""Finished parts of a long search in a JSON file: a search that was interrupted continues from it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp.errors import InputError
from mrdamp.files import decode, read_bytes, write_atomic
from mrdamp.narx.data import Series

_FORMAT = 1


class Checkpoint:
    """Results by name, in memory and, where there is a path, in a file that is rewritten whole after each.

    key: fingerprint of everything besides the name that a result depends on; results of other keys in the file are
    kept, and not found. Raises InputError for a file of another kind.
    """

    def __init__(self, path: Path | str | None, key: str) -> None:
        self.path, self.key = None if path is None else Path(path), key
        self._all: dict[str, dict[str, Any]] = {}
        if self.path is not None and self.path.exists():
            try:
                data = json.loads(decode(str(self.path), read_bytes(self.path)))
                self._all = {name: dict(value) for name, value in data["trials"].items()}
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise InputError(
                    f"{self.path}: no file of finished trials ({error}); delete it to begin anew"
                ) from None

    def get(self, name: str) -> dict[str, Any] | None:
        """A finished result; None where there is none."""
        return self._all.get(f"{self.key} {name}")

    def put(self, name: str, result: Mapping[str, Any]) -> None:
        """Keeps a result: numbers, words and lists of them."""
        self._all[f"{self.key} {name}"] = dict(result)
        if self.path is not None:
            write_atomic(self.path, json.dumps({"format": _FORMAT, "trials": self._all}) + "\n")


def fingerprint(parts: Sequence[Sequence[Series]], *more: object) -> str:
    """Of parts, with what they are used as, and of any JSON values."""
    digest = hashlib.sha256(json.dumps([_FORMAT, *more]).encode())
    for part in parts:
        for s in part:
            digest.update(repr((s.name, s.sample_time, s.n)).encode())
            for values in (s.x, s.v, s.i, s.force):
                digest.update(np.ascontiguousarray(values).tobytes())
        digest.update(b"|")
    return digest.hexdigest()[:16]
