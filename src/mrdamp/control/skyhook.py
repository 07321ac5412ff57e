"""Skyhook control: the damper as a dashpot between the floor at its rod end and a fixed point in space.

Karnopp, Crosby and Harwood, J. Eng. Ind. 96 (1974) 619-626, doi 10.1115/1.3438373. The force wanted of the damper
is fc = c_sky v, with v the floor's absolute velocity: the floor is held against space, not against the ground. It
follows from the floor's accelerometer by a leaky integrator, v' = a - v / tau, which has no drift.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from mrdamp.control.force_control import Aims, Follower, ForceController, OnOff, for_each
from mrdamp.control.plant import Linear, linear
from mrdamp.errors import require_positive
from mrdamp.structures import ShearFrame


class SkyhookForce:
    """The aim above. floor: from 1; sign: -1 where the floor is at the damper's other end; damping: N s/m;
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
    follower: Follower | None = None,
    name: str = "skyhook",
) -> ForceController:
    """Skyhook control of what each damper's rod is at; of a frame, the upper of the damper's two floors.

    command_max: A or V. damping: N s/m, by default the structure's `Linear.dashpot`. leak: s, by default one period of
    the first mode. follower: of the wanted force, on/off switching by default. Raises InputError.
    """
    s = linear(structure)
    c, tau = s.dashpot if damping is None else damping, 2 * math.pi / s.first if leak is None else leak
    aims = [SkyhookForce(number, sign, c, tau, period) for number, sign in s.hooks]
    aim = aims[0] if len(aims) == 1 else Aims(aims)
    return ForceController(aim, follower or for_each(lambda: OnOff(command_max), len(aims)), period, name)
