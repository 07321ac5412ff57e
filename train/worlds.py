"""The structures that a policy can be trained in: tasks and loads, what it is evaluated by, and its evaluation; what is
taken there from a classical controller: its Kalman filter, and the weights nearest to its wanted force."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.clipped_optimal import OptimalForce
from mrdamp.control.force_control import ForceController
from mrdamp.control.force_levels import ForceLevels
from mrdamp.control.lqg import Estimator, Plant, outputs, plant
from mrdamp.control.observe import LinearFilter, Observer
from mrdamp.control.policy import Policy
from mrdamp.envs.cable import Cable
from mrdamp.envs.car import Car
from mrdamp.envs.frame import Frame
from mrdamp.envs.linear import own_kind
from mrdamp.envs.plant_env import RowPlant
from mrdamp.envs.randomise import Randomise
from mrdamp.envs.structure import Structure
from mrdamp.envs.task import Task, divided, episodes
from mrdamp.errors import InputError, require_positive
from mrdamp.model.core import Array
from mrdamp.outside import NAMED
from mrdamp.structures import FloatArray, ShearFrame

#: Worlds that share the loads where parameters are drawn. Coprime to the amplitudes, which each then has.
_SHARING = 6


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

    def observing(self, observer: Observer) -> Self:
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
        return divided(self.kind, self.arguments)[0]

    def levels(self, task: Task, viscous: bool = False) -> ForceLevels:
        """Of the damper, for forces as actions, at the stroke that it is observed by; see `ForceLevels.of`."""
        scales = dict(zip(task.observer.signals, task.observer.scales, strict=True))
        stroke = scales.get("stroke") or task.structure.sensors(task.command_max, False)[1]["stroke"]
        s = task.structure
        return ForceLevels.of(s.models[0], float(task.command_max[0]), stroke, s.first, viscous)

    def stage(self, task: Task, spec: str) -> tuple[RowPlant, Controller]:
        """One structure as those of the task, a plant apart from any task, and a classical controller for it. Raises
        InputError."""
        largest, plants = float(task.command_max[0]), task.rows.plants
        plant = RowPlant(
            task.structure, period=task.rows.period, timestep=plants.timestep, command_max=task.command_max.tolist()
        )
        site = task.structure.site(largest, plant.period, self.levels(task).force_max)
        return plant, registry.make(spec, site)

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


_UNIT = 5.0  # m/s2: ground or floor acceleration that the observed states are scaled by, as signals are


@dataclass(frozen=True)
class Ground:
    """A Kalman filter of a shear frame on a ground whose motion it estimates too, by the model of Kanai and Tajimi.

        q'' + 2 z w q' + w^2 q = -white noise      ground acceleration = 2 z w q' + w^2 q

    A filter for white ground acceleration has nothing to say of the ground itself. This one does, and by its model of
    what follows, a little of the next tenths of the ground's period. Kanai 1957 (Bull. Earthq. Res. Inst. 35, 309),
    Tajimi 1960 (2nd World Conf. Earthq. Eng.).

    w: frequency, rad/s; z: damping, a ratio; noise_ratio: intensity of the white noise over that of every
    measurement's, (m/s2)^2 each; precision: standard deviation of a displacement's noise over that of an
    acceleration's, s^2. Raises InputError."""

    frequency: float
    damping: float
    noise_ratio: float
    precision: float

    def __post_init__(self) -> None:
        require_positive("ground filter", **vars(self))

    @classmethod
    def of(cls, given: Any) -> Ground:
        names = list(cls.__dataclass_fields__)
        fits = isinstance(given, Mapping) and set(given) == set(names)
        if not fits or not all(isinstance(v, int | float) for v in given.values()):
            raise InputError(f"ground filter: {given!r}; allowed: numbers {', '.join(names)}")
        return cls(**given)

    def estimator(self, frame: ShearFrame, measurements: Sequence[str], period: float) -> Estimator:
        """Of the states [x; x'; q; q']; measurements: of `mrdamp.control.lqg.outputs`. Raises InputError."""
        linear = plant(frame)
        n, of_ground = len(linear.a), self._acceleration
        a = np.zeros((n + 2, n + 2))
        a[:n, :n], a[:n, n:] = linear.a, np.outer(linear.e, of_ground)
        a[n, n + 1], a[n + 1, n:] = 1.0, -of_ground
        c, d = outputs(frame, measurements)
        whole = Plant(a, np.append(linear.b, [0.0, 0.0]), np.append(np.zeros(n + 1), 1.0))
        deviation = np.array([1.0 if m.startswith("acceleration") else self.precision for m in measurements])
        return Estimator(
            whole, np.pad(c, ((0, 0), (0, 2))), d, measurements, self.noise_ratio, period, deviation
        )

    @property
    def _acceleration(self) -> FloatArray:
        """(2,) of the ground, from [q, q']."""
        return np.array([self.frequency**2, 2 * self.damping * self.frequency])

    def observed(self, observer: Observer, frame: ShearFrame, period: float) -> Observer:
        """The observer with these states behind those of its own filter, each over that of a strong motion.

        All of its signals but the force are the filter's measurements. Raises InputError without a force.
        """
        if "force" not in observer.signals:
            raise InputError("ground filter: the observer sees no force")
        measurements = [name for name in observer.signals if name != "force"]
        w = 2 * np.pi * float(frame.frequencies[0])
        floors = np.repeat([w**2, w], frame.storeys)
        scale = np.append(floors, [self.frequency**2, self.frequency]) / _UNIT
        step, *gains = _scaled(self.estimator(frame, measurements, period), scale, observer)
        if observer.filter is not None:
            first = observer.filter.matrices
            step = block_diag(first[0], step)
            gains = [np.vstack([one, two]) for one, two in zip(first[1:], gains, strict=True)]
        return replace(observer, filter=_filter(step, *gains))


