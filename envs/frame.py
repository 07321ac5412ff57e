"""`mrdamp/Frame-v0`: a shear frame under ground motions, with MR dampers whose current is the action."""

from __future__ import annotations

from mrdamp.envs.frame_task import Frame
from mrdamp.envs.plant_env import PlantEnv


class FrameEnv(PlantEnv):
    """
    ## Description

    A shear frame of N storeys on a shake table. Magnetorheological dampers between its floors dissipate energy. The
    action is the current of their coils, which their drivers follow with a lag. The default is the three-storey model
    frame of Dyke, Spencer, Sain and Carlson (Smart Materials and Structures 5 (1996) 565-575, doi
    10.1088/0964-1726/5/5/006) with its 3 kN damper between the ground and floor 1, at 0 to 2.25 V. The damper is the
    MuJoCo plugin `mrdamp.damper`. The aim is small drift and small floor acceleration with little current.

    The physics is that of `models_xml/frame3/model.xml`, with the given storeys, dampers and sensors.

    ## Action Space

    `Box(-1, 1, (m,), float32)`, one number for each of m dampers. Action 0 is half of the largest current.

    | Num | Action | Control Min | Control Max | Name (in the XML file) | Transmission | Unit |
    |-----|--------|-------------|-------------|------------------------|--------------|------|
    | 0 | commanded current, -1 -> 0 and 1 -> the largest | 0 | `command_max` | damper | joint or tendon | A or V |
    | 1 ... | those of further dampers | 0 | `command_max` | damper_2 ... | joint or tendon | A or V |

    ## Observation Space

    `Box(-20, 20, (history (s + m),), float32)`: sensor readings, each divided by its scale
    (`env.unwrapped.task.observer` has both). With the defaults, three storeys and one damper there are 6:

    | Num | Observation | Min | Max | Name (in the XML file) | Joint | Unit before scaling |
    |-----|-------------|-----|-----|------------------------|-------|------|
    | 0 | absolute acceleration of floor 1 | -20 | 20 | acceleration_1 | storey1 | m/s2 |
    | 1 | absolute acceleration of floor 2 | -20 | 20 | acceleration_2 | storey2 | m/s2 |
    | 2 | absolute acceleration of floor 3 | -20 | 20 | acceleration_3 | storey3 | m/s2 |
    | 3 | stroke of the damper | -20 | 20 | stroke | storey1 | m |
    | 4 | force of the damper, by its own sensor | -20 | 20 | force | storey1 | N |
    | 5 | command held in the period that ended | 0 | 1 | damper | storey1 | A or V |

    The scales are those of a strong motion; under the default motions the RMS is .1 to .3, with `normalise=True` about
    1. `history=h` stacks the last h control periods, the newest first. Other `signals` to choose from:
    `displacement_j`, `velocity_j` (floor to ground, m and m/s), `drift_j` (m), `stroke_velocity` (m/s), `current`
    (A or V), `true_force` (N, an ideal load cell); those of a second damper end in `_2`. `full_state=True` gives
    all displacements, velocities and currents. Sensors have the effects of the model (`sensor_gain`,
    `sensor_lag`, ...), and white `noise`. The default observation contains only what sensors can measure, without the
    ground's motion.

    ## Rewards

    The sum of the parts of `mrdamp.envs.reward.FrameReward`. Each is in `info` as `reward_drift`,
    `reward_acceleration`, `reward_drift_peak`, `reward_acceleration_peak`, `reward_current`, `reward_power`,
    `reward_energy`. Drift and acceleration are relative to their peaks in the same motion without dampers: by default
    an episode's return is -50 (J1 + J2), -100 without dampers, and the current is free.

    `info` also has, since the episode's start: `peak_drift` (m), `peak_acceleration` (m/s2), both over all steps of
    the engine; `drift_ratio` and `acceleration_ratio`, the same over the reference run (J1 and J2 of the benchmark
    problems); `mean_current` (A or V), `mean_power` (over that at the largest current), `dissipated_energy` (J).
    The `info` of `reset`: `motion`, `pga` (m/s2), `duration` (s), `speed` (times that of the record), `reference_drift`
    (m), `reference_acceleration` (m/s2).

    ## Starting State

    At rest, no current in the coil, at the start of a ground motion drawn from `motions`, or given:
    `reset(options={"motion": GroundMotion or file, "amplitude": factor, "compression": factor})`. A file is played five
    times as fast as it was recorded, as for the model frame of Dyke et al., a `GroundMotion` as it is, unless there is
    a `compression`: the rule of `RecordedMotions` too.

    ## Episode End

    Truncated at the end of the motion, behind the control period of its last sample, or after `duration`. Never
    terminated: a simulation that diverges is an error.

    ## Arguments

    In addition to those of every environment (`PlantEnv`):

    | Parameter | Type | Default | Description |
    |-----------|------|---------|-------------|
    | `model` | `Model`, path, one for each damper | Dyke's 3 kN damper | any identified one: law, NARX, effects |
    | `structure` | `ShearFrame` | the model's own, or Dyke's | N storeys |
    | `damper_between` | pair or pairs of floors | the structure's | (0, 1) is ground to floor 1 |
    | `motions` | `MotionSource` | `SyntheticMotions()` | Kanai-Tajimi, Clough-Penzien, files, mixtures, amplitudes |
    | `reward` | `FrameReward`, mapping | `FrameReward()` | weights of the parts, exponent, reference |
    | `timestep` | s | 0.0005 | the largest of the engine |
    | `duration` | s | the motion's | cuts long motions |
    | `camera` | str | corner | `front`, `corner`, `damper` |

    ## Version History

    * v0: first version
    """

    kind = Frame
