"""Options of all structures: stepping and command of the rows, observations of a task, and their noise."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp import sets
from mrdamp.control.observe import Observer
from mrdamp.envs.loads import Range
from mrdamp.envs.randomise import DrawnRows
from mrdamp.envs.structure import Structure
from mrdamp.errors import InputError, require_kind, require_one_of, require_period
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.rows import Stepping


def stem(name: str) -> str:
    """A measurement's name without its number."""
    return name.rstrip("0123456789").rstrip("_")


class Noise:
    """White noise on measurements; deviation: name, or the name without its number -> standard deviation, SI.

    Attributes: all (names,), its standard deviation on each; where, of the names there is any.
    """

    def __init__(self, deviation: Mapping[str, float], names: Sequence[str]) -> None:
        stems = {name: stem(name) for name in names}
        for key, value in deviation.items():
            if key not in stems and key not in stems.values():
                raise InputError(f"noise on {key!r}: no such measurement; there are: {', '.join(names)}")
            if not 0 <= value < math.inf:
                raise InputError(f"noise on {key!r} is {value}; allowed: >= 0")
        self.all: Array = np.array([deviation.get(name, deviation.get(stems[name], 0.0)) for name in names], np.float64)
        self.where: list[int] = np.flatnonzero(self.all).tolist()

    def add(self, values: Array, row: int, rng: np.random.Generator) -> None:
        """Onto row of values (n, names), in place."""
        if self.where:
            values[row, self.where] += self.all[self.where] * rng.standard_normal(len(self.where))


@dataclass(frozen=True, kw_only=True)
class RowOptions:
    """Stepping and command of rows.

    period: of control, s; timestep: the largest within it, s, None: the engine's own; command_max: A or V, one or one a
    damper, None: the models'; engine: `mujoco` or `chain`; threads: that share the rows.
    """

    period: float = 5e-3
    timestep: float | None = None
    command_max: float | Sequence[float] | None = None
    engine: str = "mujoco"
    threads: int = 1

    def rows(self, structure: Structure, n: int = 1) -> Any:
        """n rows of a structure on the engine. Raises InputError."""
        require_period("control", self.period)
        require_one_of("", structure.engines, engine=self.engine)
        kind, step = structure.engines[self.engine]
        timestep = step if self.timestep is None else self.timestep
        largest = command_range(structure.models, self.command_max)
        return kind(structure, Stepping(self.period, timestep, largest, n, self.threads))


@dataclass(frozen=True, kw_only=True)
class TaskOptions(RowOptions):
    """Options of every task in addition to those of its structure: the table of `mrdamp.envs.PlantEnv`."""

    observer: Observer | Mapping[str, Any] | None = None
    signals: Sequence[str] | None = None
    history: int = 1
    action_in_observation: bool = True
    memory: Sequence[float] = ()
    peaks: Mapping[str, float] | None = None
    full_state: bool = False
    normalise: bool = False
    noise: Mapping[str, float] | None = None
    randomise: Mapping[str, Range] | None = None

    def __post_init__(self) -> None:
        require_kind("an Observer, or a mapping", (Observer, Mapping), observer=self.observer)
        require_kind("a list of names", (list, tuple), signals=self.signals)
        for one in self.signals or ():
            require_kind("names", str, signal=one)
        require_kind("a list of numbers", (list, tuple, np.ndarray), memory=self.memory)
        require_kind("a number by name", Mapping, peaks=self.peaks, noise=self.noise)
        own = {name: getattr(self, name) for name in ("action_in_observation", "full_state", "normalise")}
        require_kind("True, False", bool, **own)

    def rows(self, structure: Structure, n: int = 1) -> Any:
        """As `RowOptions.rows`; where parameters are drawn, each row has a structure of its own."""
        if self.randomise is None:
            return super().rows(structure, n)
        return DrawnRows(super().rows(structure), self.randomise, n)

    def observes(self, structure: Structure, command_max: Array) -> Observer:
        """The observer that is given, one of its `to_dict`, or one of the structure's sensors.

        command_max: (m,) A or V. `normalise` takes out what is typical of a signal, by name or the name without its
        number. Raises InputError for a signal without a scale.
        """
        if self.observer is not None and self.normalise:
            raise InputError("normalise is for the environment's own observer; allowed: that, or an observer")
        if isinstance(self.observer, Observer):
            return self.observer
        if self.observer is not None:
            return Observer.from_dict(self.observer)
        default, scale = structure.sensors(command_max, self.full_state)
        typical = structure.typical
        given = default if self.signals is None else self.signals
        # `acceleration_*` is that of every floor; what is no measurement is refused below.
        signals = tuple(name for one in given for name in (fnmatch.filter(scale, one) or [one]))
        unknown = [name for name in signals if name not in scale]
        if unknown:
            raise InputError(f"observer: no measurement {unknown[0]!r}; there are: {', '.join(scale)}")
        if self.normalise:
            scale = {name: v * typical.get(name, typical.get(stem(name), 1.0)) for name, v in scale.items()}
        return Observer(
            signals, tuple(scale[name] for name in signals), self.history, self.action_in_observation,
            tuple(command_max), memory=tuple(self.memory), peaks=self.peaks or {},
        )  # fmt: skip


def command_range(models: Sequence[Model], command_max: float | Sequence[float] | None) -> Array:
    """(m,) largest command of each damper: as given, or the models' own `command_max`. Raises InputError."""
    if command_max is None:
        missing = [m.name for m in models if "command_max" not in m.attributes]
        if missing:
            raise InputError(f"{missing[0]}: it has no command_max; give command_max (A or V)")
        command_max = [m.attributes["command_max"] for m in models]
    try:
        values = np.broadcast_to(np.asarray(command_max, dtype=np.float64), (len(models),)).copy()
    except (TypeError, ValueError):
        values = np.array([math.nan])
    if not ((values > 0) & np.isfinite(values)).all():
        raise InputError(f"command_max is {command_max}; allowed: numbers > 0, one or one for each damper")
    for model, value in zip(models, values, strict=True):
        if value > (1 + 1e-9) * model.attributes.get("command_max", math.inf):
            own = model.attributes["command_max"]
            raise InputError(f"command_max is {value:g}; allowed: up to {own:g}, at which {model.name} clamps it")
    return values


def model_of(given: Model | Path | str | None, default: Callable[[], Model]) -> Model:
    """A damper's model as it is given, from its file, of its set's name, or the default. Raises InputError."""
    require_kind("a Model, or its file", (Model, str, Path), model=given)
    model = None if given is None else sets.named_model(given)
    if model is not None and model.rig == "frame":
        raise InputError(f"model {model.name} is of a frame; allowed here: a damper's")
    return default() if model is None else model
