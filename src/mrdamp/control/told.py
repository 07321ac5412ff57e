"""What a controller is told of the damper that it drives, one mechanism for all, learned or not; and controllers from
outside the package: a class or function of one's own, or a model of stable-baselines3.

| known | what is done with it |
|---|---|
| lag of the force sensor | the measured force is taken back to the one before a first-order lag, for every controller |
| delay and lag of the driver | inverse models lead it; a policy makes up for what its own training's driver had more |
| noise of the sensors | nothing: no controller is told |

A policy that was trained in another environment is refused.

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
import reprlib
import traceback
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from gymnasium.spaces import Box

from mrdamp.control import registry
from mrdamp.control.base import Controller, Unlagged
from mrdamp.control.observe import Observer
from mrdamp.control.policy import Policy
from mrdamp.control.registry import AnySite
from mrdamp.control.registry import Site as FrameSite
from mrdamp.errors import InputError, MrdampError, first_line, require_period
from mrdamp.files import read_bytes, read_json
from mrdamp.model import Model
from mrdamp.outside import NAMED, named
from mrdamp.simulation.rows import finite

if TYPE_CHECKING:
    from mrdamp.envs.task import Task

_LAG = "sensor_lag"
Site = TypeVar("Site", bound=AnySite)


class Told:
    """A controller whose measured force has no lag of its sensor, its command clamped to what the damper takes.

    Raises InputError for a command that is no number and for whatever else it raises. Attributes: inner; name; period,
    s; takes: the least and the largest command, A or V; dampers: how many commands it may give.
    """

    def __init__(
        self, inner: Controller, sensor_lag: float, takes: tuple[float, float], name: str = "", dampers: int = 1
    ) -> None:
        self.inner, self.name, self.takes, self.dampers = inner, name or inner.name, takes, dampers
        self.period = float(inner.period)  # NumPy's numbers as well: MJCF cannot hold them
        self._force = Unlagged(self.period, sensor_lag)

    def reset(self) -> None:
        ask(self.name, self.inner.reset)
        self._force.reset()

    def command(self, t: float, y: Mapping[str, float]) -> Any:
        rows, (least, largest) = np.shape(next(iter(y.values()))), self.takes  # before: it may empty what it is given
        found = ask(self.name, self.inner.command, t, self._force(y))
        try:
            values = finite("command", found, (self.dampers, *(rows or (1,))) if np.size(found) > 1 else (1, 1))
        except ValueError:  # InputError is one
            said = f"controller {self.name}: its command at {t:g} s is {reprlib.repr(found)}"
            many = f", or {self.dampers} of them" if self.dampers > 1 else ""
            raise InputError(f"{said}; allowed: a finite number{many}") from None
        if values.size == 1:  # of all dampers
            return min(max(float(values[0, 0]), least), largest)
        return np.clip(values, least, largest).reshape((self.dampers, *rows) if self.dampers > 1 else rows)


def ask(name: str, call: Callable[..., Any], *given: Any) -> Any:
    """What a controller's own code returns; whatever it raises is its author's to mend. Raises InputError."""
    try:
        return call(*given)
    except MrdampError:
        raise
    except (Exception, SystemExit) as error:
        raise InputError(f"controller {name}: {type(error).__name__}: {first_line(error)}{_place(error)}") from None


def _place(error: BaseException) -> str:
    """The deepest line of the called code's own file that an error went through."""
    own = traceback.extract_tb(error.__traceback__)[1:]
    lines = [f.lineno for f in own if f.filename == own[0].filename]
    return f" ({Path(own[0].filename).name}, line {lines[-1]})" if lines else ""


def told(build: Callable[[Site], Controller], site: Site, name: str = "") -> Told:
    """The controller that `build` makes for a site, told of its damper as above. name: for messages, else its own.

    Raises InputError.
    """
    damper, largest = site.damper, site.command_max
    own = tuple(e for e in damper.effects if e.name != _LAG)
    # Inverse models compare the force with what they expect at the sensor: without its lag, as it is given to them.
    made = build(replace(site, damper=replace(damper, effects=own)))  # type: ignore[type-var]
    if isinstance(made, Policy):
        made.require(site.environment)
        made.matched(damper.command_lag)
        if isinstance(site, FrameSite):
            made.facing(site.frame.places)
    # As the chain clamps: without command_min a command acts by its size. 0 is no command, also of a law above it.
    least = min(0.0, damper.attributes.get("command_min", -largest))
    return Told(made, damper.sensor_lag, (least, largest), name, site.dampers)


def knowledge(damper: Model) -> str:
    """What every controller is told of a damper, in words."""
    driver, sensor = 1e3 * damper.command_lag, 1e3 * damper.sensor_lag
    return f"every controller is told the lags of driver ({driver:.3g} ms) and force sensor ({sensor:.3g} ms), no noise"


#: Makes the task of one row that a model was trained in, from arguments of its environment.
MakeTask = Callable[..., "Task"]


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
