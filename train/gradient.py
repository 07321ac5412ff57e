"""Trainings by the learners of stable-baselines3."""

from __future__ import annotations

from typing import Any

import stable_baselines3
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecMonitor
from torch import nn

from mrdamp.control.policy import Network
from mrdamp.envs.sb3 import PlantVecEnv
from mrdamp.errors import InputError
from mrdamp.train.asymmetric import AsymmetricPolicy, Privileged
from mrdamp.train.export import network
from mrdamp.train.run import Progress, Run
from mrdamp.train.wrappers import ForceAction, Whitened


class GradientRun(Run):
    """One training; TensorBoard's files are in the folder `tensorboard`."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        torch.set_num_threads(1)
        base = PlantVecEnv(self.task)
        base.seed(int(self.draws.generate_state(1)[0] // 2))
        venv: VecEnv = base
        if self.levels is not None:
            venv = ForceAction(base, self.task.observer, self.levels, self.command_max)
        venv = Whitened(venv, self.matrix)
        if self.chosen.privileged:
            venv = Privileged(venv, self.world, self.task)
        self.venv = VecMonitor(venv)
        self.model = self._model(int(self.seed.generate_state(1)[0] // 2))

    @property
    def timesteps(self) -> int:
        return int(self.model.num_timesteps)

    def learn(self, progress: Progress) -> None:
        left = self.chosen.n_timesteps - self.timesteps
        if left > 0:
            self.model.learn(left, _Callback(self, progress), reset_num_timesteps=False, tb_log_name="run")
            if self.curve[-1]["timesteps"] < self.timesteps:
                self.evaluate()

    def evaluate(self) -> dict[str, float]:
        row = super().evaluate()
        for name, value in row.items():
            self.model.logger.record(f"validation/{name}", value)
        return row

    def network(self) -> Network:
        return network(self.model.policy)

    def save(self) -> None:
        fresh = self.out / "checkpoint.new.zip"
        self.model.save(fresh)
        fresh.replace(self.out / "checkpoint.zip")

    def _model(self, seed: int) -> BaseAlgorithm:
        chosen, name = self.chosen, self.options.algorithm
        algorithm: type[BaseAlgorithm] = getattr(stable_baselines3, name.upper())
        checkpoint = self.out / "checkpoint.zip"
        if checkpoint.is_file():
            return algorithm.load(checkpoint, env=self.venv, device="cpu")
        policy_kwargs: dict[str, Any] = dict(chosen.policy_kwargs)
        if "activation_fn" in policy_kwargs:
            policy_kwargs["activation_fn"] = getattr(nn, str(policy_kwargs["activation_fn"]))
        if chosen.privileged and name not in ("a2c", "ppo"):
            raise InputError(f"{name}: privileged is for a2c and ppo")
        try:
            return algorithm(
                AsymmetricPolicy if chosen.privileged else chosen.policy,
                self.venv, seed=seed, device="cpu", policy_kwargs=policy_kwargs,
                tensorboard_log=str(self.out / "tensorboard"), **chosen.learner,
            )  # fmt: skip
        except (TypeError, ValueError, AssertionError) as error:
            raise InputError(f"{name}: hyperparameters: {error}") from None


class _Callback(BaseCallback):
    """Progress, and evaluations where they are due."""

    def __init__(self, run: GradientRun, progress: Progress) -> None:
        super().__init__()
        self._running, self._progress, self._told = run, progress, -run.chosen.n_timesteps

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        run = self._running
        if run.timesteps >= self._told + run.chosen.n_timesteps / 100:
            self._told = run.timesteps
            run.tell(self._progress)
        if run.due():
            run.evaluate()
