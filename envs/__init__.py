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
from mrdamp.envs.cable import CableEnv
from mrdamp.envs.cable_loads import AmbientLoads, CableLoad, WindLoads
from mrdamp.envs.cable_reward import CableReward
from mrdamp.envs.cable_task import Cable, CableTask, cable_damper
from mrdamp.envs.car import CarEnv
from mrdamp.envs.car_reward import CarReward
from mrdamp.envs.car_roads import Bumps, IsoRoads, RecordedRoads
from mrdamp.envs.car_task import Car, CarTask, car_damper
from mrdamp.envs.frame import FrameEnv
from mrdamp.envs.frame_task import Frame, FrameTask, default_damper
from mrdamp.envs.linear import Goal, LinearStructure
from mrdamp.envs.loads import MixedMotions, RecordedMotions, SyntheticMotions
from mrdamp.envs.plant import CablePlant, CarPlant, FramePlant, Plant
from mrdamp.envs.plant_env import PlantEnv, StructureEnv
from mrdamp.envs.reward import FrameReward
from mrdamp.envs.structure import Structure
from mrdamp.registration import ENVIRONMENTS, register
from mrdamp.structures.mechanics import Mechanics

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
    "Plant",
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
