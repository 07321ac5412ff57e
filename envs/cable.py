"""`mrdamp/Cable-v0`: a stay cable under wind, with an MR damper near its anchorage whose current is the action."""

from __future__ import annotations

from mrdamp.envs.cable_task import Cable
from mrdamp.envs.plant_env import PlantEnv


class CableEnv(PlantEnv):
    """
    ## Description

    A stay cable vibrates transversely under wind or ambient loads. A magnetorheological damper close to its
    anchorage dissipates energy; the action is the current of its coil. The default is a laboratory cable of 12.65 m
    with 2172 N and 0.747 kg/m (2.13 Hz). Its damper at 2 % of the length is a small shear-mode one of up to 21 N at
    4 V (Zapateiro, Luo, Taylor, Dyke, Smart Structures and Systems 6 (2010) 101-113). A dashpot at this place gives
    a modal damping ratio of at most about half of x_d / L. Semi-active control can do better (Johnson, Christenson,
    Spencer, Comput.-Aided Civ. Infrastruct. Eng. 18 (2003) 132-146, doi 10.1111/1467-8667.00305). The aim is small
    motion with little current.

    The state is in natural coordinates of the first sines and the static shape under the damper's force
    (`mrdamp.structures.cables.StayCable`). Each is a slide joint in MuJoCo (`mrdamp.envs.linear_xml.linear_xml`); the
    damper is the plugin `mrdamp.damper` on a tendon over all of them. The slide chain with sag of `models_xml/cable`
    is the reference in the tests and the model that is rendered.

    ## Action Space

    `Box(-1, 1, (1,), float32)`. Action 0 is half of the largest current.

    | Num | Action | Control Min | Control Max | Name (in the XML file) | Transmission | Unit |
    |-----|--------|-------------|-------------|------------------------|--------------|------|
    | 0 | commanded current, -1 -> 0 and 1 -> the largest | 0 | `command_max` | damper | tendon `stroke` | A or V |

    Below its least command, .6 V of 4 V (actions up to -.7), the default damper does as at .6 V: a dead zone.

    ## Observation Space

    `Box(-20, 20, (history (s + 1),), float32)`: sensor readings, each divided by its scale
    (`env.unwrapped.task.observer` has both). With the defaults there are 5:

    | Num | Observation | Min | Max | Name (in the XML file) | Place | Unit before scaling |
    |-----|-------------|-----|-----|------------------------|-------|------|
    | 0 | acceleration across the chord | -20 | 20 | of the modes | at the damper | m/s2 |
    | 1 | acceleration across the chord | -20 | 20 | of the modes | five times as far from the anchorage | m/s2 |
    | 2 | stroke of the damper | -20 | 20 | stroke | at the damper | m |
    | 3 | force of the damper, by its own sensor | -20 | 20 | force | at the damper | N |
    | 4 | command held in the period that ended | 0 | 1 | damper | | A or V |

    The accelerometers are ideal by default, and what they read hangs on the number of modes
    (docs/reference/environments.md). `signals=["acceleration_2", "stroke", "stroke_velocity", "force"], bandwidth=62.5`
    does not.
    `measured_at` sets the places. `history=h` stacks the last h control periods, the newest first.
    Other `signals`: `displacement_j`, `velocity_j` at place j, `stroke_velocity`, `current`, `true_force`.
    `full_state=True` gives displacements and velocities at as many places as there are sines, and the current.
    White `noise` by name.

    ## Rewards

    The sum of the parts of `mrdamp.envs.cable_reward.CableReward`. Each is in `info` as `reward_motion`,
    `reward_acceleration`, `reward_current`, `reward_power`, `reward_energy`. Motion is relative to its RMS under
    the same load without the damper: by default an episode's return is -100 times the square of that ratio, and the
    current is free. `info` also has, since the episode's start: `rms_motion` (m, over time and
    length), `motion_ratio` (the same over the run without the damper), `mean_current` (A or V), `mean_power` (over
    that at the largest current), `dissipated_energy` (J). The `info` of `reset`: `load`, `load_rms` (N/m),
    `duration` (s), `reference_motion` (m).

    ## Starting State

    At rest, no current in the coil, at the start of a load drawn from `loads`, or given:
    `reset(options={"load": CableLoad, "amplitude": factor})`.

    ## Episode End

    Truncated at the end of the load, behind the control period of its last sample. Never terminated: a simulation that
    diverges is an error.

    ## Arguments

    In addition to those of every environment (`PlantEnv`):

    | Parameter | Type | Default | Description |
    |-----------|------|---------|-------------|
    | `cable` | `StayCable` | the laboratory cable | length, tension, mass, place of the damper, damping, sag |
    | `model` | `Model`, path | Zapateiro's 20 N damper | any identified one: law, NARX, effects |
    | `measured_at` | places x / L | the damper's and five times it | where motion is measured |
    | `bandwidth` | Hz | None: ideal | of the accelerometers |
    | `loads` | `LoadSource` | `WindLoads()` | `WindLoads`, `AmbientLoads`, or one of your own |
    | `reward` | `CableReward`, mapping | `CableReward()` | weights of the parts, exponent |
    | `timestep` | s | 0.000125 | the largest of the engine |
    | `camera` | str | front | `front`, `along`, `damper` |

    At the default step every signal is within 2 % of that of a tenth of it under commands that switch
    (docs/convergence.md).

    ## Version History

    * v0: first version
    """

    kind = Cable
