"""Runs of the chain that independent tasks ask for, made in one call: its vector units and threads are then full.

A task goes on in a thread of its own until it needs runs, and waits there until all others wait too. What a run gives
does not depend on those beside it: the results are those of the tasks one after the other.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from mrdamp.errors import InputError

_Item = TypeVar("_Item")
_Made = TypeVar("_Made")


class _Stopped(BaseException):
    """The task that waits for this one was interrupted."""


class _Asked:
    """A call for some items, and what becomes of it."""

    def __init__(self, call: Callable[[list[Any]], list[Any]], items: Sequence[Any]) -> None:
        self.call, self.items = call, list(items)
        self.made: list[Any] | None = None
        self.error: BaseException | None = None


class _Tasks:
    """Tasks that go on side by side; `running` of them do not wait. asked: by what makes calls alike."""

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.running, self.threads, self.stopped = 0, 1, False
        self.asked: dict[Hashable, list[_Asked]] = {}

    def enter(self, count: int) -> None:
        """Counts further tasks as running, or fewer (negative)."""
        with self.changed:
            self.running += count
            self._make_if_all_wait()

    def stop(self) -> None:
        with self.changed:
            self.stopped = True
            self.changed.notify_all()

    def wait_for(self, key: Hashable, one: _Asked, threads: int) -> list[Any]:
        with self.changed:
            self.asked.setdefault(key, []).append(one)
            self.threads = max(self.threads, threads)
            self.running -= 1
            self._make_if_all_wait()
            self.changed.wait_for(lambda: self.stopped or one.made is not None or one.error is not None)
        if self.stopped:
            raise _Stopped
        if one.error is not None:
            raise one.error
        assert one.made is not None
        return one.made

    def _make_if_all_wait(self) -> None:
        if self.running > 0 or not self.asked or self.stopped:
            return
        groups, self.asked = list(self.asked.values()), {}
        if len(groups) > 1 and self.threads > 1:
            with ThreadPoolExecutor(self.threads) as pool:
                list(pool.map(_make, groups))
        else:
            for group in groups:
                _make(group)
        self.running = sum(len(group) for group in groups)
        self.changed.notify_all()


def _make(group: Sequence[_Asked]) -> None:
    """Makes the calls of a group in one. If that is refused, each alone, so that the wrong one is found."""
    try:
        made = group[0].call([item for one in group for item in one.items])
    except BaseException as error:
        if isinstance(error, InputError) and len(group) > 1:
            for one in group:
                _make([one])
            return
        for one in group:
            one.error = error
        return
    for one in group:
        one.made, made = made[: len(one.items)], made[len(one.items) :]


_local = threading.local()


def joint(
    key: Hashable, call: Callable[[list[_Item]], list[_Made]], items: Sequence[_Item], threads: int = 1
) -> list[_Made]:
    """call(items), made together with the items of other tasks whose key is equal. Raises what `call` raises."""
    tasks: _Tasks | None = getattr(_local, "tasks", None)
    return call(list(items)) if tasks is None else tasks.wait_for(key, _Asked(call, items), threads)


def side_by_side(function: Callable[..., _Made], arguments: Iterable[tuple[Any, ...]]) -> list[_Made]:
    """Results of a function for each tuple of arguments; what they ask of `joint` is made together.

    Raises the error of the first task that has one, after all have ended.
    """
    listed = list(arguments)
    if len(listed) < 2:
        return [function(*one) for one in listed]
    outer: _Tasks | None = getattr(_local, "tasks", None)
    tasks = outer or _Tasks()
    results: list[Any] = [None] * len(listed)
    errors: dict[int, BaseException] = {}

    def task(k: int) -> None:
        _local.tasks = tasks
        try:
            results[k] = function(*listed[k])
        except BaseException as error:
            errors[k] = error
        finally:
            tasks.enter(-1)

    threads = [threading.Thread(target=task, args=(k,), daemon=True) for k in range(len(listed))]
    tasks.enter(len(listed) - (outer is not None))  # a task among others waits for those that it begins
    try:
        for one in threads:
            one.start()
        for one in threads:
            one.join()
    except BaseException:
        tasks.stop()
        raise
    if outer is not None:
        outer.enter(1)
    if errors:
        raise errors[min(errors)]
    return results
