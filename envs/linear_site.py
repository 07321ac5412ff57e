"""What controllers of a structure of one's own are made for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from mrdamp.control import registry
from mrdamp.control.clipped_optimal import Lqg
from mrdamp.control.plant import Linear, outputs_of, plant_of
from mrdamp.model import Model

if TYPE_CHECKING:
    from mrdamp.envs.linear import LinearStructure

_LQG = {"r": 1e-2, "noise_ratio": 100.0}
_LEVEL = {"level": 1.0}


@dataclass(frozen=True)
class LinearSite(registry.AnySite):
    """Of a structure given by matrices. The goals are regulated, each over its scale; r: weight of the force squared,
    over the largest; noise_ratio: of the load over its scale to the measurements over theirs."""

    structure: LinearStructure
    damper: Model
    command_max: float
    force_max: float
    period: float = 5e-3

    options: ClassVar[Mapping[str, Mapping[str, float]]] = registry.regulators(_LQG, _LEVEL)

    @property
    def environment(self) -> str:  # type: ignore[override]
        """The name in `file.py:NAME`, or of the class."""
        kind = type(self.structure)
        return str(kind.__dict__.get("spec", kind.__name__)).rpartition(":")[2]

    @cached_property
    def _scale(self) -> Mapping[str, float]:
        return self.structure.sensors(np.array([self.command_max]), False)[1]

    @cached_property
    def linear(self) -> Linear:
        whole, first = self.structure, self.structure.first
        linear, s = plant_of(whole.system), whole.system
        strong = whole.strong / max(float(np.abs(s.loaded).max()), 1e-12)
        rows = partial(outputs_of, s, dict(zip(whole.places, whole.at, strict=True)), {})
        measured = (*(f"acceleration_{place}" for place in whole.places), "stroke")
        goals = {f"{goal.of}_{goal.place}": goal.weight for goal in whole.goals.values()}
        regulated = {name: weight / self._scale[name] ** 2 for name, weight in goals.items()}
        hooks: Any = ((whole.rod, 1.0),) if whole.rod else ()
        deviation = np.array([self._scale[name] for name in measured])
        mass = float(s.mass.trace())
        plant, dashpot = replace(linear, e=strong * linear.e), first * mass
        return Linear(plant, rows, measured, regulated, first, hooks, dashpot, deviation)

    def lqg(self, options: Mapping[str, float]) -> Lqg:
        weight = options.get("r", 1.0) / self.force_max**2
        return Lqg(regulate=self.linear.regulated, r=weight, noise_ratio=options["noise_ratio"])

    def ranges(self) -> Mapping[str, tuple[float, float]]:
        dashpot, first, force = self.linear.dashpot, self.linear.first, self.force_max
        return {
            "r": (1e-4, 10.0), "noise_ratio": (1.0, 1e5), "level": (0.1, 1.0), "force_max": (0.05 * force, 2.0 * force),
            "damping": (0.1 * dashpot, 50.0 * dashpot), "leak": (1.0 / first, 100.0 / first),
        }  # fmt: skip
