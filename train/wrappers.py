"""Between a vector environment and a learner: actions as wanted forces, and whitened observations."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from mrdamp.control.force_levels import ForceLevels
from mrdamp.control.observe import Observer
from mrdamp.errors import InputError

Observation = NDArray[np.float32]
Array = NDArray[np.float64]


class ForceAction(VecEnvWrapper):
    """Actions are wanted forces over `levels.force_max`; the damper's command follows by `ForceLevels`.

    observer: of the environment; it must see the damper's `force`. command_max: A or V. One damper.
    """

    def __init__(self, venv: VecEnv, observer: Observer, levels: ForceLevels, command_max: float) -> None:
        super().__init__(venv)
        if "force" not in observer.signals or len(observer.command_max) != 1:
            raise InputError("force actions are for one damper whose force is observed")
        self.levels, self.command_max = levels, command_max
        self._column = observer.signals.index("force")
        self._scale = observer.scales[self._column]
        self._force: Array = np.zeros(venv.num_envs)

    def reset(self) -> Any:
        return self._seen(self.venv.reset())

    def step_async(self, actions: NDArray[Any]) -> None:
        wanted = self.levels.force_max * np.asarray(actions, dtype=np.float64).reshape(-1)
        share = self.levels.command(wanted, self._force) / self.command_max
        self.venv.step_async((2.0 * share - 1.0)[:, None].astype(np.float32))

    def step_wait(self) -> Any:
        observation, reward, done, info = self.venv.step_wait()
        return self._seen(observation), reward, done, info

    def _seen(self, observation: Any) -> Any:
        self._force = self._scale * observation[:, self._column].astype(np.float64)
        return observation


class Whitened(VecEnvWrapper):
    """Observations times a fixed matrix (k, size), see `mrdamp.train.run.whitening`."""

    def __init__(self, venv: VecEnv, matrix: NDArray[np.float32], limit: float = 1e3) -> None:
        super().__init__(venv, observation_space=Box(-limit, limit, (len(matrix),), np.float32))
        self.matrix = matrix

    def reset(self) -> Any:
        return self.venv.reset() @ self.matrix.T

    def step_wait(self) -> Any:
        observation, reward, done, infos = self.venv.step_wait()
        for info in infos:
            if "terminal_observation" in info:
                info["terminal_observation"] = self.matrix @ info["terminal_observation"]
        return observation @ self.matrix.T, reward, done, infos
