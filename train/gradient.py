"""Trainings by the learners of stable-baselines3."""

from __future__ import annotations

import io
import math
import random
from collections.abc import Callable, Mapping
from inspect import signature
from typing import Any

import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.noise import OrnsteinUhlenbeckActionNoise
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor
from torch import nn

from mrdamp.control.policy import Memory, Network
from mrdamp.envs.sb3 import PlantVecEnv
from mrdamp.errors import InputError, require_one_of
from mrdamp.files import write_atomic
from mrdamp.parallel import Progress
from mrdamp.train.asymmetric import ACTIVATIONS, POLICIES, memory, network
from mrdamp.train.lessons import Drawn, Known, Lessons, PolicyAction, Whitened, known
from mrdamp.train.run import Run, reading

_FALLING = (
    "linear_"  # before a learning rate that falls to zero over the training, as RL Baselines3 Zoo has `lin_`
)
#: Of a wrapper of stable-baselines3: what it is made with, and cannot be saved.
_FIXED = ("venv", "class_attributes")
#: Of a learner, which its own checkpoint leaves out.
_MEMORIES = ("replay_buffer", "_last_lstm_states")
#: Of a state-dependent exploration: drawn before a rollout.
_EXPLORATION = ("exploration_mat", "exploration_matrices")
_ONE = "a whole number, 1 or more"
#: Of a learner's arguments: in words, and whether a number is.
_RANGES: Mapping[str, tuple[str, Callable[[float], bool]]] = {
    **dict.fromkeys(
        ("batch_size", "buffer_size", "n_epochs", "n_steps", "policy_delay", "train_freq"),
        (_ONE, lambda v: type(v) is int and v >= 1),
    ),
    "gradient_steps": (f"{_ONE}, or -1", lambda v: type(v) is int and (v >= 1 or v == -1)),
    "learning_starts": ("a whole number, 0 or more", lambda v: type(v) is int and v >= 0),
    **dict.fromkeys(("gamma", "tau"), ("a number above 0, up to 1", lambda v: 0 < v <= 1)),
    "gae_lambda": ("0 to 1", lambda v: 0 <= v <= 1),
    **dict.fromkeys(("learning_rate", "clip_range"), ("a number > 0", lambda v: 0 < v < math.inf)),
}
_SPREAD = 0.5  # of durations in the pool: up to so much longer or shorter
_OFF_POLICY = ("ddpg", "sac", "td3")
_FRESH = 0.1  # share of the newest actor in the mean over updates that is exported
_NOTHING = (
    1e-3  # of the actor's last layer at the start, over its usual size: what is learned begins at the teacher
)


