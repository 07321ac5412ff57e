"""A wanted force, and how a damper's command follows it.

A semi-active controller has two halves: an aim (the force that would be wanted of an ideal actuator) and a
follower (the command that brings the damper's own force near it). fc is the wanted force, f the measured one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from mrdamp.errors import InputError, require_positive

if TYPE_CHECKING:
    from mrdamp.inverse import Inverse


class Aim(Protocol):
    """Wanted force in N, positive where the damper is being extended, once per control period."""

    def reset(self) -> None:
        """Forget the past."""

    def __call__(self, t: float, y: Mapping[str, float]) -> float:
        """The force wanted at time t (s) for the measurements y (see control.base)."""


class Follower(Protocol):
    """From a wanted force to a command."""

    def reset(self) -> None:
        """Forget the past."""

    def __call__(self, wanted: float, t: float, y: Mapping[str, float]) -> float:
        """Command (A or V) for the force wanted (N) at time t (s)."""


class ForceController:
    """Aim and follower as one controller. Attributes: aim; follower; wanted, the last wanted force, N."""

    def __init__(self, aim: Aim, follower: Follower, period: float, name: str) -> None:
        if not 0 < period < math.inf:
            raise InputError(f"controller {name}: period is {period}; allowed: a finite number > 0 s")
        self.aim, self.follower = aim, follower
        self.period, self.name = period, name
        self.wanted = 0.0

    def reset(self) -> None:
        self.aim.reset()
        self.follower.reset()
        self.wanted = 0.0

    def command(self, t: float, y: Mapping[str, float]) -> float:
        self.wanted = self.aim(t, y)
        return self.follower(self.wanted, t, y)


def clip(wanted: float, force: float, command_max: float) -> float:
    """command_max * H((wanted - force) * force); H(0) = 0. Forces in N."""
    return command_max if (wanted - force) * force > 0 else 0.0


@dataclass(frozen=True)
class OnOff:
    """Clipping: the full command where the force has the sign of the wanted one and is smaller, else none.

    Dyke, Spencer, Sain and Carlson 1996, doi 10.1088/0964-1726/5/5/006, eq. (12). command_max: A or V.
    """

    command_max: float

    def __post_init__(self) -> None:
        require_positive("controller", command_max=self.command_max)

    def reset(self) -> None:
        """Nothing to forget."""

    def __call__(self, wanted: float, t: float, y: Mapping[str, float]) -> float:
        return clip(wanted, y["force"], self.command_max)


@dataclass(frozen=True)
class Modulated:
    """Clipping with a command in proportion to the wanted force: command_max min(1, |fc| / force_max) or none.

    Yoshida and Dyke, J. Eng. Mech. 130 (2004) 386-392, doi 10.1061/(ASCE)0733-9399(2004)130:4(386).
    command_max: A or V; force_max: N, the force at which the full command is reached.
    """

    command_max: float
    force_max: float

    def __post_init__(self) -> None:
        require_positive("controller", command_max=self.command_max)
        require_positive("controller", force_max=self.force_max)

    def reset(self) -> None:
        """Nothing to forget."""

    def __call__(self, wanted: float, t: float, y: Mapping[str, float]) -> float:
        share = min(1.0, abs(wanted) / self.force_max)
        return clip(wanted, y["force"], share * self.command_max)


@dataclass(frozen=True)
class Tracking:
    """Force tracking: the command of the damper's inverse model, in place of on/off switching."""

    inverse: Inverse

    def reset(self) -> None:
        self.inverse.reset()

    def __call__(self, wanted: float, t: float, y: Mapping[str, float]) -> float:
        return self.inverse.command(t, wanted, y)


@dataclass(frozen=True)
class Direct:
    """The wanted force itself, N: for an ideal actuator that can push as well, the bound no damper reaches."""

    force_max: float = math.inf  # N

    def reset(self) -> None:
        """Nothing to forget."""

    def __call__(self, wanted: float, t: float, y: Mapping[str, float]) -> float:
        return min(max(wanted, -self.force_max), self.force_max)
