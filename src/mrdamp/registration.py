"""The ids of the Gymnasium environments. Gymnasium has no plugin entry point, so importing `mrdamp` registers them.

`gymnasium.make("mrdamp:mrdamp/Frame-v0")` imports it, in a spawned worker as well.
"""

from __future__ import annotations

import gymnasium

#: id -> class of the environment, class of the vector environment. Gymnasium imports them when one is made.
ENVIRONMENTS = {
    "mrdamp/Frame-v0": ("mrdamp.envs.frame:FrameEnv", "mrdamp.envs.vector:FrameVectorEnv"),
    "mrdamp/Cable-v0": ("mrdamp.envs.cable:CableEnv", "mrdamp.envs.vector:CableVectorEnv"),
    "mrdamp/QuarterCar-v0": ("mrdamp.envs.car:CarEnv", "mrdamp.envs.vector:CarVectorEnv"),
    "mrdamp/Structure-v0": ("mrdamp.envs.plant_env:StructureEnv", "mrdamp.envs.vector:StructureVectorEnv"),
}


def register() -> None:
    """Makes the environments known to `gymnasium.make`; safe to call again."""
    for name, (single, vector) in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point=single, vector_entry_point=vector)
