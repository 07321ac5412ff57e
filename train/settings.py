"""What a training is given: options of the command, and hyperparameters from YAML, keyed by environment id."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import yaml

from mrdamp.errors import InputError, refuse, require_one_of
from mrdamp.files import decode, read_bytes
from mrdamp.outside import NAMED

#: Those of stable-baselines3, `recurrent` (RecurrentPPO of sb3-contrib), the evolution strategy of
#: `mrdamp.train.search`, and the gradients through the chain of `mrdamp.train.adjoint`.
ALGORITHMS = ("a2c", "adjoint", "ddpg", "es", "ppo", "recurrent", "sac", "td3")
_WHOLE = ("pool", "freeze", "renew")


@dataclass(frozen=True)
class Options:
    """One training. hyperparameters: a YAML file in place of the one that comes with the package; overrides:
    `learning_rate=3e-4`, `env_kwargs.history=4`, ...; timesteps: control periods in all, None: as in the YAML; model:
    the damper's, None: the environment's own; others: further models that the evolution strategy searches and judges on
    besides, the loads shared among them; evaluations: on the validation loads, each with a checkpoint."""

    environment: str = "mrdamp/Frame-v0"
    algorithm: str = "ppo"
    seed: int = 0
    timesteps: int | None = None
    hyperparameters: Path | None = None
    overrides: tuple[str, ...] = ()
    model: Path | None = None
    evaluations: int = 10
    others: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        if self.algorithm not in ALGORITHMS:
            raise InputError(f"algorithm {self.algorithm!r} is unknown; there are {', '.join(ALGORITHMS)}")
        if self.others and (self.algorithm != "es" or self.model is None):
            raise InputError(
                f"{self.algorithm}: {1 + len(self.others)} models; allowed: several for es, else one"
            )
        _require_whole("", 0, seed=self.seed)
        _require_whole("", 1, evaluations=self.evaluations)
        if self.timesteps is not None:
            _require_whole("", 1, timesteps=self.timesteps)

    def to_dict(self) -> dict[str, Any]:
        own = {k: str(v) if isinstance(v, Path) else v for k, v in vars(self).items() if k != "others"}
        return own | ({"others": [str(f) for f in self.others]} if self.others else {})


@dataclass(frozen=True)
class Settings:
    """What the YAML holds.

    n_envs: rows of the vector environment. engine: that they train on, `chain` (the C++ chain) or `mujoco`; a policy is
    evaluated in MuJoCo. n_timesteps: control periods in all. action: `command`, or `force`: the wanted force, which the
    damper's command follows by `ForceLevels`; switch: on/off. estimator: a classical controller, as
    `clipped-optimal:r=1e-9`, whose Kalman filter's states are observed besides. ground: of a Kalman filter of frame
    and ground that is observed too, see `mrdamp.train.worlds.Ground`, or several; none: no such filter.
    normalize: whiten the observations. viscous: `ForceLevels` with the damper's viscous part, which needs the stroke's
    velocity among the signals; ahead: s by signal, that lead that velocity, see `Policy`. teacher: a classical
    controller whose wanted force, as a linear function of the observations, is what the learner begins at; reach:
    how far a learner of stable-baselines3 may go from it, over the largest force. least: of a least command
    (`mrdamp.control.force_levels`), `level` over the largest command, and `fade`, `full` and `rise` over the
    damper's force at zero command; none: no such command. env_kwargs: of the environment. score: what the
    validation score is made of, see `mrdamp.train.worlds.world`. policy, policy_kwargs: of stable-baselines3,
    activation_fn by name. learner: the
    algorithm's other arguments; learning_rate may be `linear_0.001`, which falls to zero over the training.

    For learners of stable-baselines3: pool: loads in all, which an episode takes one of, with the reward of
    `mrdamp.train.lessons`; 0: new loads throughout, with the environment's reward. exponent: of that reward, none: the
    world's. renew: control periods after which what has been learned takes the place of the teacher in that reward; 0:
    never. price: of the mean current over its largest, in the score's unit. privileged: the critic sees the full
    state and the load to come. freeze: control periods at the start in which the critic learns alone. fixed_std:
    on-policy learners keep the standard deviation they explore with, which narrows early otherwise. explore: of DDPG,
    SAC and TD3, the standard deviation of Ornstein-Uhlenbeck noise on the actions; 0: none. correlated: its correlation
    time in control periods.
    """

    n_envs: int = 8
    n_timesteps: int = 1_000_000
    engine: Literal["chain", "mujoco"] = "chain"
    action: Literal["command", "force"] = "command"
    switch: bool = False
    viscous: bool = False
    ahead: Mapping[str, float] = field(default_factory=dict)
    estimator: str = ""
    ground: Mapping[str, float] | list[Mapping[str, float]] | None = None
    normalize: bool = True
    teacher: str = ""
    reach: float = 1.0
    least: Mapping[str, float] | None = None
    pool: int = 0
    exponent: float | None = None
    renew: int = 0
    price: float = 0.0
    privileged: bool = False
    freeze: int = 0
    fixed_std: bool = False
    explore: float = 0.0
    correlated: float = 10.0
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    score: Mapping[str, float] = field(default_factory=dict)
    policy: str = "MlpPolicy"
    policy_kwargs: Mapping[str, Any] = field(default_factory=dict)
    learner: Mapping[str, Any] = field(default_factory=dict)

    def learner_over(self, defaults: Mapping[str, Any], algorithm: str) -> dict[str, Any]:
        """The algorithm's other arguments, over its defaults. Raises InputError for one that it does not have, and for
        one that is no number where the default is one."""
        for name, value in self.learner.items():
            if name not in defaults:
                known = *defaults, *(f.name for f in fields(self) if f.name != "learner")
                raise InputError(f"{algorithm}: hyperparameters: {name!r} is unknown; allowed: {', '.join(known)}")
            default = defaults[name]
            number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
            if isinstance(default, float) and not number:
                raise InputError(f"{algorithm}: hyperparameters: {name} is {value!r}; allowed: a finite number")
            if isinstance(default, int) and not (number and value == int(value)):
                raise InputError(f"{algorithm}: hyperparameters: {name} is {value!r}; allowed: a whole number")
        return {**defaults, **self.learner}

    def hidden(self, algorithm: str) -> list[int]:
        """Sizes of the hidden layers of `es` and `adjoint`. Raises InputError."""
        sizes = self.policy_kwargs.get("net_arch", [])
        if not isinstance(sizes, list) or not all(isinstance(size, int) and size > 0 for size in sizes):
            raise InputError(f"{algorithm}: policy_kwargs.net_arch is {sizes!r}; allowed: sizes of hidden layers")
        return sizes

    def __post_init__(self) -> None:
        require_one_of("hyperparameters", ("command", "force"), action=self.action)
        require_one_of("hyperparameters", ("chain", "mujoco"), engine=self.engine)
        _require_whole("hyperparameters: ", 1, n_envs=self.n_envs, n_timesteps=self.n_timesteps)
        _require_whole("hyperparameters: ", 0, pool=self.pool, freeze=self.freeze, renew=self.renew)
        for name, open_end in (("reach", True), ("correlated", True), ("price", False), ("explore", False)):
            value = getattr(self, name)
            if not isinstance(value, int | float) or not (value > 0 or (value == 0 and not open_end)):
                allowed = "a number > 0" if open_end else "a number, 0 or more"
                raise InputError(f"hyperparameters: {name} is {value!r}; allowed: {allowed}")
        mappings = ("ahead", "env_kwargs", "score", "policy_kwargs")
        refuse(
            "hyperparameters",
            (self.freeze >= self.n_timesteps,
             f"freeze is {self.freeze} of {self.n_timesteps} control periods: nothing would be learned; train longer, "
             "or set freeze lower"),
            (self.viscous and self.switch, "viscous and switch exclude each other"),
            (self.privileged and not self.pool, "privileged needs a pool of loads; set pool"),
            *((not isinstance(getattr(self, name), Mapping), f"{name} is no mapping of names to values")
              for name in mappings),
        )  # fmt: skip


def _require_whole(where: str, least: int, **values: Any) -> None:
    for name, value in values.items():
        if not isinstance(value, int) or value < least:
            raise InputError(f"{where}{name} is {value!r}; allowed: a whole number, {least} or more")


def settings(options: Options) -> Settings:
    """Of the options' environment and algorithm, with their overrides. Raises InputError."""
    table = _read(options)
    if options.environment not in table and not NAMED.fullmatch(options.environment):
        raise InputError(
            f"no hyperparameters of {options.algorithm} for {options.environment}; there are {', '.join(table)}"
        )
    chosen: dict[str, Any] = dict(table.get(options.environment) or {})  # a structure of one's own may have none
    for override in options.overrides:
        _set(chosen, override)
    if options.timesteps is not None:
        chosen["n_timesteps"] = options.timesteps
    known = {f.name for f in fields(Settings)} - {"learner"}
    own = {k: v for k, v in chosen.items() if k in known}
    own |= {k: _number(v) for k, v in own.items() if k.startswith("n_") or k in _WHOLE}
    return Settings(**own, learner={k: v for k, v in chosen.items() if k not in known})


