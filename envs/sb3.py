"""The rows of a task as a `VecEnv` of stable-baselines3 (the extra `train`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from mrdamp.control.observe import Observation
from mrdamp.envs.task import Task
from mrdamp.errors import InputError
from mrdamp.simulation.rows import finite

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError:
    raise ImportError(
        "mrdamp.envs.sb3 needs stable-baselines3, which is not installed: pip install 'mrdamp[train]'"
    ) from None


class PlantVecEnv(VecEnv):
    """The same numbers as `DummyVecEnv` over single environments, on the engine's `Batch`.

    task: as `mrdamp.envs.frame.FrameTask(8)`. A row that is over starts anew in the same step, its last
    observation in `infos[k]["terminal_observation"]`. Returns and lengths of episodes, such as `ep_rew_mean` in a log,
    come from stable-baselines3's `VecMonitor` around it.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.render_mode = self.spec = None  # no id has made it
        self._rngs = [seeding.np_random(None)[0] for _ in range(task.n)]
        self._actions: NDArray[np.float32] = np.zeros((task.n, 1), np.float32)
        super().__init__(task.n, task.observation_space, task.action_space)

    def reset(self) -> Observation:
        """All rows at rest, with the seeds and options given before (`seed`, `set_options`)."""
        for row, seed in enumerate(self._seeds):
            if seed is not None:
                self._rngs[row] = seeding.np_random(seed)[0]
        options = list(self._options)
        self._reset_seeds()
        self._reset_options()
        parts = []
        for row in range(self.num_envs):
            observation, infos = self.task.reset([row], self._rngs, options[row])
            self.reset_infos[row] = infos[0]
            parts.append(observation)
        return np.concatenate(parts)

    def step_async(self, actions: NDArray[np.float32]) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Observation, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        self.task.require_begun(running=False)
        shape = self.num_envs, *(self.action_space.shape or ())
        step = self.task.step(finite("action", self._actions, shape, exact=True))
        names, observation, over = self.task.score.NAMES, step.observation, step.over
        infos: list[dict[str, Any]] = [
            dict(zip(names, row, strict=True)) | {"TimeLimit.truncated": done}
            for row, done in zip(step.info.tolist(), over.tolist(), strict=True)
        ]
        for row in np.flatnonzero(over).tolist():
            infos[row]["terminal_observation"] = observation[row].copy()
            again, started = self.task.reset([row], self._rngs, {})
            observation[row], self.reset_infos[row] = again[0], started[0]
        return observation, step.reward.astype(np.float32), over, infos

    def close(self) -> None:
        """Nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Of the task; the rows have none of their own but `render_mode` and `spec`."""
        holder = self if attr_name in ("render_mode", "spec") else self.task
        return [getattr(holder, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise InputError(f"{attr_name}: the rows of a batch have no attributes of their own to set")

    def env_method(self, method_name: str, *arguments: Any, indices: Any = None, **named: Any) -> list[Any]:
        raise InputError(f"{method_name}: the rows of a batch have no methods of their own to call")

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Never: wrap the whole with a `VecEnvWrapper`."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[None]:
        """None: render a single environment."""
        return [None] * self.num_envs
