"""What a learned controller sees: measurements scaled, cut off, and stacked over the last control periods."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mrdamp.errors import InputError

Array = NDArray[np.float64]
Observation = NDArray[np.float32]


@dataclass(frozen=True)
class Observer:
    """Measurements -> observation; the same object serves an environment and an exported policy.

    signals: names of measurements (see `mrdamp.control.base`), s of them. scales: (s,) the size of each in its own
    unit; an observation is the value over it. history: how many control periods are stacked, the newest first.
    action_in_observation: each of them also holds the command that was held when it was measured. memory: time
    constants, in control periods, of leaky averages of every signal that follow it in each of them: a longer past in
    few numbers.
    command_max: A or V, what that command is divided by, one number for each damper. limit: what a scaled value is
    cut off at, as a real sensor has a range.

    Before the first call (`reset`) the past is taken to be like the first measurement. Raises InputError.
    """

    signals: tuple[str, ...]
    scales: tuple[float, ...]
    history: int = 1
    action_in_observation: bool = True
    command_max: tuple[float, ...] = (1.0,)
    limit: float = 20.0
    memory: tuple[float, ...] = ()
    _past: list[Array] = field(default_factory=list, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("scales", "command_max", "memory"):
            object.__setattr__(self, name, tuple(float(v) for v in np.atleast_1d(getattr(self, name))))
        object.__setattr__(self, "signals", tuple(self.signals))
        if not self.signals or len(set(self.signals)) != len(self.signals):
            raise InputError(f"observer: signals is {self.signals}; allowed: at least one name, each once")
        if len(self.scales) != len(self.signals):
            raise InputError(f"observer: {len(self.scales)} scales for {len(self.signals)} signals")
        for name in ("scales", "command_max", "memory"):
            if not all(0 < v < math.inf for v in getattr(self, name)):
                raise InputError(f"observer: {name} is {getattr(self, name)}; allowed: numbers > 0")
        if (
            isinstance(self.history, bool)
            or not isinstance(self.history, int)
            or not 1 <= self.history <= 1000
        ):
            raise InputError(f"observer: history is {self.history!r}; allowed: 1 to 1000 control periods")
        if not 0 < self.limit < math.inf:
            raise InputError(f"observer: limit is {self.limit}; allowed: a number > 0")

    @property
    def width(self) -> int:
        """Numbers of one control period."""
        return len(self.signals) * (1 + len(self.memory)) + len(self.command_max) * self.action_in_observation

    @property
    def size(self) -> int:
        """Numbers of an observation."""
        return self.width * self.history

    @property
    def names(self) -> tuple[str, ...]:
        """(size,) what each number of an observation is; `[-1]` is one control period ago."""
        one = list(self.signals)
        if self.action_in_observation:
            many = len(self.command_max) > 1
            one += [f"command_{k + 1}" if many else "command" for k in range(len(self.command_max))]
        one += [f"{name}~{periods:g}" for periods in self.memory for name in self.signals]
        return tuple(f"{name}[{-k}]" if k else name for k in range(self.history) for name in one)

    def scaled(self, values: Array, last_command: Array, before: Array | None = None) -> Array:
        """One control period: values (..., s) and last_command (..., dampers) -> (..., width).

        before: (..., width) of the period before, None where there is none.
        """
        scales, command_max, keep = self._numbers
        now = values / scales
        if self.action_in_observation:
            now = np.concatenate([now, last_command / command_max], axis=-1)
        now = np.minimum(np.maximum(now, -self.limit), self.limit)
        if not self.memory:
            return now
        signals = now[..., None, : len(self.signals)]
        if before is None:
            averages = np.repeat(signals, len(keep), axis=-2)
        else:
            averages = before[..., now.shape[-1] :].reshape(*now.shape[:-1], len(keep), -1)
            averages = signals + keep[:, None] * (averages - signals)
        return np.concatenate([now, averages.reshape(*now.shape[:-1], -1)], axis=-1)

    @cached_property
    def _numbers(self) -> tuple[Array, Array, Array]:
        keep = np.exp(-1 / np.array(self.memory)) if self.memory else np.zeros(0)
        return np.array(self.scales), np.array(self.command_max), keep

    def reset(self) -> None:
        """Forget the past."""
        self._past.clear()

    def __call__(self, y: Mapping[str, float], last_command: ArrayLike) -> Observation:
        """(size,) from the measurements y and the command(s) of the period that ended. Raises InputError."""
        try:
            values = np.array([y[name] for name in self.signals], dtype=np.float64)
        except KeyError as error:
            raise InputError(f"observer: no measurement {error}; there are: {', '.join(y)}") from None
        last = np.broadcast_to(np.asarray(last_command, dtype=np.float64), (len(self.command_max),))
        now = self.scaled(values, last, self._past[0] if self._past else None)
        self._past[:] = [now, *self._past[: self.history - 1]] if self._past else [now] * self.history
        return np.concatenate(self._past).astype(np.float32)

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "signals": list(self.signals),
            "scales": list(self.scales),
            "history": self.history,
            "action_in_observation": self.action_in_observation,
            "command_max": list(self.command_max),
            "limit": self.limit,
            "memory": list(self.memory),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Observer:
        """From `to_dict`. Raises InputError where an entry is missing or unknown."""
        try:
            return cls(**{**data, "signals": tuple(data["signals"]), "scales": tuple(data["scales"])})
        except (TypeError, KeyError) as error:
            raise InputError(f"observer: {error}") from None


class Stack:
    """The stacked observations of n plants at once, row by row as `Observer` makes them.

    past: (n, history, width), the newest first.
    """

    def __init__(self, observer: Observer, n: int) -> None:
        self.observer = observer
        self.past: Array = np.zeros((n, observer.history, observer.width))

    def push(self, values: Array, last_command: Array) -> Observation:
        """(n, size) after a control period: values (n, signals), last_command (n, dampers)."""
        now = self.observer.scaled(values, last_command, self.past[:, 0])
        self.past[:, 1:] = self.past[:, :-1]
        self.past[:, 0] = now
        return self.past.reshape(len(values), -1).astype(np.float32)

    def restart(self, rows: Sequence[int], values: Array, last_command: Array) -> Observation:
        """(rows, size): these rows have no past but this; values (rows, signals)."""
        chosen = list(rows)
        self.past[chosen] = self.observer.scaled(values, last_command)[:, None, :]
        return self.past[chosen].reshape(len(chosen), -1).astype(np.float32)
