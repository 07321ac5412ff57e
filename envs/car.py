"""`mrdamp/QuarterCar-v0`: a quarter car on a road, with an MR damper whose current is the action."""

from __future__ import annotations

from mrdamp.envs.car_task import Car
from mrdamp.envs.plant_env import PlantEnv


class CarEnv(PlantEnv):
    """
    ## Description

    A quarter car on a road: a wheel on its tyre, and a body on the suspension's spring, with a magnetorheological
    damper in parallel. The action is the current of the damper's coil, which its driver follows with a lag. The aim is
    small body acceleration as people perceive it (ISO 2631-1), a tyre load near its static value, and little current.
    The tyre transmits no tension: the wheel lifts off if its load would fall below zero. The damper is the MuJoCo
    plugin `mrdamp.damper`, by default the Lord RD-1005 (2 kN, 0 to 2 V) of Lai and Liao (Journal of Vibration and
    Control 8 (2002) 527-547, doi 10.1177/107754602023712). The car's masses and stiffnesses are those of doi
    10.1155/2021/8084343 (`mrdamp.structures.cars.QuarterCar`).

    The physics is that of `models_xml/quarter_car/model.xml`.

    ## Action Space

    `Box(-1, 1, (1,), float32)`. Action 0 is half of the largest current.

    | Num | Action | Control Min | Control Max | Name (in the XML file) | Joint | Unit |
    |-----|--------|-------------|-------------|------------------------|-------|------|
    | 0 | commanded current, -1 -> 0 and 1 -> the largest | 0 | `command_max` | damper | suspension | A or V |

    ## Observation Space

    `Box(-20, 20, (history (s + 1),), float32)`: sensor readings, each divided by its scale
    (`env.unwrapped.task.observer` has both). With the defaults there are 5:

    | Num | Observation | Min | Max | Name (in the XML file) | Joint | Unit before scaling |
    |-----|-------------|-----|-----|------------------------|-------|------|
    | 0 | vertical acceleration of the body | -20 | 20 | acceleration_2 | suspension | m/s2 |
    | 1 | vertical acceleration of the wheel | -20 | 20 | acceleration_1 | tyre | m/s2 |
    | 2 | stroke of the damper | -20 | 20 | stroke | suspension | m |
    | 3 | force of the damper, by its own sensor | -20 | 20 | force | suspension | N |
    | 4 | command held in the period that ended | 0 | 1 | damper | suspension | A or V |

    `history=h` stacks the last h control periods, the newest first. Other `signals`: `displacement_j`,
    `velocity_j` (of wheel, 1, and body, 2, to the road), `drift_1` (deflection of the tyre, m), `drift_2`,
    `stroke_velocity`, `current`, `true_force`. `full_state=True` adds the stroke's velocity, the
    tyre's deflection and the current. White `noise` by name.

    ## Rewards

    The sum of the parts of `mrdamp.envs.car_reward.CarReward`. Each is in `info` as `reward_comfort`,
    `reward_holding`, `reward_stroke`, `reward_airborne`, `reward_current`, `reward_power`. Comfort is the body's
    acceleration weighted by Wk of ISO 2631-1, holding the dynamic load on the tyre. Both are relative to their RMS on
    the same road with a linear suspension (a dashpot of .3 of critical), whose return is -100: by default the return is
    -50 times the sum of the squares of both ratios, and the current is free.

    `info` also has, since the episode's start: `weighted_acceleration` (RMS, m/s2), `rms_load` (of the dynamic tyre
    load, over the weight), `rms_stroke`, `peak_stroke` (m), `comfort_ratio`, `load_ratio`, `stroke_ratio` (over the
    linear suspension's), `airborne` (share of the time without contact), `mean_current` (A or V), `mean_power` (over
    that at the largest current), `dissipated_energy` (J). The `info` of `reset`: `road`, `speed` (m/s), `duration` (s),
    `reference_acceleration` (m/s2), `reference_load`, `reference_stroke` (m).

    ## Starting State

    At rest, no current in the coil, at the start of a road drawn from `roads`, or given:
    `reset(options={"road": Road or file, "speed": m/s, "amplitude": factor})`.

    ## Episode End

    Truncated at the end of the road, behind the control period of its last sample. Never terminated: a simulation that
    diverges is an error.

    ## Arguments

    In addition to those of every environment (`PlantEnv`):

    | Parameter | Type | Default | Description |
    |-----------|------|---------|-------------|
    | `car` | `QuarterCar`, mapping | doi 10.1155/2021/8084343 | masses, stiffnesses, damping |
    | `model` | `Model`, path | the RD-1005 | any identified one: law, NARX, effects |
    | `roads` | `RoadSource` | `IsoRoads()` | classes of ISO 8608 by speed, `Bumps`, `RecordedRoads`, your own |
    | `reward` | `CarReward`, mapping | `CarReward()` | weights of the parts, exponent |
    | `timestep` | s | 0.0005, chain: 0.001 | the largest of the engine, 0.002 at most |
    | `camera` | str | corner | `front`, `corner`, `damper` |

    ## Version History

    * v0: first version
    """

    kind = Car
