"""What a controller of an MR damper is, how its measurements are named, and what is put before and behind one."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from mrdamp.errors import InputError


@runtime_checkable
class Controller(Protocol):
    """Turns measurements into the damper's command, once per control period.

    Measurements are named (SI, floors counted from 1 up; a frame has all of them):

    | name | what |
    |---|---|
    | `acceleration_1` .. `acceleration_N` | absolute acceleration of a floor, m/s2 |
    | `displacement_1` .. `displacement_N` | displacement of a floor to the ground, m |
    | `stroke` | piston displacement, extension positive, m |
    | `stroke_velocity` | its velocity, m/s |
    | `force` | the damper's force, positive when it is being extended, N |
    | `stroke_2`, `force_2` .. | those of a second damper .. |

    The caller calls `reset` before a run and then `command` at t = 0, period, 2 period, ...,
    exactly once each, and holds the command until the next call. Controllers of the package take measurements of many
    runs at once too, (rows,) each.
    """

    @property
    def name(self) -> str:
        """A short name for tables."""

    @property
    def period(self) -> float:
        """Control period, s."""

    def reset(self) -> None:
        """Forget the past; the structure is at rest."""

    def command(self, t: float, y: Mapping[str, float]) -> float:
        """Command (A or V, as the damper's parameters) from the measurements y at time t (s); of m dampers (m,)."""


class Memoryless:
    """Base of what has nothing to forget."""

    def reset(self) -> None:
        """Nothing."""


def sensor_name(signal: str, k: int) -> str:
    """Of damper k's signal, from 0: `force`, `force_2` .."""
    return signal if k == 0 else f"{signal}_{k + 1}"


def of_damper(y: Mapping[str, Any], k: int) -> Mapping[str, Any]:
    """The measurements y with those of damper k, from 0, under the names of the first."""
    return y if k == 0 else {**y, **{name: y[sensor_name(name, k)] for name in OWN if sensor_name(name, k) in y}}


#: Measurements of each damper.
OWN = ("stroke", "stroke_velocity", "force")


class Unlagged:
    """Measurements whose forces, held over the control period, give the readings of their sensors.

    Exact for such a force and a first-order lag. period, sensor_lag: s; with no lag the measurements are left as they
    are. Raises InputError.
    """

    def __init__(self, period: float, sensor_lag: float) -> None:
        if not 0 <= sensor_lag < math.inf:
            raise InputError(f"a force sensor's lag is {sensor_lag}; allowed: a number >= 0, s")
        self._kept = math.exp(-period / sensor_lag) if sensor_lag > 0 else 0.0
        self.reset()

    def reset(self) -> None:
        self._forces: Mapping[str, float] = {}

    def __call__(self, y: Mapping[str, float]) -> Mapping[str, float]:
        forces = {name: value for name, value in y.items() if re.fullmatch(r"force(_\d+)?", name)} if self._kept else {}
        if not forces:
            return y
        before = self._forces or forces
        self._forces = forces
        return {**y, **{name: (f - self._kept * before[name]) / (1.0 - self._kept) for name, f in forces.items()}}


class ZeroOrderHold:
    """The controller at its own period, called `every` times as often, so that a run is sampled more finely.

    Attributes: inner; name; period, s. Raises InputError.
    """

    def __init__(self, inner: Controller, every: int) -> None:
        if every < 1:
            raise InputError(f"controller {inner.name}: held over {every} samples; allowed: 1 or more")
        self.inner, self._every = inner, every
        self.name = inner.name
        self.period = inner.period / every
        self.reset()

    def reset(self) -> None:
        self.inner.reset()
        self._calls, self._value = 0, 0.0

    def command(self, t: float, y: Mapping[str, float]) -> float:
        if self._calls % self._every == 0:
            self._value = self.inner.command(t, y)
        self._calls += 1
        return self._value