class GradientRun(Run):
    """One training; TensorBoard's files are in the folder `tensorboard`."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        torch.set_num_threads(1)
        self._teacher = self.taught() if self.chosen.teacher else None
        self.model: BaseAlgorithm | None = None
        self.lessons_given: Lessons | None = None
        runs = self._pool()
        base = PlantVecEnv(self.task)
        base.seed(int(self.draws.generate_state(1)[0] // 2))
        venv: VecEnv = Whitened(PolicyAction(base, self.task, self.policy()), self.matrix)
        if runs:
            exponent = self.chosen.exponent or self.world.kind.exponent
            privileged = self.chosen.privileged
            venv = Lessons(venv, self.world, self.task, runs, exponent, self.chosen.price, privileged=privileged)
            self.lessons_given = venv
        self.venv = VecMonitor(venv)
        self._kept: dict[str, Any] = {}
        self._renewed, self._resumed = 0, False
        seed = int(self.seed.generate_state(1)[0] // 2)
        if self.resumed:
            with reading(self.checkpoint):
                self._kept = torch.load(self.checkpoint, weights_only=False)
                self.model = self._model(seed)
                self._go_on()
        else:
            self.model = self._model(seed)
        self._require_learning()

    @property
    def timesteps(self) -> int:
        return int(self.model.num_timesteps) if self.model is not None else 0

    def learn(self, progress: Progress) -> None:
        assert self.model is not None
        left = self.chosen.n_timesteps - self.timesteps
        if left > 0:
            self.model.learn(left, _Callback(self, progress), reset_num_timesteps=False, tb_log_name="run")
            _average(self.model.policy)
            if self.curve[-1]["timesteps"] < self.timesteps:
                self.evaluate()

    def network(self) -> Network:
        if self.model is None:  # the base that a learner begins at
            dampers = len(self.task.command_max)
            return Network(((np.zeros((dampers, len(self.matrix))), np.zeros(dampers)),), "identity")
        return network(self.model.policy)

    def memory(self) -> Memory | None:
        return memory(self.model.policy) if self.model is not None else None

    def teacher(self) -> Any:
        return self._teacher

    def save(self) -> None:
        """The model, and the present: rows with their wrappers, replay memory, exploration and random numbers."""
        assert self.model is not None
        model = io.BytesIO()
        self.model.save(model)
        kept = {
            "model": model.getvalue(),  # in one file with the rest: of two, one may be older after a stop
            "layers": [{k: v for k, v in vars(each).items() if k not in _FIXED} for each in _layers(self.venv)],
            "memory": {name: vars(self.model)[name] for name in _MEMORIES if name in vars(self.model)},
            "exploration": {k: v for k, v in _state(_noise_of(self.model)).items() if k in _EXPLORATION},
            "noise": _state(getattr(self.model, "action_noise", None)),
            # stable-baselines3 draws from all three.
            "random": (torch.get_rng_state(), np.random.get_state(), random.getstate()),  # noqa: NPY002
            "renewed": self._renewed,
        }
        write_atomic(self.checkpoint, lambda file: torch.save(kept, file))

    def _go_on(self) -> None:
        """From the saved present, to the last bit; what belongs to a rollout, at its start (`_Callback`)."""
        assert self.model is not None
        for each, held in zip(_layers(self.venv), self._kept["layers"], strict=True):
            vars(each).update(held)
        self.task = self.venv.unwrapped.task
        vars(self.model).update(self._kept["memory"])
        self._renewed, self._resumed = self._kept["renewed"], True

    def resume(self) -> bool:
        """True once, at the rollout that a saved present was at the start of; what was drawn for it is as it was."""
        if not self._resumed:
            return False
        self._resumed = False
        _state(_noise_of(self.model)).update(self._kept["exploration"])
        _state(getattr(self.model, "action_noise", None)).update(self._kept["noise"])
        now = self._kept["random"]
        torch.set_rng_state(now[0])
        np.random.set_state(now[1])  # noqa: NPY002
        random.setstate(now[2])
        return True

    def renew(self) -> None:
        """Makes what has been learned the base of the reward, where that is due."""
        every = self.chosen.renew
        if self.lessons_given is None or not every or self.timesteps // every <= self._renewed:
            return
        self._renewed = self.timesteps // every
        self.lessons_given.renew(self._runs())

    def _pool(self) -> list[Known]:
        """Runs of the teacher under the loads of the pool, which the task draws from."""
        if not self.chosen.pool:
            return []
        self._loads = self.world.structure.some(np.random.default_rng(self.pooled), self.chosen.pool, _SPREAD)
        self._aside = self.task
        runs = self._runs()
        self.task = self.world.task(self.task.n, self.chosen.engine, Drawn([run.load for run in runs]))
        return runs

    def _runs(self) -> list[Known]:
        """Of the present policy under the loads of the pool."""
        return known(self.world, self._aside, self._loads, self.policy())

    def _model(self, seed: int) -> BaseAlgorithm:
        chosen, name = self.chosen, self.options.algorithm
        algorithm: type[BaseAlgorithm] = (
            sb3_contrib.RecurrentPPO if name == "recurrent" else getattr(stable_baselines3, name.upper())
        )
        if self._kept:
            return algorithm.load(io.BytesIO(self._kept["model"]), env=self.venv, device="cpu", force_reset=False)
        if chosen.freeze and name in _OFF_POLICY:
            raise InputError(f"{name}: freeze is for a2c, ppo and recurrent")
        policy_kwargs: dict[str, Any] = dict(chosen.policy_kwargs)
        if "activation_fn" in policy_kwargs:
            chosen_one = str(policy_kwargs["activation_fn"])
            require_one_of(f"{name}: policy_kwargs", ACTIVATIONS, activation_fn=chosen_one)
            policy_kwargs["activation_fn"] = getattr(nn, chosen_one)
        given = dict(chosen.learner)
        rate = str(given.get("learning_rate", ""))
        if rate.startswith(_FALLING):
            given["learning_rate"] = LinearSchedule(_number(rate.removeprefix(_FALLING)), 0.0, 1.0)
        for parameter in signature(algorithm).parameters.values():
            value = given.get(parameter.name)
            if isinstance(value, str) and isinstance(parameter.default, int | float):
                raise InputError(f"{name}: hyperparameters: {parameter.name} is {value!r}; allowed: a number")
            allowed, fits = _RANGES.get(parameter.name, ("", None))
            number = value.start if isinstance(value, LinearSchedule) else value
            if fits and number is not None and not (type(number) in (int, float) and fits(number)):
                raise InputError(f"{name}: hyperparameters: {parameter.name} is {number!r}; allowed: {allowed}")
        if chosen.explore:
            if name not in _OFF_POLICY:
                raise InputError(f"{name}: explore is for {', '.join(_OFF_POLICY)}")
            given["action_noise"] = self._noise()
        policy = POLICIES[name] if chosen.policy == "MlpPolicy" else chosen.policy
        if policy is POLICIES[name]:
            policy_kwargs["front"] = len(self.matrix)
        elif chosen.privileged:
            raise InputError(f"{name}: privileged is for policy: MlpPolicy")
        try:
            model = algorithm(
                policy, self.venv, seed=seed, device="cpu", policy_kwargs=policy_kwargs,
                tensorboard_log=str(self.out / "tensorboard"), **given,
            )  # fmt: skip
        except (TypeError, ValueError, AssertionError) as error:
            raise InputError(f"{name}: hyperparameters: {error}") from None
        if self._teacher is not None:
            _begin_at_nothing(model.policy)
        return model

    def _require_learning(self) -> None:
        """Raises InputError for fewer control periods than the first that change the actor."""
        model: Any = self.model
        if self.options.algorithm in _OFF_POLICY:
            every, name, idle = model.n_envs * model.train_freq.frequency, "learning_starts", model.learning_starts
            begun = idle // every  # the first collection whose end is behind it
        else:
            every, name, idle = model.n_envs * model.n_steps, "freeze", self.chosen.freeze
            begun = -(-idle // every)  # the first collection whose start is not before it
            # A rate that falls to zero is zero after the last collection.
            begun += isinstance(model.learning_rate, LinearSchedule)
        if self.chosen.n_timesteps <= begun * every:
            raise InputError(
                f"{self.options.algorithm}: {self.chosen.n_timesteps} control periods; allowed: more than "
                f"{begun * every}, up to which nothing is learned ({name} is {idle}, {every} are collected at once)"
            )

    def _noise(self) -> OrnsteinUhlenbeckActionNoise:
        """Of standard deviation `explore`; white noise of 2 ms hardly passes the driver's lag."""
        theta = 1.0 / self.chosen.correlated
        each = np.ones(len(self.task.command_max))
        sigma = self.chosen.explore * np.sqrt(2.0 * theta) * each
        return OrnsteinUhlenbeckActionNoise(0.0 * each, sigma, theta=theta, dt=1.0)


