"""A building on rubber bearings with an MR damper beside them, in an earthquake: a structure that mrdamp does not know.

    mrdamp compare examples/08_structure_of_your_own.py:Isolated --controllers passive-off passive-on clipped-optimal
    mrdamp train examples/08_structure_of_your_own.py:Isolated --timesteps 200000 -o out/isolated
    mrdamp view examples/08_structure_of_your_own.py:Isolated

Coordinates are the displacements of base and three floors to the ground. Masses, stiffnesses and the bearings are those
of no real building: a scale model of 2.2 Hz on its bearings, 6.8 Hz without.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from mrdamp.envs import Goal, LinearStructure, Mechanics, StructureEnv, SyntheticMotions, default_damper
from mrdamp.model import Model

BASE, FLOOR = 150.0, 100.0  # kg
BEARINGS, STOREY = 9e4, 9e5  # N/m
BEARING_DAMPING, STOREY_DAMPING = 250.0, 300.0  # N s/m


@dataclass(frozen=True)
class Isolated(LinearStructure):
    """The bearings and three storeys in a chain; the damper stands between ground and base."""

    name = "isolated"
    places: ClassVar[Mapping[str, Sequence[float]]] = {"base": (1, 0, 0, 0), "top": (0, 0, 0, 1)}
    #: Isolation trades the two: a strong damper saves the bearings and shakes the building.
    goals: ClassVar[Mapping[str, Goal]] = {
        "shaking": Goal("top", "acceleration", "rms", 0.5),
        "bearings": Goal("base", "displacement", "peak", 0.5),
    }
    strong, rod = 2.0, "base"

    def mechanics(self) -> Mechanics:
        mass = np.diag([BASE, FLOOR, FLOOR, FLOOR])
        drift = np.eye(4) - np.eye(4, k=-1)  # of each storey per displacement
        stiffness = drift.T @ np.diag([BEARINGS, STOREY, STOREY, STOREY]) @ drift
        damping = drift.T @ np.diag([BEARING_DAMPING, STOREY_DAMPING, STOREY_DAMPING, STOREY_DAMPING]) @ drift
        ground = -mass @ np.ones((4, 1))
        return Mechanics(mass, damping, stiffness, stroke=np.eye(4)[0], load=ground, absolute=True)

    def damper(self) -> Model:
        return default_damper()

    def loads(self) -> SyntheticMotions:
        return SyntheticMotions(duration=15.0)


if __name__ == "__main__":
    env: Any = StructureEnv(Isolated, engine="chain")
    for share in (-1.0, 0.0, 1.0):
        env.reset(seed=3)
        over = False
        while not over:
            _, _, _, over, info = env.step(np.array([share], np.float32))
        ratios = ", ".join(f"{name} {info[f'{name}_ratio']:.2f}" for name in Isolated.goals)
        print(f"command at {50 * (share + 1):.0f} %: {ratios} of those without a damper")
