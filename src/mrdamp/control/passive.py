"""Constant commands: the passive baselines."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from mrdamp.errors import InputError


@dataclass(frozen=True)
class Constant:
    """The same command at all times. value: A or V; period: s. Raises InputError."""

    value: float
    name: str = "constant"
    period: float = 1e-3

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            raise InputError(f"controller {self.name}: value is {self.value}; allowed: a finite number")
        if not 0 < self.period < math.inf:
            raise InputError(f"controller {self.name}: period is {self.period}; allowed: > 0 s")

    def reset(self) -> None:
        """Nothing to forget."""

    def command(self, t: float, y: Mapping[str, float]) -> float:
        return self.value


def passive_off(period: float = 1e-3) -> Constant:
    """No field: the damper's command is zero."""
    return Constant(0.0, "passive-off", period)


def passive_on(command_max: float, period: float = 1e-3) -> Constant:
    """The largest command, A or V, all the time."""
    return Constant(command_max, "passive-on", period)
