"""What a controller of an MR damper is, and how its measurements are named."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable


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

    The caller calls `reset` before a run and then `command` at t = 0, period, 2 period, ...,
    exactly once each, and holds the command until the next call.
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
        """Command (A or V, as the damper's parameters) from the measurements y at time t (s)."""
