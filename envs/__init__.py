"""Gymnasium environments around the damper plugin, registered on import.

| id | what |
|---|---|
| `mrdamp/Frame-v0` | a shear frame under ground motions (`FrameEnv`) |
| `mrdamp/Cable-v0` | a stay cable under wind (`CableEnv`) |

`gymnasium.make("mrdamp.envs:mrdamp/Frame-v0")` imports this module by itself. The same structures for a controller,
without rewards and episodes: `FramePlant`, `CablePlant`. Vector environments: `mrdamp.envs.vector`, and for
stable-baselines3 `mrdamp.envs.sb3`.
"""

from __future__ import annotations

import gymnasium

from mrdamp.control.observe import Observer
from mrdamp.envs.cable import CableEnv
from mrdamp.envs.cable_loads import AmbientLoads, CableLoad, WindLoads
from mrdamp.envs.cable_reward import CableReward
from mrdamp.envs.cable_task import CablePlant, CableTask, cable_damper
from mrdamp.envs.frame import FrameEnv
from mrdamp.envs.frame_task import FrameTask
from mrdamp.envs.loads import MixedMotions, RecordedMotions, SyntheticMotions
from mrdamp.envs.plant import FramePlant, Plant, default_damper
from mrdamp.envs.reward import FrameReward

__all__ = [
    "AmbientLoads",
    "CableEnv",
    "CableLoad",
    "CablePlant",
    "CableReward",
    "CableTask",
    "FrameEnv",
    "FramePlant",
    "FrameReward",
    "FrameTask",
    "MixedMotions",
    "Observer",
    "Plant",
    "RecordedMotions",
    "SyntheticMotions",
    "WindLoads",
    "cable_damper",
    "default_damper",
]

#: id -> class of the environment, class of the vector environment.
ENVIRONMENTS = {
    "mrdamp/Frame-v0": ("mrdamp.envs.frame:FrameEnv", "mrdamp.envs.vector:FrameVectorEnv"),
    "mrdamp/Cable-v0": ("mrdamp.envs.cable:CableEnv", "mrdamp.envs.vector:CableVectorEnv"),
}


def register() -> None:
    """Makes the environments known to `gymnasium.make`; safe to call again."""
    for name, (single, vector) in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point=single, vector_entry_point=vector)


register()
