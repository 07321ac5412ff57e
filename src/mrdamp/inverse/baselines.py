"""What an inverse is compared with: on/off switching, and commands independent of the wanted force."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mrdamp.control.force_control import clip


@dataclass(frozen=True)
class Switching:
    """Dyke's clipping: the largest command where the force has the wanted one's sign and is smaller, else zero.

    S. J. Dyke et al., Smart Materials and Structures 5 (1996) 565-575, doi 10.1088/0964-1726/5/5/006. command_max:
    A or V; period: s.
    """

    command_max: float
    period: float = 1e-3
    name: str = "on/off switching"

    def reset(self) -> None:
        """Nothing to forget."""

    def command(self, t: float, wanted_force: float, y: Mapping[str, float]) -> float:
        return clip(wanted_force, y["force"], self.command_max)


@dataclass(frozen=True)
class Fixed:
    """The same command at all times. value: A or V; period: s."""

    value: float
    period: float = 1e-3
    name: str = "constant"

    def reset(self) -> None:
        """Nothing to forget."""

    def command(self, t: float, wanted_force: float, y: Mapping[str, float]) -> float:
        return self.value
