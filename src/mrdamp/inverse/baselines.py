"""What an inverse of an MR damper is, from the force that is wanted to the command that brings it; and what it is
compared with: on/off switching, and commands independent of the wanted force."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from mrdamp.control.base import Memoryless
from mrdamp.control.force_control import clip
from mrdamp.errors import InputError
from mrdamp.model import Model


@dataclass(frozen=True)
class Switching(Memoryless):
    """Dyke's clipping: the largest command where the force has the wanted one's sign and is smaller, else zero.

    S. J. Dyke et al., Smart Materials and Structures 5 (1996) 565-575, doi 10.1088/0964-1726/5/5/006. command_max:
    A or V; period: s.
    """

    command_max: float
    name: str = "on/off switching"
    period: float = 1e-3

    def command(self, t: float, wanted_force: float, y: Mapping[str, float]) -> float:
        return clip(wanted_force, y["force"], self.command_max)


@dataclass(frozen=True)
class Fixed(Memoryless):
    """The same command at all times. value: A or V; period: s."""

    value: float
    name: str = "constant"
    period: float = 1e-3

    def command(self, t: float, wanted_force: float, y: Mapping[str, float]) -> float:
        return self.value


_MEMORY = 1.0  # s, over which a share is learnt


@runtime_checkable
class Inverse(Protocol):
    """Turns a wanted force into the damper's command, once per control period.

    The caller calls `reset` before a run and then `command` at t = 0, period, 2 period, ..., exactly once each, and
    holds the command until the next call. Measurements are named as in `mrdamp.control.base`; `stroke`,
    `stroke_velocity` and `force` are used.
    """

    @property
    def name(self) -> str:
        """A short name for tables."""

    @property
    def period(self) -> float:
        """Control period, s."""

    def reset(self) -> None:
        """Forget the past; the damper is at rest."""

    def command(self, t: float, wanted_force: float, y: Mapping[str, float]) -> float:
        """Command (A or V) for a wanted force (N, sign as the damper's) from the measurements y at time t (s)."""


def command_range(model: Model, given: tuple[float, float] | None = None) -> tuple[float, float]:
    """Smallest and largest command: as given, or 0 and up to what the model holds for.

    Raises InputError if neither gives a largest command, or the range is empty.
    """
    if given is None:
        low = max(0.0, model.attributes.get("command_min", 0.0))
        high = model.attributes.get("command_max", math.nan)
        if math.isnan(high):
            raise InputError(
                f"{model.name}: no command_max among its parameters; give the range of the command"
            )
        given = low, high
    low, high = given
    if not -math.inf < low < high < math.inf:
        raise InputError(
            f"{model.name}: command from {low:g} to {high:g}; allowed: finite, from below to above"
        )
    return float(low), float(high)


class Extrapolation:
    """Extrapolation of a value over some control periods: the value, and a share of the expected change.

    The share is estimated on line. It is the least-squares gain, limited to 0 to 1, between the changes expected in the
    last second or so and those that occurred: 1 for a smooth force, 0 for one that oscillates. A change is limited to
    the value's own size, so that the force at most doubles and never changes its sign.

    periods: how far ahead, rounded to whole ones. period: s.
    """

    def __init__(self, periods: float, period: float) -> None:
        self._past: deque[tuple[float, float]] = deque(maxlen=max(1, round(periods)))
        self._keep = math.exp(-period / _MEMORY)
        self.reset()

    def reset(self) -> None:
        """Without a past the share is 0."""
        self._past.clear()
        self._occurred = self._expected = 0.0

    @property
    def share(self) -> float:
        """Gain from expected to actual change, 0 to 1."""
        return min(max(self._occurred / self._expected, 0.0), 1.0) if self._expected > 0 else 0.0

    def __call__(self, value: float, change: float) -> float:
        """The extrapolated value, from the present one and the expected change; to be called once a control period."""
        change = min(max(change, -abs(value)), abs(value))
        if len(self._past) == self._past.maxlen:
            before, expected = self._past[0]
            self._occurred = self._keep * self._occurred + expected * (value - before)
            self._expected = self._keep * self._expected + expected * expected
        self._past.append((value, change))
        return value + self.share * change
