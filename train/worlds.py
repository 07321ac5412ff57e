"""The structures that a policy can be trained in: tasks and loads, what it is evaluated by, and its evaluation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.force_levels import ForceLevels
from mrdamp.control.observe import Observer
from mrdamp.control.policy import Policy
from mrdamp.envs.cable import Cable
from mrdamp.envs.car import Car
from mrdamp.envs.frame import Frame
from mrdamp.envs.linear import own_kind
from mrdamp.envs.plant_env import RowPlant
from mrdamp.envs.randomise import Randomise
from mrdamp.envs.structure import Structure
from mrdamp.envs.task import Task, divided, episodes
from mrdamp.envs.weights import OF_DAMPERS
from mrdamp.errors import InputError
from mrdamp.model.core import Array
from mrdamp.outside import NAMED

#: Worlds that share the loads where parameters are drawn. Coprime to the amplitudes, which each then has.
_SHARING = 6


@dataclass(frozen=True)
class Stage:
    """A plant with a controller of its own, which runs apart from any task."""

    plant: RowPlant
    controller: Controller


@dataclass(frozen=True)
class World:
    """A kind of structure with keyword arguments of its environment. scored: options of its criteria."""

    kind: type[Structure]
    arguments: Mapping[str, Any]
    scored: Mapping[str, float] = field(default_factory=dict)

    @property
    def criteria(self) -> Mapping[str, float]:
        """What the score is made of: weights of the measures."""
        return self.kind.criteria(**{**self.kind.scored, **self.scored})

    @property
    def measures(self) -> tuple[str, ...]:
        """The fields of `info` that are kept of an episode."""
        return (*self.criteria, "mean_current")

    @property
    def shares(self) -> Array:
        """(criteria,) of the score."""
        weights = np.array(list(self.criteria.values()))
        return np.asarray(weights / weights.sum())

    def sizes_of(self, period: Array) -> Array:
        """(n, criteria) from what happened in a control period, (n, ...). A measure is nearly the mean over time of
        sizes^exponent to the power of 1/exponent: a peak for large exponents."""
        totals = {total.name: total for total in self.kind.weights.totals}
        used = [totals[name] for name in self.criteria]
        return np.stack([period[:, t.column] ** (0.5 if t.how == "rms" else 1.0) for t in used], axis=1)

    @staticmethod
    def current_of(period: Array) -> Array:
        """(n,) mean current over its largest, from what happened in a control period, (n, ...)."""
        return np.asarray(period[:, OF_DAMPERS.index("share") - len(OF_DAMPERS)])

    def observing(self, observer: Observer) -> Self:
        """The same with another observer."""
        return replace(self, arguments={**self.arguments, "observer": observer})

    def drawn(self, rng: np.random.Generator, loads: int) -> tuple[Self, ...]:
        """Some of this world, for as many loads, seen by its observer, whose parameters share the ranges of `randomise`
        evenly; itself where nothing is drawn."""
        ranges = self.arguments.get("randomise")
        if ranges is None:
            return (self,)
        task = self.task(1)
        own = {**self.arguments, "randomise": None, "observer": task.observer}
        parts = tuple(task.structure.parts().values())
        draws = Randomise(ranges, parts).spread(rng, min(_SHARING, loads))
        return tuple(replace(self, arguments=own | task.structure.varied(d).parts()) for d in draws)

    def _made(self, n: int, others: Mapping[str, Any], step: float = 0.0) -> Task:
        """With other arguments; step: s, of the rows at least."""
        given = {**self.arguments, **others}
        if step:
            given["timestep"] = max(given.get("timestep", 0.0), step)
        structure, rest = divided(self.kind, given)
        return Task(structure, n, **rest)

    def task(self, n: int, engine: str = "chain", loads: Any = None) -> Task:
        """n rows under training loads, or those of a source."""
        others = {"engine": engine, self.kind.source: loads or self.structure.training()}
        return self._made(n, others, self.kind.trained if engine == "chain" else 0.0)

    def judging(self, n: int) -> Task:
        """n rows in MuJoCo, without noise, whose `info` has the measures as reported, whatever the reward is."""
        return self._made(n, {"reward": None, "noise": None})

    def searching(self, n: int) -> Task:
        """n rows on the C++ chain, whose `info` has the measures as reported."""
        return self._made(n, {"reward": None, "engine": "chain"}, self.kind.searched)

    @property
    def structure(self) -> Structure:
        """As of the arguments."""
        return divided(self.kind, self.arguments)[0]

    def levels(self, task: Task, viscous: bool = False) -> ForceLevels:
        """Of the damper, for forces as actions, at the stroke that it is observed by; see `ForceLevels.of`."""
        scales = dict(zip(task.observer.signals, task.observer.scales, strict=True))
        stroke = scales.get("stroke") or task.structure.sensors(task.command_max, False)[1]["stroke"]
        s = task.structure
        return ForceLevels.of(s.models[0], float(task.command_max[0]), stroke, s.first, viscous)

    def stage(self, task: Task, spec: str) -> Stage:
        """One structure as those of the task, and a classical controller for it. Raises InputError."""
        largest, plants = float(task.command_max[0]), task.rows.plants
        plant = RowPlant(
            task.structure, period=task.rows.period, timestep=plants.timestep, command_max=task.command_max.tolist()
        )
        site = task.structure.site(largest, plant.period, self.levels(task).force_max)
        return Stage(plant, registry.make(spec, site))

    def score(self, means: Mapping[str, float]) -> float:
        """Of the means of the measures over the validation loads; smaller is better."""
        return sum(weight * means[name] for name, weight in self.criteria.items()) / sum(self.criteria.values())


WORLDS: Mapping[str, type[Structure]] = {
    "mrdamp/Frame-v0": Frame,
    "mrdamp/Cable-v0": Cable,
    "mrdamp/QuarterCar-v0": Car,
}


def world(
    environment: str,
    arguments: Mapping[str, Any],
    model: Path | None = None,
    score: Mapping[str, float] | None = None,
) -> World:
    """The world of an environment's id, or of a structure of one's own as `file.py:NAME`.

    model: a file of the damper's model, None: the environment's own; score: what the score is made of, `weight` of the
    frame and `holding` of the quarter car, each 0 to 1.

    Raises InputError for an id or an argument that there is none of.
    """
    if environment not in WORLDS and not NAMED.fullmatch(environment):
        raise InputError(f"environment {environment!r} is unknown; there are {', '.join(WORLDS)}, file.py:NAME")
    kind = WORLDS.get(environment) or own_kind(environment)
    parts = dict(score or {})
    for name, value in parts.items():
        if name not in kind.scored or not isinstance(value, int | float) or not 0 <= value <= 1:
            ranges = ", ".join(f"{known} from 0 to 1" for known in kind.scored) or "nothing"
            raise InputError(f"{environment}: score.{name} is {value!r}; allowed: {ranges}")
    chosen = World(kind, {**arguments, **({"model": model} if model else {})}, parts)
    try:
        chosen.task(1)
    except TypeError as error:
        raise InputError(f"{environment}: env_kwargs: {error}") from None
    return chosen


Act = Callable[[NDArray[np.float32]], Array]


def forces(task: Task, observation: NDArray[np.float32]) -> Array:
    """(n,) N, the damper's, as observations (n, size) hold it; zero where they do not."""
    return task.observer.measured(observation, "force")


