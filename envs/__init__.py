"""Gymnasium environments around the damper plugin, registered on import.

| id | what |
|---|---|
| `mrdamp/Frame-v0` | a shear frame under ground motions (`FrameEnv`) |
| `mrdamp/Cable-v0` | a stay cable under wind (`CableEnv`) |
| `mrdamp/QuarterCar-v0` | a quarter car on a road (`CarEnv`) |
| `mrdamp/Structure-v0` | a structure of one's own (`StructureEnv`) |

`import mrdamp` registers the ids; `gymnasium.make("mrdamp:mrdamp/Frame-v0")` needs no import. The same structures for
a controller, without rewards and episodes: `FramePlant`, `CablePlant`, `CarPlant`. Vector environments:
`mrdamp.envs.vector`, and for stable-baselines3 `mrdamp.envs.sb3`.
"""

from __future__ import annotations

from mrdamp.control.observe import Observer
from mrdamp.envs.cable import Cable, CableEnv, CablePlant, CableReward, CableTask, cable_damper
from mrdamp.envs.car import Car, CarEnv, CarPlant, CarReward, CarTask, car_damper
from mrdamp.envs.frame import Frame, FrameEnv, FramePlant, FrameReward, FrameTask, default_damper
from mrdamp.envs.linear import Goal, LinearStructure
from mrdamp.envs.loads import (
    AmbientLoads,
    Bumps,
    CableLoad,
    IsoRoads,
    MixedMotions,
    RecordedMotions,
    RecordedRoads,
    SyntheticMotions,
    WindLoads,
)
from mrdamp.envs.plant_env import PlantEnv, StructureEnv
from mrdamp.envs.structure import Structure
from mrdamp.registration import ENVIRONMENTS, register
from mrdamp.structures.lumped import Mechanics

__all__ = [
    "ENVIRONMENTS",
    "AmbientLoads",
    "Bumps",
    "Cable",
    "CableEnv",
    "CableLoad",
    "CablePlant",
    "CableReward",
    "CableTask",
    "Car",
    "CarEnv",
    "CarPlant",
    "CarReward",
    "CarTask",
    "Frame",
    "FrameEnv",
    "FramePlant",
    "FrameReward",
    "FrameTask",
    "Goal",
    "IsoRoads",
    "LinearStructure",
    "Mechanics",
    "MixedMotions",
    "Observer",
    "PlantEnv",
    "RecordedMotions",
    "RecordedRoads",
    "Structure",
    "StructureEnv",
    "SyntheticMotions",
    "WindLoads",
    "cable_damper",
    "car_damper",
    "default_damper",
    "register",
]

register()
