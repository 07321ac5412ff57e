"""Commands that depend on no measurement: the passive baselines, and sequences that are known in advance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mrdamp.control.base import Memoryless
from mrdamp.errors import InputError, require_positive


@dataclass(frozen=True)
class Constant(Memoryless):
    """The same command at all times. value: A or V; period: s. Raises InputError."""

    value: float
    name: str = "constant"
    period: float = 1e-3

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            raise InputError(f"controller {self.name}: value is {self.value}; allowed: a finite number")
        require_positive(f"controller {self.name}", period=self.period)

    def command(self, t: float, y: Mapping[str, float]) -> float:
        return self.value


def passive_off(period: float = 1e-3) -> Constant:
    """No field: the damper's command is zero."""
    return Constant(0.0, "passive-off", period)


def passive_on(command_max: float, period: float = 1e-3) -> Constant:
    """The largest command, A or V, all the time."""
    return Constant(command_max, "passive-on", period)


class Replay:
    """A `Controller` of commands (n,), A or V, each held over a period (s), the last one from there on.

    Raises InputError.
    """

    def __init__(self, commands: ArrayLike, period: float, name: str = "replay") -> None:
        values = np.asarray(commands, dtype=np.float64)
        if values.ndim != 1 or not len(values) or not np.isfinite(values).all():
            raise InputError(f"controller {name}: commands have shape {values.shape}; allowed: (n,), finite")
        require_positive(f"controller {name}", period=period)
        self.name, self.period = name, period
        self._commands: list[float] = values.tolist()
        self.reset()

    def reset(self) -> None:
        self._calls = 0

    def command(self, t: float, y: Mapping[str, float]) -> float:
        self._calls += 1
        return self._commands[min(self._calls, len(self._commands)) - 1]
