"""What an inverse of an MR damper is: from the force that is wanted to the command that brings it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from mrdamp.errors import InputError
from mrdamp.model import Model


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

    Raises InputError where neither says a largest command, or the range is empty.
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


def check_period(name: str, period: float) -> float:
    """The period (s); InputError where it is none."""
    if not 0 < period < math.inf:
        raise InputError(f"inverse {name}: period is {period}; allowed: > 0 s")
    return float(period)


def previewed(wanted: float, before: float | None, periods: float) -> float:
    """The wanted force so many control periods on, as it changed over the last one (`before`; None: not yet).

    By at most its own size: it may double and come to nothing, and does not change its sign, so a jump does not
    call for a force that nobody wanted.
    """
    if before is None:
        return wanted
    change = periods * (wanted - before)
    return wanted + min(max(change, -abs(wanted)), abs(wanted))