def _read(options: Options) -> Mapping[str, Any]:
    if options.hyperparameters is None:
        file = resources.files("mrdamp.train") / "hyperparameters" / f"{options.algorithm}.yml"
        name, text = file.name, file.read_text(encoding="utf-8")
    else:
        name = str(options.hyperparameters)
        text = decode(name, read_bytes(options.hyperparameters))
    try:
        table = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise InputError(f"{name}: not YAML: {error}") from None
    if not isinstance(table, Mapping):
        raise InputError(f"{name}: allowed: a mapping of environment ids to hyperparameters")
    return table


def _set(chosen: dict[str, Any], override: str) -> None:
    path, equals, value = override.partition("=")
    keys = path.split(".")
    if not equals or not all(keys):
        raise InputError(f"override {override!r}; allowed: NAME=VALUE, as in learning_rate=3e-4")
    place: dict[str, Any] = chosen
    for key in keys[:-1]:
        inner = place.get(key, {})
        if not isinstance(inner, Mapping):
            raise InputError(f"override {override!r}: {key} is not a mapping")
        place[key] = dict(inner)
        place = place[key]
    try:
        place[keys[-1]] = _number(yaml.safe_load(value))
    except yaml.YAMLError as error:
        raise InputError(f"override {override!r}: {error}") from None


def _number(value: Any) -> Any:
    """YAML reads 1e6 as text, and 1.0e+6 as a number that is not whole."""
    if isinstance(value, str):
        try:
            value = float(value)
        except ValueError:
            return value
    return int(value) if isinstance(value, float) and value.is_integer() and abs(value) >= 1000 else value