def _scaled(held: Estimator, scale: FloatArray, observer: Observer) -> tuple[Array, Array, Array]:
    """Matrices of a `LinearFilter` whose states are those of a Kalman filter times scale (n,); signals of the observer
    that it does not take count for nothing."""
    needed = (*held.measurements, "force")
    columns = [needed.index(name) if name in needed else -1 for name in observer.signals]
    step, before, now = held.matrices
    padded = (np.column_stack([gain, np.zeros(len(gain))])[:, columns] for gain in (before, now))
    own, further = (scale[:, None] * gain * observer.scales for gain in padded)
    return scale[:, None] * step / scale, own, further


def _filter(*matrices: Array) -> LinearFilter:
    return LinearFilter(*(tuple(map(tuple, matrix.tolist())) for matrix in matrices))


def estimated(world: World, spec: str) -> Observer:
    """The world's observer with the states of a controller's Kalman filter, each in its share of the wanted force over
    the largest: what matters most to the controller is largest.

    Raises InputError for a controller without one, and for an observer without its measurements.
    """
    task = world.task(1)
    (_, controller), own = world.stage(task, spec), task.observer
    if not isinstance(controller, ForceController) or not isinstance(controller.aim, OptimalForce):
        raise InputError(
            f"estimator {controller.name}: it has no Kalman filter; allowed: clipped-optimal and the like"
        )
    held = controller.aim.estimator
    missing = [name for name in (*held.measurements, "force") if name not in own.signals]
    if missing:
        raise InputError(f"estimator {controller.name}: {missing[0]} is not observed")
    scale = controller.aim.k / world.levels(task).force_max
    return replace(own, filter=_filter(*_scaled(held, scale, own)))


def with_ground(world: World, given: Any) -> World:
    """The world with an observer that has the states of a filter of frame and ground besides, or of several, one behind
    the other; given: see `mrdamp.train.worlds.Ground`, or a list of such. Raises InputError."""
    task = world.task(1)
    if not isinstance(task.structure, Frame):
        raise InputError("ground filter: it is for mrdamp/Frame-v0 only")
    observer = task.observer
    for ground in [Ground.of(one) for one in (given if isinstance(given, list) else [given])]:
        observer = ground.observed(observer, task.structure.frame, task.rows.period)
    return world.observing(observer)


def imitated(
    plant: RowPlant, controller: Controller, loads: Sequence[Any], observer: Observer, matrix: NDArray[np.float32],
    force_max: float,
) -> Array:  # fmt: skip
    """(inputs,) weights on whitened observations, by least squares on runs of the controller itself.

    The runs of all loads count alike, whatever their size. matrix: (inputs, observer.size). force_max: N, of an action
    of 1. Raises InputError for a controller without a wanted force.
    """
    if not isinstance(controller, ForceController):
        raise InputError(
            f"teacher {controller.name}: it has no wanted force; allowed: clipped-optimal and the like"
        )
    own = Observer.from_dict(observer.to_dict())
    inputs, wanted = [], []
    for load in loads:
        controller.reset()
        own.reset()
        y, command = plant.reset(load), 0.0
        observation, forces = [], []
        while not plant.finished:
            observation.append(own(y, command))
            command = controller.command(plant.time, y)
            forces.append(controller.wanted / force_max)
            y = plant.step(command)
        size = float(np.sqrt(np.mean(np.square(forces)))) or 1.0
        inputs.append(np.array(observation, dtype=np.float64) @ matrix.T / size)
        wanted.append(np.array(forces) / size)
    return np.asarray(np.linalg.lstsq(np.concatenate(inputs), np.concatenate(wanted), rcond=1e-8)[0])
