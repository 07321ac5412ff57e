"""One training: environment, normalisation, learner, evaluation, checkpoints, export."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import stable_baselines3
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecMonitor
from torch import nn

from mrdamp.control.policy import Policy
from mrdamp.envs.sb3 import PlantVecEnv
from mrdamp.envs.task import Task
from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.train.asymmetric import AsymmetricPolicy, Privileged
from mrdamp.train.evaluate import Judge
from mrdamp.train.export import export
from mrdamp.train.settings import Options, Settings, settings
from mrdamp.train.worlds import World, world
from mrdamp.train.wrappers import ForceAction, Whitened, whitening

Progress = Callable[[str, float], None]

_EXPLORED = 1500  # control periods of n_envs rows that the whitening is taken from
_HELD = 50  # control periods that an action is held for there


@dataclass(frozen=True)
class Result:
    """folder: policy.json (the best on the validation loads), training.json; curve: one row an evaluation, its
    `timesteps`, `score` and the means of the world's measures; seconds: of process time, whole."""

    folder: Path
    curve: tuple[dict[str, float], ...]
    seconds: float

    @property
    def best(self) -> dict[str, float]:
        return min(self.curve, key=lambda row: row["score"])


def train(options: Options, out: Path | str, progress: Progress | None = None) -> Result:
    """Trains into the folder `out`; goes on from its checkpoint, and does nothing where it is done already.

    Raises InputError where `out` holds a training with other options.
    """
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    chosen = settings(options)
    _claim(out, options, chosen)
    finished = out / "training.json"
    if finished.is_file():
        kept = json.loads(finished.read_text())
        return Result(out, tuple(kept["curve"]), kept["seconds"])
    torch.set_num_threads(1)
    run = _Run(options, chosen, out)
    run.learn(progress or (lambda what, share: None))
    write_atomic(finished, json.dumps({"curve": run.curve, "seconds": run.seconds()}, indent=1) + "\n")
    return Result(out, tuple(run.curve), run.seconds())


def _claim(out: Path, options: Options, chosen: Settings) -> None:
    """Writes what the folder is of, or checks it."""
    own = json.loads(json.dumps({"options": options.to_dict(), "settings": asdict(chosen)}))
    file = out / "options.json"
    if file.is_file() and json.loads(file.read_text()) != own:
        raise InputError(f"{out}: holds a training with other options; choose another folder")
    write_atomic(file, json.dumps(own, indent=1) + "\n")


