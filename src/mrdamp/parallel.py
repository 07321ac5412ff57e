"""Independent tasks over processes, through joblib: this machine's, or a Ray cluster's.

The backend is joblib's own (loky) unless the environment variable MRDAMP_BACKEND is `ray` (extra `cluster`).
Results come in the order of the tasks and do not depend on the backend or on the number of processes, as long as a
task's seed is its own; every task computes with one thread of BLAS, so that they do not crowd each other. Finished
ones can be kept in a file, from which an interrupted run goes on.
"""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from operator import methodcaller
from pathlib import Path
from typing import Any, NamedTuple, TypedDict, TypeVar, Unpack

import joblib
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp.errors import InputError, optional
from mrdamp.files import digest

Result = TypeVar("Result")
#: Of a long run: called with what is done, and a share from 0 to 1.
Progress = Callable[[str, float], None]
_watched = False


def mapped(
    function: Callable[..., Result], tasks: Iterable[tuple[Any, ...]], jobs: int = 1
) -> Iterator[Result]:
    """function(*task) for every task, yielded in the tasks' order as they come.

    jobs: processes; 1 computes here, -1 takes every core. Raises InputError for a backend that is unknown or not
    installed.
    """
    listed = list(tasks)
    if jobs == 1 or len(listed) < 2:
        for task in listed:
            yield _alone(0, function, *task)
        return
    with _backend() as backend:
        # Ray's backend hands out nothing before all is done.
        how = "list" if backend == "ray" else "generator"
        calls = (joblib.delayed(_alone)(os.getpid(), function, *task) for task in listed)
        with _uninterrupted():
            results = joblib.Parallel(n_jobs=jobs, return_as=how)(calls)
        yield from results


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Processes that are started here leave Ctrl-C, which the terminal sends to all of them, to this one."""
    if threading.current_thread() is not threading.main_thread():  # no other may set signals
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def silent(what: str, share: float) -> None:
    """The `Progress` of a run that nobody watches."""


def _alone(parent: int, function: Callable[..., Result], *task: Any) -> Result:
    """parent: process that this one works for, 0 for its own; a kill of it leaves no worker behind."""
    global _watched
    if os.getppid() == parent and not _watched:
        _watched = True
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    with threadpool_limits(1):
        return function(*task)


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


@contextmanager
def _backend() -> Iterator[str]:
    name = os.environ.get("MRDAMP_BACKEND", "loky")
    if name == "loky":
        yield name
        return
    if name != "ray":
        raise InputError(f"MRDAMP_BACKEND is '{name}'; allowed: loky, ray")
    optional("ray.util.joblib", "cluster", "MRDAMP_BACKEND is 'ray'").register_ray()
    with joblib.parallel_config(backend=name):
        yield name


class Kept(dict[str, dict[str, Any]]):
    """Results by key in a file of JSON lines; None keeps them in memory alone. A damaged or changed line is dropped.

    Raises InputError for a file of another kind.
    """

    def __init__(self, path: Path | str | None) -> None:
        self.path = None if path is None else Path(path)
        super().__init__()
        if self.path is None or not self.path.exists():
            return
        text, foreign = self.path.read_text(encoding="utf-8", errors="replace"), False
        for line in text.splitlines():
            try:
                entry = json.loads(line)
                if entry["result"] and entry["digest"] == digest([entry["key"], entry["result"]]):
                    self[entry["key"]] = entry["result"]
            except ValueError:
                continue
            except (KeyError, TypeError):
                foreign = True
        if foreign and not self:
            raise InputError(f"{self.path}: no file of finished runs; delete it to begin anew")
        if text and not text.endswith("\n"):  # cut off in the middle of a line
            with self.path.open("a", encoding="utf-8") as stream:
                stream.write("\n")

    def add(self, key: str, result: dict[str, Any]) -> None:
        """Keep a result. Raises InputError where the file cannot be written."""
        self[key] = result
        if self.path is not None:
            try:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                with self.path.open("a", encoding="utf-8") as stream:
                    line = {"key": key, "result": result, "digest": digest([key, result])}
                    stream.write(json.dumps(line) + "\n")
            except OSError as error:
                raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None


def finished(
    work: Callable[..., Result],
    tasks: Mapping[str, tuple[Any, ...]],
    kept: Kept,
    jobs: int,
    say: Callable[[int, Result | None], None],
    pack: Callable[[Result], dict[str, Any]],
    unpack: Callable[[dict[str, Any]], Result],
) -> dict[str, Result]:
    """What `work` makes of each task, by key and in their order; those that are kept are not run again.

    say: called with how many are there, and the one just made, None at first. pack, unpack: to what JSON can hold, and
    back.
    """
    found = {key: unpack(kept[key]) for key in tasks if key in kept}
    left = {key: task for key, task in tasks.items() if key not in found}
    say(len(found), None)
    for key, result in zip(left, mapped(work, left.values(), jobs), strict=True):
        kept.add(key, pack(result))
        found[key] = result
        say(len(found), result)
    return {key: found[key] for key in tasks}


class How(TypedDict, total=False):
    """How many runs are made. jobs: processes, 1 by default, -1 for all cores; keep: the file of results that are not
    made again; progress: called with what is being done and its share."""

    jobs: int
    keep: Path | None
    progress: Progress | None


class Job(NamedTuple):
    """key: hash of all inputs of the result; run: gives it, for JSON, the same in any number of processes."""

    key: str
    run: Callable[[], dict[str, Any]]


def run_all(tasks: Sequence[Job], what: str = "runs", **how: Unpack[How]) -> list[dict[str, Any]]:
    """The result of every task, in their order; those that `keep` holds are not run again. Raises InputError."""
    jobs, progress = how.get("jobs", 1), how.get("progress") or silent
    if jobs == 0:
        raise InputError("0 jobs; allowed: 1 or more, or -1 for all cores")
    keys = [task.key for task in tasks]
    each = {key: (task,) for key, task in zip(keys, tasks, strict=True)}

    def say(count: int, made: dict[str, Any] | None) -> None:
        done = len(tasks) - len(each) + count
        progress(what if made else f"{what}: {done} of {len(tasks)} kept", done / max(len(tasks), 1))

    found = finished(methodcaller("run"), each, Kept(how.get("keep")), jobs, say, dict, dict)
    return [found[key] for key in keys]
