"""Optima of completed fits in a file, so that an interrupted diagnosis can be resumed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from mrdamp.diagnosis.case.folder import Case
from mrdamp.errors import InputError
from mrdamp.files import decode, read_bytes, write_atomic
from mrdamp.model.core import Array

#: Version of the file; files with another one are ignored.
_VERSION = 3


class Kept(NamedTuple):
    """A stored fit: its point (coordinates,), whether it had converged, the point of its Jacobian
    (coordinates,), and its number of iterations."""

    point: Array
    converged: bool
    at: Array
    iterations: int


@dataclass
class Store:
    """Points by name of the fit. path None: nothing is stored. key: hash of the case; a file with another key
    is ignored."""

    path: Path | None = None
    key: str = ""
    points: dict[str, dict[str, Any]] = field(default_factory=dict)
    _lock: Lock = field(default_factory=Lock, repr=False)

    @classmethod
    def of(cls, path: Path, case: Case) -> Store:
        """The store of a case: from an earlier run, or empty."""
        key = content_key(case)
        try:
            data = json.loads(decode(str(path), read_bytes(path)))
            if data.get("key") == key:
                return cls(path, key, dict(data["points"]))
        except (InputError, ValueError, KeyError, AttributeError):
            pass  # no file, or one damaged by an abort
        return cls(path, key)

    def get(self, name: str) -> Kept | None:
        """The stored fit, or None."""
        found = self.points.get(name)
        if found is None:
            return None
        at, iterations = np.array(found["at"]), int(found["iterations"])
        return Kept(np.array(found["point"]), bool(found["converged"]), at, iterations)

    def put(
        self, name: str, point: Array, converged: bool, at: Array | None = None, iterations: int = 0
    ) -> None:
        """Stores a fit's point and that of its Jacobian (None: the same)."""
        before = point if at is None else at
        with self._lock:
            self.points[name] = {
                "point": point.tolist(),
                "converged": converged,
                "at": before.tolist(),
                "iterations": iterations,
            }
            if self.path is not None:
                write_atomic(self.path, json.dumps({"key": self.key, "points": self.points}))

    def remove(self) -> None:
        """Deletes the file at the end of the diagnosis."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)


def content_key(case: Case) -> str:
    """Hash of a case's nominal model and records."""
    h = hashlib.sha256(f"{_VERSION} {json.dumps(case.model.to_dict(), sort_keys=True)}".encode())
    for record in (*case.records, *(r for r, _ in case.repeats), *case.baseline):
        for name, values in record.channels.items():
            h.update(name.encode())
            h.update(np.ascontiguousarray(values).tobytes())
    return h.hexdigest()


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Writes arrays and lists of names as one npz file, atomically; the figures of a page are drawn from it."""
    made: dict[str, Any] = {name: np.asarray(values) for name, values in arrays.items()}
    write_atomic(path, lambda file: np.savez_compressed(file, **made))
