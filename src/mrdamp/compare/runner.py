"""Many independent runs on several processes, kept in a file so that an interrupted comparison continues."""

from __future__ import annotations

import json
from collections.abc import Sequence
from operator import methodcaller
from pathlib import Path
from typing import Any, Protocol, TypedDict, Unpack

from mrdamp.compare.bench import digest
from mrdamp.errors import InputError
from mrdamp.parallel import Progress, mapped


class How(TypedDict, total=False):
    """How many runs are made. jobs: processes, 1 by default, -1 for all cores; keep: the file of results that are not
    made again; progress: called with what is being done and its share."""

    jobs: int
    keep: Path | None
    progress: Progress | None


class Task(Protocol):
    """What is run: pure, so that any number of processes gives the same."""

    def key(self) -> str:
        """Hash of all inputs of the result."""

    def run(self) -> dict[str, Any]:
        """The result, for JSON."""


class Kept(dict[str, dict[str, Any]]):
    """Results by key in a file of JSON lines; None keeps them in memory alone. A damaged or changed line is dropped."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        super().__init__()
        if path is None or not path.exists():
            return
        text = path.read_text(encoding="utf-8", errors="replace")
        if text and not text.endswith("\n"):  # cut off in the middle of a line
            with path.open("a", encoding="utf-8") as stream:
                stream.write("\n")
        for line in text.splitlines():
            try:
                entry = json.loads(line)
                if entry["result"] and entry["digest"] == digest([entry["key"], entry["result"]]):
                    self[entry["key"]] = entry["result"]
            except (ValueError, KeyError, TypeError):
                continue

    def add(self, key: str, result: dict[str, Any]) -> None:
        """Keep a result. Raises InputError where the file cannot be written."""
        self[key] = result
        if self.path is not None:
            try:
                with self.path.open("a", encoding="utf-8") as stream:
                    line = {"key": key, "result": result, "digest": digest([key, result])}
                    stream.write(json.dumps(line) + "\n")
            except OSError as error:
                raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None


def run_all(tasks: Sequence[Task], what: str = "runs", **how: Unpack[How]) -> list[dict[str, Any]]:
    """The result of every task, in their order; those that `keep` holds are not run again. Raises InputError."""
    jobs, progress = how.get("jobs", 1), how.get("progress")
    if jobs == 0:
        raise InputError("compare: 0 jobs; allowed: 1 or more, or -1 for all cores")
    kept = Kept(how.get("keep"))
    keys = [task.key() for task in tasks]
    left = {key: task for key, task in zip(keys, tasks, strict=True) if key not in kept}
    done = len(tasks) - len(left)
    if progress:
        progress(f"{what}: {done} of {len(tasks)} kept", done / max(len(tasks), 1))
    results = mapped(methodcaller("run"), [(task,) for task in left.values()], jobs)
    for key, result in zip(left, results, strict=True):
        kept.add(key, result)
        done += 1
        if progress:
            progress(what, min(1.0, done / len(tasks)))
    return [kept[key] for key in keys]
