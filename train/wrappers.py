"""Between a vector environment and a learner: actions as a policy has them, and whitened observations."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from mrdamp.control.policy import Policy
from mrdamp.envs.task import Task
from mrdamp.train.evaluate import forces


class PolicyAction(VecEnvWrapper):
    """Actions are those of a policy's network: `Policy.driven` makes the damper's command of them."""

    def __init__(self, venv: VecEnv, task: Task, policy: Policy) -> None:
        super().__init__(venv)
        self.task, self.policy = task, policy
        self._observation: NDArray[np.float32] = np.zeros((venv.num_envs, task.observer.size), np.float32)

    def reset(self) -> Any:
        self._observation = self.venv.reset()
        return self._observation

    def step_async(self, actions: NDArray[Any]) -> None:
        given = np.clip(np.asarray(actions, dtype=np.float64), -1.0, 1.0)
        each = given if self.policy.dampers > 1 else given.reshape(-1)
        command = self.policy.driven(each, self._observation, forces(self.task, self._observation))
        self.venv.step_async((2.0 * command / self.policy.command_max - 1.0).reshape(given.shape).astype(np.float32))

    def step_wait(self) -> Any:
        observation, reward, done, infos = self.venv.step_wait()
        self._observation = observation
        return observation, reward, done, infos


class Whitened(VecEnvWrapper):
    """Observations times a fixed matrix (k, size), see `mrdamp.train.run.whitening`."""

    def __init__(self, venv: VecEnv, matrix: NDArray[np.float32], limit: float = 1e3) -> None:
        super().__init__(venv, observation_space=Box(-limit, limit, (len(matrix),), np.float32))
        self.matrix = matrix

    def reset(self) -> Any:
        return self.venv.reset() @ self.matrix.T

    def step_wait(self) -> Any:
        observation, reward, done, infos = self.venv.step_wait()
        for row in np.flatnonzero(done).tolist():
            infos[row]["terminal_observation"] = self.matrix @ infos[row]["terminal_observation"]
        return observation @ self.matrix.T, reward, done, infos
