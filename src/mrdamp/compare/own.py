"""Controllers from outside the package: a class or function of one's own, or a model of stable-baselines3.

| spec | what it is |
|---|---|
| `module:NAME`, `file.py:NAME` | a class or function that makes a `Controller` of a site (`mrdamp.control.registry`) |
| `model.zip` | a policy saved by any algorithm of stable-baselines3 or sb3-contrib |
| `model.zip,statistics.pkl` | with what `VecNormalize.save` wrote; a pickle: only from a source you trust |
| `model.zip,arguments.json` | trained with other arguments of the environment, as `{"history": 3}` |
"""

from __future__ import annotations

import copy
import inspect
import os
import pickle
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.observe import Observer
from mrdamp.control.told import Site, Told, ask, told
from mrdamp.envs.task import Task
from mrdamp.errors import InputError, first_line, require_period
from mrdamp.files import read_bytes, read_json
from mrdamp.outside import NAMED, named

#: Makes the task of one row that a model was trained in, from arguments of its environment.
MakeTask = Callable[..., Task]


def is_own(what: str) -> bool:
    """Whether a name on the command line is a controller from outside the package."""
    return what.partition(",")[0].endswith(".zip") or NAMED.fullmatch(what) is not None


def is_code(spec: str) -> bool:
    """Whether a spec is Python code from outside the package."""
    kind, _, rest = spec.partition(":")
    return kind == registry.OWN and NAMED.fullmatch(rest) is not None


def make(spec: str, site: Site, task: MakeTask) -> Told:
    """The controller of a spec, from outside or built in, told of the site's damper. Raises InputError."""
    kind, _, rest = spec.partition(":")
    if kind == registry.OWN:
        return told(partial(_build, rest, task), site, rest)
    return told(partial(registry.make, spec), site)


def files_of(spec: str) -> bytes:
    """Content of the files of a policy or a model; nothing for a built-in controller. For Python code from outside the
    package, which may read anything, bytes that no other call returns. Raises InputError."""
    kind, _, rest = spec.partition(":")
    if kind == registry.POLICY:
        return read_bytes(Path(rest))
    if kind != registry.OWN:
        return b""
    return os.urandom(16) if is_code(spec) else b"".join(read_bytes(Path(part)) for part in rest.split(","))


def _build(rest: str, task: MakeTask, site: Any) -> Controller:
    if NAMED.fullmatch(rest) is None:
        return SavedPolicy(rest, task)
    made = named(rest, "controller")
    try:
        inspect.signature(made).bind(site)
    except TypeError as error:
        raise InputError(f"controller {rest}: {error}; allowed: a class or function of the site") from None
    found = ask(rest, made, copy.deepcopy(site))  # what it changes there is not the plant's
    if not isinstance(found, Controller):
        raise InputError(f"controller {rest}: it lacks some of name, period, reset and command (mrdamp.control.base)")
    require_period(f"controller {rest}", found.period)
    return found


class SavedPolicy:
    """A `Controller` from a model of stable-baselines3 (the extra `train`), without exploration.

    files: as in the table above; task: of the environment that it was trained in. Raises InputError.
    """

    def __init__(self, files: str, task: MakeTask) -> None:
        zipped, *others = files.split(",")
        given: dict[str, Any] = {}
        self._statistics: Any = None
        pickled = ""
        for other in others:
            if other.endswith(".json"):
                given = read_json(Path(other))
                if not isinstance(given, dict):
                    raise InputError(f"{other}: allowed: arguments of the environment by name")
            elif other.endswith(".pkl"):
                pickled, self._statistics = other, _statistics(other)
            else:
                raise InputError(f"{other}: beside a model; allowed: a .pkl of VecNormalize, a .json of arguments")
        try:
            made = task(**given)
        except TypeError as error:
            raise InputError(f"{zipped}: arguments: {first_line(error)}") from None
        rms: Any = getattr(self._statistics, "obs_rms", None)
        shape, known = made.observation_space.shape, np.shape(getattr(rms, "mean", np.zeros(0)))
        if rms is not None and known != shape:
            raise InputError(f"{pickled}: its statistics are of observations of shape {known}; allowed here: {shape}")
        self.name, self.period = Path(zipped).stem, float(made.rows.period)
        self.observer: Observer = made.observer
        self._largest = made.command_max
        self._policy = _policy(zipped)
        for what, wanted in (("observation", made.observation_space), ("action", made.action_space)):
            space = getattr(self._policy, f"{what}_space")
            # Bounds of actions say what the numbers mean; those of observations may be a wrapper's.
            same = isinstance(space, Box) and space.shape == wanted.shape and (what == "observation" or space == wanted)
            if not same:
                raise InputError(
                    f"{zipped}: its {what}s are {space}; allowed here: {wanted} (give the environment's arguments in a "
                    ".json beside it)"
                )
        self.reset()

    def reset(self) -> None:
        self.observer.reset()
        self._command, self._state = np.zeros(len(self._largest)), None

    def command(self, t: float, y: Mapping[str, float]) -> Any:
        """A command, or one a damper (m,)."""
        seen = self.observer(y, self._command)
        if self._statistics is not None:
            seen = self._statistics.normalize_obs(seen)
        starts = np.array([self._state is None])
        action, self._state = self._policy.predict(seen, self._state, starts, deterministic=True)
        shares = 0.5 * (np.asarray(action, dtype=np.float64) + 1.0)
        self._command = self._largest * np.clip(shares, 0.0, 1.0)
        return self._command


def _statistics(file: str) -> Any:
    data = read_bytes(Path(file))
    try:
        found = pickle.loads(data)
    except Exception as error:  # a pickle may raise anything
        raise InputError(f"{file}: not what VecNormalize.save writes: {first_line(error)}") from None
    if not hasattr(found, "normalize_obs"):
        raise InputError(f"{file}: a {type(found).__name__}; allowed: what VecNormalize.save writes")
    return found


def _policy(file: str) -> Any:
    """The policy in a saved model, of whichever algorithm: what it was trained with is not needed."""
    read_bytes(Path(file))  # that it is there
    try:
        from stable_baselines3.common.policies import ActorCriticPolicy
        from stable_baselines3.common.save_util import load_from_zip_file
    except ImportError:
        raise InputError(f"{file}: needs stable-baselines3: pip install 'mrdamp[train]'") from None
    try:
        data, parameters, _ = load_from_zip_file(file, device="cpu", custom_objects={"lr_schedule": _rate})
        assert data is not None
        kind, options = data["policy_class"], dict(data["policy_kwargs"])
        if issubclass(kind, ActorCriticPolicy):
            options["use_sde"] = data["use_sde"]
        policy = kind(data["observation_space"], data["action_space"], _rate, **options)
        policy.load_state_dict(parameters["policy"])
    except Exception as error:  # of pickles and archives of any kind
        said = f"{type(error).__name__}: {first_line(error)}"
        raise InputError(f"{file}: not a model of stable-baselines3: {said}") from None
    policy.set_training_mode(False)
    return policy


def _rate(_: float) -> float:
    return 0.0
