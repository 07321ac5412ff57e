"""What a controller of an MR damper is, and how its measurements are named."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable


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


def sensor_name(signal: str, k: int) -> str:
    """Of damper k's signal, from 0: `force`, `force_2` .."""
    return signal if k == 0 else f"{signal}_{k + 1}"


def of_damper(y: Mapping[str, Any], k: int) -> Mapping[str, Any]:
    """The measurements y with those of damper k, from 0, under the names of the first."""
    return y if k == 0 else {**y, **{name: y[sensor_name(name, k)] for name in OWN if sensor_name(name, k) in y}}


#: Measurements of each damper.
OWN = ("stroke", "stroke_velocity", "force")
