"""The environments that a policy can be trained in: their tasks, loads, and what a policy is evaluated by."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from mrdamp.control import cable as cable_controllers
from mrdamp.control import car as car_controllers
from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.car_plant import CarSite
from mrdamp.control.force_levels import ForceLevels
from mrdamp.control.observe import Observer
from mrdamp.envs.cable_task import CablePlant, CableTask, default_places
from mrdamp.envs.car_task import CarPlant, CarTask
from mrdamp.envs.frame_task import FrameTask
from mrdamp.envs.plant import FramePlant, RowPlant
from mrdamp.envs.randomise import Randomise, varied
from mrdamp.envs.task import Task
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.train.loads import (
    CableLoads,
    TrainingRoads,
    some_motions,
    training_motions,
    validation_loads,
    validation_motions,
    validation_roads,
)

Array = NDArray[np.float64]

#: Worlds that share the loads where parameters are drawn. Coprime to the amplitudes, which each then has.
_SHARING = 6
_DRAWN = 12.0  # s, of the cable's loads that a search draws
_DRAWN_ROAD = 5.0  # s, of the roads that a search draws: more of them for the same periods
_SPREAD = 0.5  # of durations, where they differ: up to so much longer or shorter
_SEARCHED = (
    5e-4  # s, of the frame's step at least on the chain: the engine at .1 ms gives the same peaks within .5 %
)
_SEARCHED_CAR = 1e-3  # s, of the car's: the same scores as at .5 ms within .1 %


def _longer(rng: np.random.Generator) -> float:
    return float(rng.uniform(1.0 - _SPREAD, 1.0 + _SPREAD))


@dataclass(frozen=True)
class Criterion:
    """A part of a world's score: share times a measure, over loads.

    The measure comes from a column of what happens in a control period (its `power`-th power is the size, 1/2 of a mean
    square), as the mean over time to the power of 1/exponent; a peak is nearly that for large exponents.
    """

    measure: str
    share: float
    column: int
    power: float = 1.0


@dataclass(frozen=True)
class Stage:
    """A plant with a controller of its own, which runs apart from any task."""

    plant: RowPlant
    controller: Controller


@dataclass(frozen=True)
class World(ABC):
    """One environment id with its keyword arguments.

    arguments: of the task; kind: the task's class. option: of a reset, that names the load. measures: the fields of
    `info` that are kept of an episode.
    """

    arguments: Mapping[str, Any]
    kind: ClassVar[Callable[..., Task]]
    option: ClassVar[str]
    measures: ClassVar[tuple[str, ...]]
    #: Of the criteria's norm over time, unless the hyperparameters say otherwise.
    exponent: ClassVar[float]
    #: Of what happens in a control period: the mean current over its largest.
    share_column: ClassVar[int] = 2

    @property
    @abstractmethod
    def criteria(self) -> tuple[Criterion, ...]:
        """What the score is made of."""

    def sizes_of(self, period: Array) -> Array:
        """(n, criteria) from what happened in a control period, (n, ...)."""
        return np.stack([period[:, c.column] ** c.power for c in self.criteria], axis=1)

    def observing(self, observer: Observer) -> Self:
        """The same with another observer."""
        return replace(self, arguments={**self.arguments, "observer": observer})

    def model(self, task: Task) -> Model:
        """The damper of a task of this world."""
        assert isinstance(task, CableTask | CarTask)
        return task.model

    @abstractmethod
    def parts(self, task: Task) -> dict[str, Any]:
        """Structure and damper of a task, as arguments."""

    def drawn(self, rng: np.random.Generator, loads: int) -> tuple[Self, ...]:
        """Some of this world, for as many loads, seen by its observer, whose parameters share the ranges of `randomise`
        evenly; itself where nothing is drawn."""
        ranges = self.arguments.get("randomise")
        if ranges is None:
            return (self,)
        task = self.task(1)
        own = {k: v for k, v in self.arguments.items() if k not in ("randomise", "structure")}
        parts = self.parts(task)
        draws = Randomise(ranges, tuple(parts.values())).spread(rng, min(_SHARING, loads))
        return tuple(
            replace(self, arguments={**own, "observer": task.observer, **{k: varied(v, d) for k, v in parts.items()}})
            for d in draws
        )

    @abstractmethod
    def task(self, n: int, engine: str = "chain", loads: Any = None) -> Task:
        """n rows under training loads, or those of a source."""

    def judging(self, n: int) -> Task:
        """n rows in MuJoCo, without noise, whose `info` has the measures as reported, whatever the reward is."""
        return self.kind(n, **{**self.arguments, "reward": None, "noise": None})

    def searching(self, n: int) -> Task:
        """n rows on the C++ chain, whose `info` has the measures as reported."""
        return self.kind(n, **{**self.arguments, "reward": None, "engine": "chain"})

    @abstractmethod
    def draw(self, rng: np.random.Generator, count: int) -> list[Any]:
        """Loads as training draws them."""

    @abstractmethod
    def some(self, rng: np.random.Generator, count: int) -> list[Any]:
        """The same, of durations that differ: rows that start together must not stay in step, or a batch of them is
        all calm or all strong."""

    @abstractmethod
    def validation(self) -> Sequence[Any]:
        """Loads that a policy is evaluated by while it is trained."""

    @abstractmethod
    def levels(self, task: Task, viscous: bool = False) -> ForceLevels:
        """Of the damper, for forces as actions; see `ForceLevels.of`."""

    @abstractmethod
    def stage(self, task: Task, spec: str) -> Stage:
        """One structure as those of the task, and a classical controller for it. Raises InputError."""

    @abstractmethod
    def score(self, means: Mapping[str, float]) -> float:
        """Of the means of the measures over the validation loads; smaller is better."""


@dataclass(frozen=True)
class FrameWorld(World):
    """`mrdamp/Frame-v0`. arguments: of `FrameTask`. weight: of peak acceleration to peak drift in the score.

    A constant command that saves drift costs acceleration; the weight is such that a policy gains in both over it.
    """

    weight: float = 0.3
    kind: ClassVar[Callable[..., Task]] = FrameTask
    option: ClassVar[str] = "motion"
    measures: ClassVar[tuple[str, ...]] = ("drift_ratio", "acceleration_ratio", "mean_current")
    exponent: ClassVar[float] = 8.0

    @property
    def criteria(self) -> tuple[Criterion, ...]:
        whole = 1 + self.weight
        return Criterion("drift_ratio", 1 / whole, 0), Criterion("acceleration_ratio", self.weight / whole, 1)

    def model(self, task: Task) -> Model:
        assert isinstance(task, FrameTask)
        return task.models[0]

    def parts(self, task: Task) -> dict[str, Any]:
        assert isinstance(task, FrameTask)
        return {"model": task.models}

    def task(self, n: int, engine: str = "chain", loads: Any = None) -> FrameTask:
        own = {**self.arguments, **(self._longer if engine == "chain" else {})}
        return FrameTask(n, motions=loads or training_motions(), engine=engine, **own)

    def searching(self, n: int) -> FrameTask:
        return FrameTask(n, **{**self.arguments, **self._longer, "reward": None, "engine": "chain"})

    @property
    def _longer(self) -> dict[str, float]:
        return {"timestep": max(self.arguments.get("timestep", _SEARCHED), _SEARCHED)}

    def draw(self, rng: np.random.Generator, count: int) -> list[Any]:
        return some_motions(rng, count)

    def some(self, rng: np.random.Generator, count: int) -> list[Any]:
        return some_motions(rng, count, spread=_SPREAD)

    def validation(self) -> Sequence[Any]:
        return validation_motions()

    def levels(self, task: Task, viscous: bool = False) -> ForceLevels:
        assert isinstance(task, FrameTask)
        scales = dict(zip(task.observer.signals, task.observer.scales, strict=True))
        w = 2 * math.pi * float(task.structure.frequencies[0])
        stroke = scales.get("stroke", 5.0 / w**2)
        return ForceLevels.of(task.models[0], float(task.command_max[0]), stroke, w, viscous)

    def stage(self, task: Task, spec: str) -> Stage:
        assert isinstance(task, FrameTask)
        plants, model = task.rows.plants, task.models[0]
        plant = FramePlant(
            model, period=task.rows.period, timestep=plants.timestep, command_max=float(task.command_max[0])
        )
        site = replace(registry.Site.of(model, plant.period), command_max=plant.command_max)
        return Stage(plant, registry.make(spec, site))

    def score(self, means: Mapping[str, float]) -> float:
        return (means["drift_ratio"] + self.weight * means["acceleration_ratio"]) / (1 + self.weight)


@dataclass(frozen=True)
class CableWorld(World):
    """`mrdamp/Cable-v0`. arguments: of `CableTask`."""

    kind: ClassVar[Callable[..., Task]] = CableTask
    option: ClassVar[str] = "load"
    measures: ClassVar[tuple[str, ...]] = ("motion_ratio", "mean_current")
    exponent: ClassVar[float] = 2.0

    @property
    def criteria(self) -> tuple[Criterion, ...]:
        return (Criterion("motion_ratio", 1.0, 0, 0.5),)

    def parts(self, task: Task) -> dict[str, Any]:
        assert isinstance(task, CableTask)
        return {"cable": task.cable, "model": task.model}

    def task(self, n: int, engine: str = "chain", loads: Any = None) -> CableTask:
        return CableTask(n, loads=loads or CableLoads(), engine=engine, **self.arguments)

    def draw(self, rng: np.random.Generator, count: int) -> list[Any]:
        length = self.task(1).cable.length
        return CableLoads(_DRAWN).some(rng, length, count)

    def some(self, rng: np.random.Generator, count: int) -> list[Any]:
        length = self.task(1).cable.length
        return [
            load for k in range(count) for load in CableLoads(_DRAWN * _longer(rng)).some(rng, length, 1, k)
        ]

    def validation(self) -> Sequence[Any]:
        return validation_loads(self.task(1).cable.length)

    def levels(self, task: Task, viscous: bool = False) -> ForceLevels:
        assert isinstance(task, CableTask)
        return _levels(task, task.model, task.cable.first, viscous)

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

    def score(self, means: Mapping[str, float]) -> float:
        return means["motion_ratio"]


@dataclass(frozen=True)
class CarWorld(World):
    """`mrdamp/QuarterCar-v0`. arguments: of `CarTask`. holding: share of the dynamic tyre load in the score.

    The rest is that of comfort. By default a half each, as `mrdamp compare car` tunes.
    """

    holding: float = 0.5
    kind: ClassVar[Callable[..., Task]] = CarTask
    option: ClassVar[str] = "road"
    measures: ClassVar[tuple[str, ...]] = ("comfort_ratio", "load_ratio", "mean_current")
    exponent: ClassVar[float] = 2.0
    share_column: ClassVar[int] = 5

    @property
    def criteria(self) -> tuple[Criterion, ...]:
        comfort = Criterion("comfort_ratio", 1.0 - self.holding, 0, 0.5)
        return comfort, Criterion("load_ratio", self.holding, 1, 0.5)

    def parts(self, task: Task) -> dict[str, Any]:
        assert isinstance(task, CarTask)
        return {"car": task.car, "model": task.model}

    def task(self, n: int, engine: str = "chain", loads: Any = None) -> CarTask:
        return CarTask(n, roads=loads or TrainingRoads(), engine=engine, **self.arguments)

    def searching(self, n: int) -> CarTask:
        longer = {"timestep": max(self.arguments.get("timestep", _SEARCHED_CAR), _SEARCHED_CAR)}
        return CarTask(n, **{**self.arguments, **longer, "reward": None, "engine": "chain"})

    def draw(self, rng: np.random.Generator, count: int) -> list[Any]:
        return TrainingRoads(_DRAWN_ROAD).some(rng, count)

    def some(self, rng: np.random.Generator, count: int) -> list[Any]:
        return [road for k in range(count) for road in TrainingRoads(10.0 * _longer(rng)).some(rng, 1, k)]

    def validation(self) -> Sequence[Any]:
        return validation_roads()

    def levels(self, task: Task, viscous: bool = False) -> ForceLevels:
        assert isinstance(task, CarTask)
        return _levels(task, task.model, task.car.bounce, viscous)

    def stage(self, task: Task, spec: str) -> Stage:
        assert isinstance(task, CarTask)
        largest, period = float(task.command_max[0]), task.rows.period
        plant = CarPlant(
            task.car, task.model, period=period, timestep=task.rows.plants.timestep, command_max=largest
        )
        site = CarSite(task.car, task.model, largest, self.levels(task).force_max, period)
        return Stage(plant, car_controllers.make(spec, site))

    def score(self, means: Mapping[str, float]) -> float:
        return (1.0 - self.holding) * means["comfort_ratio"] + self.holding * means["load_ratio"]


WORLDS: Mapping[str, type[FrameWorld] | type[CableWorld] | type[CarWorld]] = {
    "mrdamp/Frame-v0": FrameWorld,
    "mrdamp/Cable-v0": CableWorld,
    "mrdamp/QuarterCar-v0": CarWorld,
}


def world(
    environment: str,
    arguments: Mapping[str, Any],
    model: Path | None = None,
    score: Mapping[str, float] | None = None,
) -> World:
    """The world of an environment's id. model: a file of the damper's model, None: the environment's own; score: what
    the score is made of, `weight` of the frame and `holding` of the quarter car, each 0 to 1.

    Raises InputError for an id or an argument that there is none of.
    """
    if environment not in WORLDS:
        raise InputError(f"environment {environment!r} is unknown; there are {', '.join(WORLDS)}")
    kind, parts = WORLDS[environment], dict(score or {})
    allowed = [f.name for f in fields(kind) if f.name != "arguments"]
    for name, value in parts.items():
        if name not in allowed or not isinstance(value, int | float) or not 0 <= value <= 1:
            ranges = ", ".join(f"{known} from 0 to 1" for known in allowed) or "nothing"
            raise InputError(f"{environment}: score.{name} is {value!r}; allowed: {ranges}")
    chosen = kind({**arguments, **({"model": model} if model else {})}, **parts)
    try:
        chosen.task(1)
    except TypeError as error:
        raise InputError(f"{environment}: env_kwargs: {error}") from None
    return chosen


def _levels(task: Task, model: Model, frequency: float, viscous: bool) -> ForceLevels:
    """Levels at the stroke that the observer is scaled by; frequency: rad/s."""
    scales = dict(zip(task.observer.signals, task.observer.scales, strict=True))
    return ForceLevels.of(model, float(task.command_max[0]), scales["stroke"], frequency, viscous)