def _layers(venv: Any) -> list[Any]:
    return [venv, *_layers(venv.venv)] if isinstance(venv, VecEnvWrapper) else [venv]


def _noise_of(model: Any) -> Any:
    """What holds a state-dependent exploration; None: nothing does."""
    policy = model.policy
    return getattr(policy, "action_dist", None) or getattr(getattr(policy, "actor", None), "action_dist", None)


def _state(of: Any) -> dict[str, Any]:
    """The attributes of a thing, to read and to change; of None there are none."""
    return {} if of is None else vars(of)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(
            f"hyperparameters: learning_rate is linear_{text}; allowed: linear_ and a number"
        ) from None


def _begin_at_nothing(policy: Any) -> None:
    """Makes the actor's last layer small, so that its first actions are nearly zero."""
    if hasattr(policy, "action_net"):
        last = [policy.action_net]
    elif hasattr(policy.actor, "latent_pi"):
        last = [policy.actor.mu]
    else:
        last = [
            [m for m in actor.mu if isinstance(m, nn.Linear)][-1]
            for actor in (policy.actor, policy.actor_target)
        ]
    with torch.no_grad():
        for layer in last:
            layer.weight.mul_(_NOTHING)
            layer.bias.zero_()
    if hasattr(policy, "average"):
        policy.average(1.0)


def _average(policy: Any) -> None:
    """Takes the newest actor into the mean that is exported, where there is one."""
    if hasattr(policy, "average"):
        policy.average(_FRESH)


class _Callback(BaseCallback):
    """Progress, evaluations where they are due, and an actor that waits for its critic."""

    def __init__(self, run: GradientRun, progress: Progress) -> None:
        super().__init__()
        self._running, self._progress, self._last_report = run, progress, -run.chosen.n_timesteps

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        run = self._running
        if run.timesteps >= self._last_report + run.chosen.n_timesteps / 100:
            self._last_report = run.timesteps
            run.tell(self._progress)
        if not run.resume():
            _average(self.model.policy)
        if run.due():
            run.evaluate()
        run.renew()
        self._freeze(run.timesteps < run.chosen.freeze)

    def _freeze(self, frozen: bool) -> None:
        policy: Any = self.model.policy
        parts = [policy.action_net, policy.mlp_extractor.policy_net] if hasattr(policy, "action_net") else []
        parts += [policy.lstm_actor] if hasattr(policy, "lstm_actor") else []
        for parameter in [p for part in parts for p in part.parameters()]:
            parameter.requires_grad_(not frozen)
        if hasattr(policy, "log_std"):
            policy.log_std.requires_grad_(not frozen and not self._running.chosen.fixed_std)
