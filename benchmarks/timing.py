"""Interleaved timing: what is compared runs in turn, many times, so that a busy machine slows all alike."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: Does some work and returns its cost, microseconds of CPU time an item.
Task = Callable[[], float]


@dataclass(frozen=True)
class Effort:
    """How much is run: rounds of every comparison, and steps (items) of each side in a round."""

    rounds: int = 40
    steps: int = 2000


@dataclass(frozen=True)
class Ratio:
    """Median over rounds of one cost over the other, with the quartiles, and both median costs (us an item)."""

    value: float
    low: float
    high: float
    top: float
    bottom: float


def clock() -> float:
    """CPU time of this thread, us: other processes and idle worker threads do not count."""
    return time.thread_time_ns() * 1e-3


def interleave(tasks: Mapping[str, Task], rounds: int) -> dict[str, Array]:
    """Costs (rounds,) of each task; the order is turned every round, one round before is thrown away."""
    order = list(tasks)
    costs: dict[str, list[float]] = {name: [] for name in order}
    for name in order:
        tasks[name]()
    collecting = gc.isenabled()
    gc.disable()
    try:
        for _ in range(rounds):
            for name in order:
                costs[name].append(tasks[name]())
            order.reverse()
    finally:
        if collecting:
            gc.enable()
    return {name: np.array(values) for name, values in costs.items()}


def ratio(top: Array, bottom: Array) -> Ratio:
    """top over bottom, (rounds,) each, round by round."""
    low, middle, high = np.quantile(top / bottom, (0.25, 0.5, 0.75))
    return Ratio(float(middle), float(low), float(high), float(np.median(top)), float(np.median(bottom)))