class Judge:
    """Runs policies on loads, all at once. worlds: one or several, that take the loads in turn; their observer must be
    that of the policies. Raises InputError where a world has no load."""

    def __init__(self, worlds: World | Sequence[World], loads: Sequence[Any]) -> None:
        several = list(worlds) if isinstance(worlds, Sequence) else [worlds]
        if len(several) > len(loads):
            raise InputError(f"{len(several)} models for {len(loads)} loads; allowed: a load each at least")
        parts = [list(loads[k :: len(several)]) for k in range(len(several))]
        self._parts = [(w, part, w.judging(len(part))) for w, part in zip(several, parts, strict=True)]

    def __call__(self, policy: Policy | float) -> dict[str, Array]:
        """(loads,) for each of the world's measures, world by world; a number is a constant command."""
        found = [self._one(policy, *part) for part in self._parts]
        return {name: np.concatenate([f[name] for f in found]) for name in found[0]}

    def _one(
        self, policy: Policy | float, world: World, loads: Sequence[Any], task: Task
    ) -> dict[str, Array]:
        if isinstance(policy, Policy):
            policy.reset()

        def act(observation: NDArray[np.float32]) -> Array:
            if isinstance(policy, Policy):
                return policy.commands(observation, forces(task, observation))
            return np.full(len(observation), policy)

        return episodes(task, world.measures, loads, act)
