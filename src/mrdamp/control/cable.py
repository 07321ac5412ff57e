"""Controllers of a stay cable with one damper: those of a frame on the cable's natural modes.

Johnson, Baker, Spencer and Fujino, J. Eng. Mech. 133 (2007) 1-11, doi 10.1061/(ASCE)0733-9399(2007)133:1(1), with the
law of mrdamp.control.clipped_optimal. The states are the natural coordinates and their velocities,

    q'' + 2 zeta w q' + w^2 q = -phi_d f + load,        |q|^2 = m int v^2 dx,

and what is regulated is the RMS motion over the cable's length. The damper stands on the ground: a dashpot to a fixed
point in space (skyhook) is an ordinary one here, whose size matters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import ClassVar

import numpy as np

from mrdamp.control import registry
from mrdamp.control.clipped_optimal import Lqg
from mrdamp.control.lqg import Linear, Plant, outputs_of, plant_of
from mrdamp.model import Model
from mrdamp.structures import FloatArray
from mrdamp.structures.cables import StayCable

#: Places x / L at which the load that the filter expects is independent, as ambient noise is.
_LOAD_PLACES = np.linspace(0.0, 1.0, 11)
_ACCELERATION_NOISE = 0.05  # m/s2
_STROKE_NOISE = 2e-5  # m


_LEVEL = {"level": 1.0}  # of on/off switching, over the largest command
_OPTIMAL = {"r": 1e-9, "noise_ratio": 10.0}


@dataclass(frozen=True)
class CableSite(registry.AnySite):
    """Of a cable: the cable, the largest command (A or V), the places x / L where its motion is measured (as in
    `mrdamp.envs.cable.Cable`), the force at the largest command, N, the control period, s, and the damper's model.

    r: weight of the force squared, m2/N2, against the mean square motion. noise_ratio: intensity of each load's noise
    ((N/m)^2 s) over that of the measurements', in units of 0.05 m/s2 and 0.02 mm.
    """

    cable: StayCable
    command_max: float
    places: tuple[float, ...]
    force_max: float
    period: float = 5e-3
    damper: Model = None  # type: ignore[assignment]

    environment: ClassVar[str] = "mrdamp/Cable-v0"
    options: ClassVar[Mapping[str, Mapping[str, float]]] = registry.regulators(_OPTIMAL, _LEVEL)

    @cached_property
    def linear(self) -> Linear:
        """The dashpot of a skyhook is the best one for the first mode (Pacheco, Fujino and Sulekh 1993, doi
        10.1061/(ASCE)0733-9445(1993)119:6(1961)), from the first place's accelerometer."""
        c, places = self.cable, self.places
        names = (*(f"acceleration_{j}" for j in range(1, len(places) + 1)), "stroke")
        motion = {f"mode_{k}": 1.0 for k in range(1, len(c.natural) + 1)}
        noise = np.array([_ACCELERATION_NOISE] * len(places) + [_STROKE_NOISE])
        best = 0.1 * c.mass * c.length * c.first / c.damper_at
        rows = partial(cable_outputs, c, places)
        return Linear(cable_plant(c), rows, names, motion, c.first, ((1, 1.0),), best, noise)

    def lqg(self, options: Mapping[str, float]) -> Lqg:
        return Lqg(regulate=self.linear.regulated, r=options.get("r", 1e-9), noise_ratio=options["noise_ratio"])

    def ranges(self) -> Mapping[str, tuple[float, float]]:
        best, first, force = self.linear.dashpot, self.cable.first, self.force_max
        return {
            "r": (1e-11, 1e-6), "noise_ratio": (0.1, 1e4), "level": (0.1, 1.0), "force_max": (0.1 * force, 4.0 * force),
            "damping": (0.05 * best, 50.0 * best), "leak": (1.0 / first, 100.0 / first),
        }  # fmt: skip


def cable_plant(cable: StayCable) -> Plant:
    """First-order form in the natural coordinates; e (2N+2, 11) per N/m at `_LOAD_PLACES`."""
    load = cable.load_matrix(_LOAD_PLACES).T
    return replace(plant_of(cable.mechanics), e=np.vstack([np.zeros_like(load), load]))


def cable_outputs(cable: StayCable, places: Sequence[float], names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Of `outputs_of`, with places numbered from 1, and mode_k, the k-th coordinate over the root of the cable's mass,
    whose squares sum to the mean square of the motion over the length, m2."""
    numbered = {str(j): cable.at(place) for j, place in enumerate(places, 1)}
    modes = np.eye(len(cable.natural)) * (1 / math.sqrt(cable.mass * cable.length))
    return outputs_of(cable.mechanics, numbered, {f"mode_{k}": row for k, row in enumerate(modes, 1)}, names)
