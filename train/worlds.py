"""The environments that a policy can be trained in: their tasks, loads, and what a policy is judged by."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mrdamp.control import cable as cable_controllers
from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.force_levels import ForceLevels
from mrdamp.control.observe import Observer
from mrdamp.envs.cable_task import CablePlant, CableTask, default_places
from mrdamp.envs.frame_task import FrameTask
from mrdamp.envs.plant import FramePlant
from mrdamp.envs.task import Task
from mrdamp.errors import InputError
from mrdamp.train.loads import (
    CableLoads,
    some_motions,
    training_motions,
    validation_loads,
    validation_motions,
)

Array = NDArray[np.float64]

_DRAWN = 12.0  # s, of the cable's loads that a search draws
_SEARCHED = (
    5e-4  # s, of the frame's step at least in a search: the engine at .1 ms gives the same peaks within .5 %
)


@dataclass(frozen=True)
class Stage:
    """A plant with a controller of its own, which runs apart from any task."""

    plant: FramePlant | CablePlant
    controller: Controller


class World(ABC):
    """One environment id with its keyword arguments.

    option: of a reset, that names the load. measures: what `info` says of an episode that is kept.
    """

    option: ClassVar[str]
    measures: ClassVar[tuple[str, ...]]

    @abstractmethod
    def observing(self, observer: Observer) -> World:
        """The same with another observer."""

    @abstractmethod
    def task(self, n: int, engine: str = "chain") -> Task:
        """n rows under training loads."""

    @abstractmethod
    def judging(self, n: int) -> Task:
        """n rows in MuJoCo whose `info` holds the measures as they are reported, whatever the reward is."""

    @abstractmethod
    def searching(self, n: int) -> Task:
        """As `judging`, on the C++ chain."""

    @abstractmethod
    def draw(self, rng: np.random.Generator, count: int) -> list[Any]:
        """Loads as training draws them."""

    @abstractmethod
    def validation(self) -> Sequence[Any]:
        """Loads that a policy is judged by while it is trained."""

    @abstractmethod
    def levels(self, task: Task) -> ForceLevels:
        """Of the damper, for forces as actions."""

    @abstractmethod
    def stage(self, task: Task, spec: str) -> Stage:
        """One structure as those of the task, and a classical controller for it. Raises InputError."""

    @abstractmethod
    def sizes(self, task: Task) -> Array:
        """(n,) of the rows' motion without control, in the observer's units."""

    @abstractmethod
    def score(self, means: Mapping[str, float]) -> float:
        """Of the means of the measures over the validation loads; smaller is better."""


@dataclass(frozen=True)
class FrameWorld(World):
    """`mrdamp/Frame-v0`. arguments: of `FrameTask`. weight: of peak acceleration to peak drift in the score.

    A constant command that saves drift costs acceleration; the weight is such that a policy gains in both over it.
    """

    arguments: Mapping[str, Any]
    weight: float = 0.3
    option: ClassVar[str] = "motion"
    measures: ClassVar[tuple[str, ...]] = ("drift_ratio", "acceleration_ratio", "mean_current")

    def observing(self, observer: Observer) -> FrameWorld:
        return replace(self, arguments={**self.arguments, "observer": observer})

    def task(self, n: int, engine: str = "chain") -> FrameTask:
        return FrameTask(n, motions=training_motions(), engine=engine, **self.arguments)

    def judging(self, n: int) -> FrameTask:
        return FrameTask(n, **{**self.arguments, "reward": None})

    def searching(self, n: int) -> FrameTask:
        step = max(self.arguments.get("timestep", _SEARCHED), _SEARCHED)
        return FrameTask(n, **{**self.arguments, "reward": None, "timestep": step, "engine": "chain"})

    def draw(self, rng: np.random.Generator, count: int) -> list[Any]:
        return some_motions(rng, count)

    def validation(self) -> Sequence[Any]:
        return validation_motions()

    def levels(self, task: Task) -> ForceLevels:
        assert isinstance(task, FrameTask)
        scales = dict(zip(task.observer.signals, task.observer.scales, strict=True))
        w = 2 * math.pi * float(task.structure.frequencies[0])
        stroke = scales.get("stroke", 5.0 / w**2)
        return ForceLevels.of(task.models[0], float(task.command_max[0]), stroke, w)

    def stage(self, task: Task, spec: str) -> Stage:
        assert isinstance(task, FrameTask)
        plants, model = task.rows.plants, task.models[0]
        plant = FramePlant(
            model, period=task.rows.period, timestep=plants.timestep, command_max=float(task.command_max[0])
        )
        site = replace(registry.Site.of(model, plant.period), command_max=plant.command_max)
        return Stage(plant, registry.make(spec, site))

    def sizes(self, task: Task) -> Array:
        scales = dict(zip(task.observer.signals, task.observer.scales, strict=True))
        return np.asarray(task.score.values[:, 1] / scales.get("acceleration_1", 5.0))

    def score(self, means: Mapping[str, float]) -> float:
        return (means["drift_ratio"] + self.weight * means["acceleration_ratio"]) / (1 + self.weight)


@dataclass(frozen=True)
class CableWorld(World):
    """`mrdamp/Cable-v0`. arguments: of `CableTask`."""

    arguments: Mapping[str, Any]
    option: ClassVar[str] = "load"
    measures: ClassVar[tuple[str, ...]] = ("motion_ratio", "mean_current")

    def observing(self, observer: Observer) -> CableWorld:
        return replace(self, arguments={**self.arguments, "observer": observer})

    def task(self, n: int, engine: str = "chain") -> CableTask:
        return CableTask(n, loads=CableLoads(), engine=engine, **self.arguments)

    def judging(self, n: int) -> CableTask:
        return CableTask(n, **{**self.arguments, "reward": None})

    def searching(self, n: int) -> CableTask:
        return CableTask(n, **{**self.arguments, "reward": None, "engine": "chain"})

    def draw(self, rng: np.random.Generator, count: int) -> list[Any]:
        length = self.task(1).cable.length
        return CableLoads(_DRAWN).some(rng, length, count)

    def validation(self) -> Sequence[Any]:
        return validation_loads(self.task(1).cable.length)

    def levels(self, task: Task) -> ForceLevels:
        assert isinstance(task, CableTask)
        scales = dict(zip(task.observer.signals, task.observer.scales, strict=True))
        return ForceLevels.of(task.model, float(task.command_max[0]), scales["stroke"], task.cable.first)

    def stage(self, task: Task, spec: str) -> Stage:
        assert isinstance(task, CableTask)
        plant = CablePlant(
            task.cable, task.model, period=task.rows.period, timestep=task.rows.plants.timestep,
            command_max=float(task.command_max[0]),
        )  # fmt: skip
        places, largest = default_places(task.cable), self.levels(task).force_max
        site = cable_controllers.CableSite(
            task.cable, plant.command_max, places, largest, plant.period, task.model
        )
        return Stage(plant, cable_controllers.make(spec, site))

    def sizes(self, task: Task) -> Array:
        assert isinstance(task, CableTask)
        return np.asarray(np.sqrt(task.score.values[:, 0]) / (2e-3 * task.cable.length))

    def score(self, means: Mapping[str, float]) -> float:
        return means["motion_ratio"]


WORLDS: Mapping[str, type[FrameWorld] | type[CableWorld]] = {
    "mrdamp/Frame-v0": FrameWorld,
    "mrdamp/Cable-v0": CableWorld,
}


def world(environment: str, arguments: Mapping[str, Any], model: Path | None = None) -> World:
    """The world of an environment's id. model: a file of the damper's model, None: the environment's own.

    Raises InputError for an id or an argument that there is none of.
    """
    if environment not in WORLDS:
        raise InputError(f"environment {environment!r} is unknown; there are {', '.join(WORLDS)}")
    chosen = WORLDS[environment]({**arguments, **({"model": model} if model else {})})
    try:
        chosen.task(1)
    except TypeError as error:
        raise InputError(f"{environment}: env_kwargs: {error}") from None
    return chosen
