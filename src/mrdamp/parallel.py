"""Independent tasks over processes, through joblib: this machine's, or a Ray cluster's.

The backend is joblib's own (loky) unless the environment variable MRDAMP_BACKEND is `ray` (extra `cluster`).
Results come in the order of the tasks and do not depend on the backend or on the number of processes, as long as a
task's seed is its own; every task computes with one thread of BLAS, so that they do not crowd each other.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import joblib
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp.errors import InputError

Result = TypeVar("Result")
#: Of a long run: called with what is done, and a share from 0 to 1.
Progress = Callable[[str, float], None]
BACKENDS = ("loky", "ray")
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
        raise InputError(f"MRDAMP_BACKEND is '{name}'; allowed: {', '.join(BACKENDS)}")
    try:
        from ray.util.joblib import register_ray
    except ImportError:
        raise InputError(
            "MRDAMP_BACKEND is 'ray', which is not installed: pip install 'mrdamp[cluster]'"
        ) from None
    register_ray()
    with joblib.parallel_config(backend=name):
        yield name
