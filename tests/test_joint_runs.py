"""Tasks whose runs are made in one call: each gets what it would get alone."""

import _thread
import threading
import time

import pytest

from mrdamp.diagnosis.problem.joint_runs import joint, side_by_side
from mrdamp.errors import InputError


class Squares:
    """A call that squares numbers and refuses negative ones; `calls` has the items of each."""

    def __init__(self) -> None:
        self.calls: list[list[int]] = []

    def __call__(self, items: list[int]) -> list[int]:
        self.calls.append(sorted(items))
        if min(items) < 0:
            raise InputError(f"{min(items)} is below 0")
        return [x * x for x in items]


def test_calls_of_tasks_are_made_together_and_each_task_gets_its_own() -> None:
    squares = Squares()

    def twice(x: int) -> list[int]:
        (first,) = joint("k", squares, [x])
        return joint("k", squares, [first, first + 1])

    assert side_by_side(twice, [(1,), (2,), (3,)]) == [[1, 4], [16, 25], [81, 100]]
    assert squares.calls == [[1, 2, 3], [1, 2, 4, 5, 9, 10]]


def test_tasks_of_unequal_length_end_one_by_one() -> None:
    squares = Squares()

    def steps(count: int) -> int:
        return sum(joint("k", squares, [1])[0] for _ in range(count))

    assert side_by_side(steps, [(1,), (4,), (2,)]) == [1, 4, 2]
    assert [len(items) for items in squares.calls] == [3, 2, 1, 1]


def test_only_calls_with_one_key_are_joined() -> None:
    squares = Squares()
    doubled: list[list[int]] = []

    def double(items: list[int]) -> list[int]:
        doubled.append(sorted(items))
        return [2 * x for x in items]

    def task(x: int) -> int:
        return joint("d", double, [x], 2)[0] if x % 2 else joint("s", squares, [x], 2)[0]

    assert side_by_side(task, [(k,) for k in range(1, 5)]) == [2, 4, 6, 16]
    assert (doubled, squares.calls) == ([[1, 3]], [[2, 4]])


def test_tasks_that_begin_others_share_their_calls() -> None:
    squares = Squares()

    def inner(x: int) -> int:
        return joint("k", squares, [x])[0]

    def outer(x: int) -> int:
        return sum(side_by_side(inner, [(x,), (x + 1,)]))

    assert side_by_side(outer, [(1,), (3,)]) == [5, 25]
    assert squares.calls == [[1, 2, 3, 4]]


def test_a_refused_item_fails_its_own_task_alone() -> None:
    squares = Squares()
    kept: list[int] = []

    def task(x: int) -> None:
        kept.append(joint("k", squares, [x])[0])

    with pytest.raises(InputError, match="-2 is below 0"):
        side_by_side(task, [(1,), (-2,), (3,)])
    assert sorted(kept) == [1, 9]


def test_an_interrupt_ends_the_tasks() -> None:
    before = threading.active_count()
    interrupts: list[str] = []

    def interrupted(items: list[int]) -> list[int]:
        if not interrupts:
            interrupts.append("one")
            _thread.interrupt_main()
        time.sleep(0.1)
        return items

    def endless(x: int) -> None:
        while True:
            joint("k", interrupted, [x])

    with pytest.raises(KeyboardInterrupt):
        side_by_side(endless, [(1,), (2,)])
    for _ in range(50):
        if threading.active_count() == before:
            break
        time.sleep(0.1)
    assert threading.active_count() == before


def test_alone_nothing_waits() -> None:
    squares = Squares()
    assert joint("k", squares, [3]) == [9]
    assert side_by_side(lambda x: joint("k", squares, [x])[0], [(4,)]) == [16]