class _Run:
    """A training that is going on. Attributes: curve, as in `Result`."""

    def __init__(self, options: Options, chosen: Settings, out: Path) -> None:
        self.options, self.chosen, self.out = options, chosen, out
        self.world: World = world(options.environment, chosen.env_kwargs, options.model)
        self.task: Task = self.world.task(chosen.n_envs)
        if len(self.task.command_max) != 1:
            raise InputError("training is for one damper; the environment has several")
        self.levels = self.world.levels(self.task) if chosen.action == "force" else None
        rows, explore, learner = np.random.SeedSequence(options.seed).spawn(3)
        base = PlantVecEnv(self.task)
        base.seed(int(rows.generate_state(1)[0] // 2))
        venv: VecEnv = base
        if self.levels is not None:
            venv = ForceAction(base, self.task.observer, self.levels, float(self.task.command_max[0]))
        self.matrix = self._matrix(venv, np.random.default_rng(explore))
        venv = Whitened(venv, self.matrix)
        if chosen.privileged:
            venv = Privileged(venv, self.world, self.task)
        self.venv = VecMonitor(venv)
        self.model = self._model(int(learner.generate_state(1)[0] // 2))
        self.judge = Judge(self.world, self.world.validation())
        self.curve: list[dict[str, float]] = []
        self._before, self._start = 0.0, time.process_time()
        if (out / "state.json").is_file():
            kept = json.loads((out / "state.json").read_text())
            self.curve, self._before = kept["curve"], kept["seconds"]

    def seconds(self) -> float:
        """Of process time so far, those before a resume included."""
        return self._before + time.process_time() - self._start

    def learn(self, progress: Progress) -> None:
        left = self.chosen.n_timesteps - self.model.num_timesteps
        if left > 0:
            callback = _Callback(self, progress)
            self.model.learn(left, callback=callback, reset_num_timesteps=False, tb_log_name="run")
            if self.curve[-1]["timesteps"] < self.model.num_timesteps:
                self.evaluate()

    def evaluate(self) -> None:
        """A row of the curve, a checkpoint, and policy.json where it is the best yet."""
        policy = self.policy()
        values = self.judge(policy)
        means = {name: float(v.mean()) for name, v in values.items()}
        score = self.world.score(means)
        best = min((row["score"] for row in self.curve), default=np.inf)
        self.curve.append({"timesteps": float(self.model.num_timesteps), "score": score, **means})
        if score < best:
            policy.write(self.out / "policy.json")
        for name, value in {"score": score, **means}.items():
            self.model.logger.record(f"validation/{name}", value)
        self.model.save(self.out / "checkpoint.tmp.zip")
        (self.out / "checkpoint.tmp.zip").replace(self.out / "checkpoint.zip")
        write_atomic(self.out / "state.json", json.dumps({"curve": self.curve, "seconds": self.seconds()}) + "\n")

    def policy(self) -> Policy:
        """What the learner knows now, for export."""
        o = self.options
        about = {
            "name": f"{o.algorithm} seed {o.seed}",
            "options": o.to_dict(),
            "settings": json.loads(json.dumps(asdict(self.chosen))),
            "timesteps": self.model.num_timesteps,
            "stable_baselines3": stable_baselines3.__version__,
        }
        period, largest = self.task.rows.period, float(self.task.command_max[0])
        return export(self.model, self.task.observer, self.matrix, period, largest, self.levels, about)

    def _matrix(self, venv: VecEnv, rng: np.random.Generator) -> NDArray[np.float32]:
        file = self.out / "normalization.npy"
        if file.is_file():
            return np.asarray(np.load(file))
        size = self.task.observer.size
        matrix = np.eye(size, dtype=np.float32)
        if self.chosen.normalize:
            seen, action = [venv.reset()], np.zeros((venv.num_envs, 1), np.float32)
            for k in range(_EXPLORED):
                if k % _HELD == 0:
                    action = rng.uniform(-1, 1, (venv.num_envs, 1)).astype(np.float32)
                seen.append(venv.step(action)[0])
            matrix = whitening(np.concatenate(seen))
        np.save(file, matrix)
        return matrix

    def _model(self, seed: int) -> BaseAlgorithm:
        chosen, own = self.chosen, dict(self.chosen.learner)
        algorithm: type[BaseAlgorithm] = getattr(stable_baselines3, self.options.algorithm.upper())
        checkpoint = self.out / "checkpoint.zip"
        if checkpoint.is_file():
            return algorithm.load(checkpoint, env=self.venv, device="cpu")
        policy_kwargs: dict[str, Any] = dict(chosen.policy_kwargs)
        if "activation_fn" in policy_kwargs:
            policy_kwargs["activation_fn"] = getattr(nn, str(policy_kwargs["activation_fn"]))
        if chosen.privileged and self.options.algorithm not in ("a2c", "ppo"):
            raise InputError(f"{self.options.algorithm}: privileged is for a2c and ppo")
        try:
            return algorithm(
                AsymmetricPolicy if chosen.privileged else chosen.policy,
                self.venv, seed=seed, device="cpu", policy_kwargs=policy_kwargs,
                tensorboard_log=str(self.out / "tensorboard"), **own,
            )  # fmt: skip
        except (TypeError, ValueError, AssertionError) as error:
            raise InputError(f"{self.options.algorithm}: hyperparameters: {error}") from None


class _Callback(BaseCallback):  # type: ignore[misc]
    """Progress, and evaluations evenly over the training."""

    def __init__(self, run: _Run, progress: Progress) -> None:
        super().__init__()
        self._running, self._progress = run, progress
        self._every = run.chosen.n_timesteps / run.options.evaluations

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        run, done = self._running, self.model.num_timesteps
        self._progress(f"train: seed {run.options.seed}", min(1.0, done / run.chosen.n_timesteps))
        if done >= self._every * len(run.curve):
            run.evaluate()
