"""`mrdamp/Structure-v0`: a structure of one's own (`mrdamp.envs.linear.LinearStructure`)."""

from __future__ import annotations

from typing import Any

from mrdamp.envs.linear import LinearStructure, own_kind
from mrdamp.envs.plant_env import PlantEnv
from mrdamp.envs.vector import KindVectorEnv


class StructureEnv(PlantEnv):
    """A structure of one's own under loads of its source.

    structure: its class, or `file.py:NAME`. Other arguments: the fields of the class; `motions` (or its `source`),
    where loads come from; reward: weights by goal; and those of every environment (`PlantEnv`). Observations, `info`
    and options of `reset` are named as in the class: `acceleration_PLACE`, `GOAL_ratio`, `option`.
    """

    def __init__(self, structure: str | type[LinearStructure], **arguments: Any) -> None:
        self.kind = own_kind(structure)  # type: ignore[misc]
        super().__init__(**arguments)


class StructureVectorEnv(KindVectorEnv):
    """num_envs of them at once; arguments as in `StructureEnv`, threads: of the engine."""

    def __init__(self, num_envs: int = 1, *, structure: str | type[LinearStructure], **arguments: Any) -> None:
        self.kind = own_kind(structure)  # type: ignore[misc]
        super().__init__(num_envs, **arguments)
