"""One structure: as a plant for any controller, without rewards and episodes, and as a Gymnasium environment."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from mrdamp.control.observe import Observation
from mrdamp.envs.linear import LinearStructure, own_kind
from mrdamp.envs.options import RowOptions
from mrdamp.envs.structure import Structure
from mrdamp.envs.task import Episode, Task, divided
from mrdamp.envs.view import Image, View, has_display
from mrdamp.errors import InputError, require_one_of, require_positive
from mrdamp.simulation.rows import finite


class RowPlant:
    """A structure as the plant of a controller. options: of `RowOptions`. Raises InputError.

    Measurements are named as in `mrdamp.control.base`. Attributes: structure; rows, one of it; period, s; commands_max,
    (m,) of all dampers, and command_max, of the first, A or V; of_period, result of `EngineRows.advance_one` for the
    last control period.
    """

    of_period: Sequence[float]

    def __init__(self, structure: Structure, **options: Any) -> None:
        self.structure = structure
        self.rows = rows = RowOptions(**options).rows(structure)
        self.period: float = rows.period
        self.commands_max = rows.command_max
        self.command_max = float(rows.command_max[0])

    @property
    def time(self) -> float:
        """Of the last measurements, s."""
        return float(self.rows.plants.step[0] // self.rows.plants.inner) * self.period

    @property
    def finished(self) -> bool:
        """True if the load is over; a plant may be stepped without one."""
        return bool(self.rows.plants.step[0] >= self.rows.steps[0] * self.rows.plants.inner)

    def reset(self, load: Any) -> Mapping[str, float]:
        """At rest under a load; the measurements at time 0."""
        self.rows.start(0, load)
        return dict(zip(self.rows.names, self.rows.measure([0])[0].tolist(), strict=True))

    def step(self, command: float | Sequence[float]) -> Mapping[str, float]:
        """One control period with the command (or one a damper) held; the measurements at its end."""
        each = command if np.ndim(command) else [command] * len(self.commands_max)
        self.of_period, values = self.rows.advance_one(finite("command", each, (1, len(self.commands_max))))
        return dict(zip(self.rows.names, values, strict=True))


class KindPlant(RowPlant):
    """The same from arguments of the environment: the fields of the kind's structure, in their order or by name."""

    kind: ClassVar[type[Structure]]

    def __init__(self, *given: Any, **arguments: Any) -> None:
        names = [f.name for f in fields(self.kind)]  # type: ignore[arg-type]
        own = {name: arguments.pop(name) for name in names if name in arguments}
        super().__init__(self.kind(*given, **own), **arguments)


@dataclass(frozen=True)
class EnvState:
    """State of an environment, for `set_state`."""

    episode: Episode
    generator: dict[str, Any]
    of: str


class PlantEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """
    ## Description

    A structure under control: what `FrameEnv`, `CableEnv`, `CarEnv` and `StructureEnv` have in common.

    ## Action Space

    `Box(-1, 1, (m,), float32)`, one number for each of m dampers: the commanded current (A or V), none at -1, half of
    the largest at 0 and `command_max` at 1. In the XML file the actuators are `damper`, `damper_2` ...

    ## Observation Space

    `Box(-1000, 1000, (history (s + m),), float32)`: readings of s sensors, each divided by its scale
    (`env.unwrapped.task.observer` has both), and the commands held in the period that ended, 0 to 1.

    ## Starting State

    At rest, no current in the coil, at the start of a load drawn from its source, or given in the options of `reset`,
    which may have an `amplitude`, a factor on the load.

    ## Episode End

    Truncated at the end of the load, behind the control period of its last sample. Never terminated: a simulation that
    diverges is an error.

    ## Arguments

    In addition to those of each environment:

    | Parameter | Type | Default | Description |
    |-----------|------|---------|-------------|
    | `signals`, `history`, `action_in_observation` | | the environment's, 1, True | what the observation holds |
    | `memory` | numbers | none | time constants, in control periods, of leaky averages of the signals, after them |
    | `peaks` | name: number | none | time constants, in control periods, of leaky peaks of signals, last of all |
    | `observer` | `Observer`, mapping | from those | takes their place |
    | `full_state` | bool | False | observes the state, see the environment |
    | `normalise` | bool | False | signals over their typical RMS, which then is about 1 |
    | `noise` | mapping | none | standard deviation by measurement, SI: `{"acceleration": 0.05, "force": 5.0}` |
    | `randomise` | name: (low, high) | none | drawn for each episode, see `mrdamp.envs.randomise.Randomise` |
    | `period` | s | 0.005 | of control; the load goes on within it |
    | `engine` | str | mujoco | `mujoco`, or `chain`: the C++ chain without it, many rows at little cost |
    | `timestep` | s | the engine's, see the environment | the largest of the engine |
    | `command_max` | A or V | the model's | the largest command |
    | `threads` | int | 1 | that share the rows |
    | `render_mode` | str | None | `human`, `rgb_array` |
    | `camera`, `size` | str, (width, height) | see the environment, (640, 480) | where from, and pixels |
    | `exaggeration` | float | by the motion | of the motion as drawn; the damper turns orange with the current |

    Several environments at once: `gymnasium.make_vec(id, num_envs=64, engine="chain")` (`mrdamp.envs.vector`), or
    `mrdamp.envs.sb3.PlantVecEnv(task)` with a task of 64 rows, such as `FrameTask(64, engine="chain")`. On the chain
    observations and rewards are MuJoCo's where both take short steps (`tests/test_env_chain.py`), and `noise` has
    its own random numbers. `get_state` and `set_state` save and restore the state exactly. Bad arguments raise
    `InputError`.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 200}  # noqa: RUF012
    kind: ClassVar[type[Structure]]

    def __init__(
        self,
        *,
        render_mode: str | None = None,
        camera: str | None = None,
        size: tuple[int, int] = (640, 480),
        exaggeration: float | None = None,
        **arguments: Any,
    ) -> None:
        if render_mode is not None:
            require_one_of("", self.metadata["render_modes"], render_mode=render_mode)
        if render_mode == "human" and not has_display():
            raise InputError("render_mode human needs a display; rgb_array with MUJOCO_GL=egl needs none")
        camera = self.kind.cameras[0] if camera is None else camera
        require_one_of("", self.kind.cameras, camera=camera)
        if exaggeration is not None:
            require_positive("drawing", exaggeration=exaggeration)
        if not (isinstance(size, tuple | list) and len(size) == 2 and all(isinstance(k, int) and k > 0 for k in size)):
            raise InputError(f"size is {size!r}; allowed: width and height in pixels")
        structure, others = divided(self.kind, arguments)
        self.task: Any = Task(structure, 1, **others)
        task = self.task
        self.render_mode, self.exaggeration = render_mode, exaggeration
        self.observation_space, self.action_space = task.observation_space, task.action_space
        modes = [mode for mode in self.metadata["render_modes"] if mode != "human" or has_display()]
        self.metadata = {"render_modes": modes, "render_fps": round(1 / task.rows.period)}
        self._drawing = camera, size
        self._view: View | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """At rest, under a load that is drawn or given in the options."""
        super().reset(seed=seed)
        observation, infos = self.task.reset([0], [self.np_random], options)
        if self.render_mode == "human":
            self.render()
        return observation[0], infos[0]

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """One control period. Raises Gymnasium's `ResetNeeded` before the first `reset`, and after an episode's end."""
        self.task.require_begun()
        observation, reward, over, info = self.task.step_one(action)
        if self.render_mode == "human":
            self.render()
        return observation, reward, False, over, info

    def render(self) -> Image | None:
        """(height, width, 3) in mode `rgb_array`; a window in mode `human`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() does nothing: the environment was made without a render_mode")
            return None
        if self._view is None:
            self._view = self.task.structure.view(self.task, *self._drawing)
        task = self.task
        larger = self.exaggeration or task.structure.drawn_size / task.structure.reference_motion(task.score.values[0])
        currents = [k for k, name in enumerate(task.rows.names) if re.fullmatch(r"current(_\d+)?", name)]
        self._view.update(task.rows.position(0), larger, (task.measured[0, currents] / task.command_max).tolist())
        if self.render_mode == "rgb_array":
            return self._view.image()
        self._view.show(self.task.rows.period)
        return None

    def close(self) -> None:
        """Frees the drawing; safe to call again."""
        if self._view is not None:
            self._view.close()
        self._view = None

    def __getstate__(self) -> dict[str, Any]:
        """For copies and other processes: all but the drawing."""
        return {**self.__dict__, "_view": None}

    def _identity(self) -> str:
        task = self.task
        own = (task.structure, type(task.rows), task.rows.period, task.rows.plants.timestep)
        told = (task.observer.to_dict(), task.command_max.tolist(), task.weights, task.disturbed)
        # Of a source without a text of its own the address, which differs between equal ones, says nothing.
        return re.sub(r" at 0x\w+", "", repr((*own, *told, task.loads)))

    def get_state(self) -> EnvState:
        """The state, for this or another environment with the same arguments."""
        return EnvState(self.task.save(0), dict(self.np_random.bit_generator.state), self._identity())

    def set_state(self, state: EnvState) -> None:
        """Restores a saved state exactly. Raises InputError for a state of an environment with other arguments."""
        if not isinstance(state, EnvState) or state.of != self._identity():
            raise InputError("set_state: the state is of another environment; allowed: one with the same arguments")
        self.np_random.bit_generator.state = state.generator
        self.task.restore(0, state.episode, self.np_random)


class StructureEnv(PlantEnv):
    """A structure of one's own under loads of its source.

    structure: its class, or `file.py:NAME`. Other arguments: the fields of the class; `motions` (or its `source`),
    where loads come from; reward: weights by goal; and those of every environment (`PlantEnv`). Observations, `info`
    and options of `reset` are named as in the class: `acceleration_PLACE`, `GOAL_ratio`, `option`.
    """

    def __init__(self, structure: str | type[LinearStructure], **arguments: Any) -> None:
        self.kind = own_kind(structure)  # type: ignore[misc]
        super().__init__(**arguments)
