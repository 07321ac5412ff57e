"""A wanted force, and how a damper's command follows it.

A semi-active controller has two halves: an aim (the force that would be wanted of an ideal actuator) and a
follower (the command that brings the damper's own force near it). fc is the wanted force, f the measured one. The
simplest aim is a skyhook's.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from mrdamp.control.base import OWN, Memoryless, of_damper
from mrdamp.control.lqg import Linear, linear
from mrdamp.errors import require_positive
from mrdamp.structures import ShearFrame

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
    """Aim and follower as one controller. Attributes: aim; follower; wanted, the last wanted force, N.

    Of an aim with a force for each of m dampers (m,) the follower is `Each`.
    """

    def __init__(self, aim: Aim, follower: Follower, period: float, name: str) -> None:
        require_positive(f"controller {name}", period=period)
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
    return command_max * ((wanted - force) * force > 0)


class Several:
    """Parts that forget the past together."""

    def __init__(self, parts: Sequence[Any]) -> None:
        self.parts = tuple(parts)

    def reset(self) -> None:
        for part in self.parts:
            part.reset()


class Aims(Several):
    """An aim for each of several dampers: their wanted forces (m,)."""

    def __call__(self, t: float, y: Mapping[str, float]) -> Any:
        return np.array([aim(t, y) for aim in self.parts])


class Each(Several):
    """A follower for each of several dampers, whose wanted forces come together (m,)."""

    def __call__(self, wanted: Any, t: float, y: Mapping[str, float]) -> Any:
        return np.array([f(wanted[k], t, of_damper(y, k)) for k, f in enumerate(self.parts)])


def for_each(make: Callable[[], Follower], dampers: int) -> Follower:
    """A follower of one damper, or of several."""
    return make() if dampers == 1 else Each([make() for _ in range(dampers)])


@dataclass(frozen=True)
class Resisting(Memoryless):
    """The full command wherever the force has the sign of the wanted one, whatever its size. command_max: A or V."""

    command_max: float

    def __post_init__(self) -> None:
        require_positive("controller", **vars(self))

    def __call__(self, wanted: float, t: float, y: Mapping[str, float]) -> float:
        return self.command_max * (wanted * y["force"] > 0)


@dataclass(frozen=True)
class OnOff(Resisting):
    """Clipping: the full command where the force has the sign of the wanted one and is smaller, else none.

    Dyke, Spencer, Sain and Carlson 1996, doi 10.1088/0964-1726/5/5/006, eq. (12). command_max: A or V.
    """

    def __call__(self, wanted: float, t: float, y: Mapping[str, float]) -> float:
        return clip(wanted, y["force"], self.command_max)


@dataclass(frozen=True)
class Modulated(Resisting):
    """Clipping with a command in proportion to the wanted force: command_max min(1, |fc| / force_max) or none.

    Yoshida and Dyke, J. Eng. Mech. 130 (2004) 386-392, doi 10.1061/(ASCE)0733-9399(2004)130:4(386).
    command_max: A or V; force_max: N, the force at which the full command is reached.
    """

    force_max: float

    def __call__(self, wanted: float, t: float, y: Mapping[str, float]) -> float:
        share = np.minimum(1.0, abs(wanted) / self.force_max)
        return clip(wanted, y["force"], share * self.command_max)


class Tracking:
    """Force tracking: the command of the damper's inverse model, in place of on/off switching."""

    def __init__(self, inverse: Inverse) -> None:
        self.inverse = inverse
        self._rows: list[Inverse] = []

    def reset(self) -> None:
        self.inverse.reset()
        self._rows = []

    def __call__(self, wanted: float, t: float, y: Mapping[str, float]) -> Any:
        if np.ndim(wanted) == 0:
            return self.inverse.command(t, wanted, y)
        # An inverse has the past of one run.
        forces = np.asarray(wanted).tolist()
        self._rows = self._rows or [copy.deepcopy(self.inverse) for _ in forces]
        seen = zip(*(np.asarray(y[name]).tolist() for name in OWN), strict=True)
        each = zip(self._rows, forces, seen, strict=True)
        return np.array([i.command(t, f, dict(zip(OWN, s, strict=True))) for i, f, s in each])


@dataclass(frozen=True)
class Direct(Memoryless):
    """The wanted force itself, N: for an ideal actuator that can push as well, the bound no damper reaches."""

    force_max: float = math.inf  # N

    def __call__(self, wanted: float, t: float, y: Mapping[str, float]) -> Any:
        return np.minimum(np.maximum(wanted, -self.force_max), self.force_max)


class SkyhookForce:
    """The damper as a dashpot between the floor at its rod end and a fixed point in space.

    Karnopp, Crosby and Harwood, J. Eng. Ind. 96 (1974) 619-626, doi 10.1115/1.3438373. The force wanted of the damper
    is fc = c_sky v, with v the floor's absolute velocity: the floor is held against space, not against the ground. It
    follows from the floor's accelerometer by a leaky integrator, v' = a - v / tau, which has no drift.

    floor: from 1; sign: -1 where the floor is at the damper's other end; damping: N s/m;
    leak: tau, s; period: s. velocity: of the last call, m/s."""

    def __init__(self, floor: int, sign: float, damping: float, leak: float, period: float) -> None:
        require_positive("skyhook", damping=damping, leak=leak, period=period)
        self.signal = f"acceleration_{floor}"
        self.gain = sign * damping
        self._decay = math.exp(-period / leak)
        # Exact for an acceleration that is linear between the samples.
        mean = leak * (1 - self._decay) / period
        self._first, self._last = leak * (mean - self._decay), leak * (1 - mean)
        self.reset()

    def reset(self) -> None:
        self.velocity = 0.0
        self._before: float | None = None

    def __call__(self, t: float, y: Mapping[str, float]) -> float:
        now = y[self.signal]
        if self._before is None:
            self.velocity = 0.0 * now  # of many runs as well
        else:
            self.velocity = self._decay * self.velocity + self._first * self._before + self._last * now
        self._before = now
        return self.gain * self.velocity


def skyhook(
    structure: ShearFrame | Linear,
    command_max: float,
    damping: float | None = None,
    leak: float | None = None,
    period: float = 1e-3,
) -> ForceController:
    """Skyhook control of what each damper's rod is at, by on/off switching; of a frame, the upper of its two floors.

    command_max: A or V. damping: N s/m, by default the structure's `Linear.dashpot`. leak: s, by default one period of
    the first mode. Raises InputError.
    """
    s = linear(structure)
    c, tau = s.dashpot if damping is None else damping, 2 * math.pi / s.first if leak is None else leak
    aims = [SkyhookForce(number, sign, c, tau, period) for number, sign in s.hooks]
    aim = aims[0] if len(aims) == 1 else Aims(aims)
    return ForceController(aim, for_each(lambda: OnOff(command_max), len(aims)), period, "skyhook")
