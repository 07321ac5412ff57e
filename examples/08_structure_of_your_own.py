"""A building on rubber bearings with an MR damper beside them: a structure that mrdamp does not know.

    python examples/08_structure_of_your_own.py
    mrdamp compare examples/08_structure_of_your_own.py:Isolated --tune -o out/isolated
    mrdamp train examples/08_structure_of_your_own.py:Isolated -o out/policy

Coordinates: displacements of base and three floors to the ground. Sizes: of a scale model, 2.2 Hz on its bearings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from mrdamp.envs import Goal, LinearStructure, Mechanics, StructureEnv, SyntheticMotions, default_damper


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
    strong, rod = 2.0, "base"  # m/s2

    def mechanics(self) -> Mechanics:
        mass = np.diag([150.0, 100.0, 100.0, 100.0])
        drift = np.eye(4) - np.eye(4, k=-1)  # of bearings and storeys per displacement
        stiffness = drift.T @ np.diag([9e4, 9e5, 9e5, 9e5]) @ drift
        damping = drift.T @ np.diag([250.0, 300.0, 300.0, 300.0]) @ drift
        return Mechanics(mass, damping, stiffness, np.eye(4)[0], -mass @ np.ones((4, 1)), absolute=True)

    def damper(self) -> Any:
        return default_damper()

    def loads(self) -> SyntheticMotions:
        return SyntheticMotions(duration=15.0)


def main(shares: Sequence[float] = (0.0, 0.5, 1.0)) -> dict[float, dict[str, float]]:
    """Over the building without a damper, under one earthquake: goals by command over the largest."""
    env, found = StructureEnv(Isolated, engine="chain"), {}
    for share in shares:
        env.reset(seed=3)
        step: Any = None
        while step is None or not step[3]:
            step = env.step(np.array([2 * share - 1], np.float32))
        found[share] = {name: step[4][f"{name}_ratio"] for name in Isolated.goals}
        print(f"command at {100 * share:.0f} %:", ", ".join(f"{name} {x:.2f}" for name, x in found[share].items()))
    return found


if __name__ == "__main__":
    main()
