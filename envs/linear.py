"""Structures of one's own, given by matrices, places and goals: all else follows from these.

The matrices are those of `mrdamp.structures.lumped.Mechanics`.
"""

from __future__ import annotations

import copyreg
import hashlib
import math
from abc import ABCMeta, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, make_dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from mrdamp.control import registry
from mrdamp.control.clipped_optimal import Lqg
from mrdamp.control.lqg import Linear, first_order_hold, outputs_of, plant_of
from mrdamp.envs.linear_rows import ByMatrices, LinearChain, LinearRows, forces_of
from mrdamp.envs.loads import MotionSource, drawn, played, whole
from mrdamp.envs.options import model_of
from mrdamp.envs.plants import periods
from mrdamp.envs.structure import Part, Total, Weights, largest_force, of_dampers
from mrdamp.envs.task import Task
from mrdamp.envs.training_loads import VALIDATION_SEED
from mrdamp.envs.view import View
from mrdamp.errors import InputError, require_kind, require_one_of, require_positive
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.outside import named
from mrdamp.simulation.mjcf import SIGNALS
from mrdamp.simulation.rows import finite
from mrdamp.structures.lumped import Mechanics

_LQG = {"r": 1e-2, "noise_ratio": 100.0}
_LEVEL = {"level": 1.0}


@dataclass(frozen=True)
class LinearSite(registry.AnySite):
    """Of a structure given by matrices. The goals are regulated, each over its scale; r: weight of the force squared,
    over the largest; noise_ratio: of the load over its scale to the measurements over theirs."""

    structure: LinearStructure
    damper: Model
    command_max: float
    force_max: float
    period: float = 5e-3

    options: ClassVar[Mapping[str, Mapping[str, float]]] = registry.regulators(_LQG, _LEVEL)

    @property
    def environment(self) -> str:  # type: ignore[override]
        """The name in `file.py:NAME`, or of the class."""
        kind = type(self.structure)
        return str(kind.__dict__.get("spec", kind.__name__)).rpartition(":")[2]

    @cached_property
    def _scale(self) -> Mapping[str, float]:
        return self.structure.sensors(np.array([self.command_max]), False)[1]

    @cached_property
    def linear(self) -> Linear:
        whole, first = self.structure, self.structure.first
        linear, s = plant_of(whole.system), whole.system
        strong = whole.strong / max(float(np.abs(s.loaded).max()), 1e-12)
        rows = partial(outputs_of, s, dict(zip(whole.places, whole.at, strict=True)), {})
        measured = (*(f"acceleration_{place}" for place in whole.places), "stroke")
        goals = {f"{goal.of}_{goal.place}": goal.weight for goal in whole.goals.values()}
        regulated = {name: weight / self._scale[name] ** 2 for name, weight in goals.items()}
        hooks: Any = ((whole.rod, 1.0),) if whole.rod else ()
        deviation = np.array([self._scale[name] for name in measured])
        mass = float(s.mass.trace())
        plant, dashpot = replace(linear, e=strong * linear.e), first * mass
        return Linear(plant, rows, measured, regulated, first, hooks, dashpot, deviation)

    def lqg(self, options: Mapping[str, float]) -> Lqg:
        weight = options.get("r", 1.0) / self.force_max**2
        return Lqg(regulate=self.linear.regulated, r=weight, noise_ratio=options["noise_ratio"])

    def ranges(self) -> Mapping[str, tuple[float, float]]:
        dashpot, first, force = self.linear.dashpot, self.linear.first, self.force_max
        return {
            "r": (1e-4, 10.0), "noise_ratio": (1.0, 1e5), "level": (0.1, 1.0), "force_max": (0.05 * force, 2.0 * force),
            "damping": (0.1 * dashpot, 50.0 * dashpot), "leak": (1.0 / first, 100.0 / first),
        }  # fmt: skip


_STEP = 1e-3  # s, of the run without the damper


@dataclass(frozen=True)
class Goal:
    """What is to be small: the RMS or the peak of the acceleration or displacement of a place, over that without the
    damper. weight: in the default reward, and in the score of tuning and training."""

    place: str
    of: Literal["acceleration", "displacement"]
    how: Literal["rms", "peak"] = "rms"
    weight: float = 1.0

    def __post_init__(self) -> None:
        require_one_of("goal", ("acceleration", "displacement"), of=self.of)
        require_one_of("goal", ("rms", "peak"), how=self.how)
        require_positive(f"goal of {self.place}", weight=self.weight)


class _Kind(ABCMeta):
    """Of structures of one's own: those of a file are pickled by their `spec`, `file.py:NAME`."""

    spec = ""

    def __call__(cls, *given: Any, **named: Any) -> Any:
        made = super().__call__(*given, **named)
        made.require()  # also behind a __post_init__ of its own
        return made


copyreg.pickle(_Kind, lambda kind: (own_kind, (kind.spec,)) if "spec" in kind.__dict__ else kind.__qualname__)


def own_kind(given: str | type[LinearStructure]) -> type[LinearStructure]:
    """A class, or that of `module:NAME` or `file.py:NAME`. Raises InputError."""
    found = named(given, "structure") if isinstance(given, str) else given
    if not (isinstance(found, type) and issubclass(found, LinearStructure)):
        raise InputError(f"structure {given}: it is no subclass of mrdamp.envs.LinearStructure")
    if isinstance(given, str):
        place, _, name = given.rpartition(":")
        found.spec = f"{Path(place).resolve() if place.endswith('.py') else place}:{name}"
    return found


def _rewarded(kind: type[LinearStructure], weights: Mapping[str, float]) -> Weights:
    return kind.weights(**weights)


@dataclass(frozen=True)
class LinearStructure(ByMatrices, metaclass=_Kind):
    """Base of a frozen dataclass with `mechanics`, and these: name; places: rows (n,) over the coordinates by name, of
    what is measured; goals: by name; strong: m/s2, an acceleration that scales of observations belong to; rod: the
    place at the damper's rod end, for skyhook control. Raises InputError.

    For a load other than a ground motion: option, `loads` and `forces`. model: of the damper, None: `damper()`.
    """

    model: Model | str | None = None

    places: ClassVar[Mapping[str, Sequence[float]]]
    goals: ClassVar[Mapping[str, Goal]]
    signals: ClassVar[tuple[str, ...]] = ()
    strong: ClassVar[float] = 1.0
    rod: ClassVar[str] = ""
    whole: ClassVar[float] = 0.0
    option, source, Source, drawn_size, cameras = "motion", "motions", MotionSource, 0.1, ("front",)
    more: ClassVar[tuple[str, ...]] = ("compression",)
    exponent: ClassVar[float] = 4.0

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)
        if cls.option != "motion" and "more" not in cls.__dict__:
            cls.more = ()
        cls.engines = {"mujoco": (LinearRows, 5e-4), "chain": (LinearChain, 1e-3)}
        if "goals" not in cls.__dict__:
            return
        require_kind("goals by name", Mapping, **{f"{cls.__name__}: goals": cls.goals or ()})
        require_kind("a Goal", Goal, **{f"{cls.__name__}: goal {name}": goal for name, goal in cls.goals.items()})
        rods = [cls.rod] if cls.rod else []
        unknown = [name for name in (*(goal.place for goal in cls.goals.values()), *rods) if name not in cls.places]
        if unknown:
            raise InputError(f"{cls.__name__}: no place {unknown[0]!r}; there are {', '.join(cls.places)}")
        parts, totals = of_dampers(4 * len(cls.places))
        own: list[Part] = []
        for k, (name, goal) in enumerate(cls.goals.items()):
            at, rms = cls.column(goal), goal.how == "rms"
            own.append(Part(name, at, k, 0.5) if rms else Part(name, at, k, rise=True, summed=True))
            size = Total(f"{goal.how}_{name}", at, goal.how, k)
            totals = (size, Total(f"{name}_ratio", at, goal.how, k, ratio=True), *totals)
        cls.typical = {}
        cls.weights = make_dataclass(
            f"{cls.__name__}Reward", [(name, float, field(default=goal.weight)) for name, goal in cls.goals.items()],
            bases=(Weights,), frozen=True, kw_only=True,
            namespace={
                "table": (*own, *parts), "totals": totals, "references": len(own),
                "__reduce__": lambda self: (_rewarded, (cls, vars(self))),
            },
        )  # fmt: skip

    def require(self) -> None:
        """Raises InputError for mechanics, places or a damper that are none."""
        own, needed = type(self).__name__, ("name", "places", "goals")
        missing = [name for name in needed if not hasattr(self, name)]
        if missing:
            raise InputError(f"{own}: no {missing[0]}; it needs {', '.join(needed)}")
        for what, found, kind in (("mechanics", self.system, Mechanics), ("damper", self.models[0], Model)):
            if not isinstance(found, kind):
                raise InputError(f"{own}: {what}() gives a {type(found).__name__}; allowed: a {kind.__name__}")
        require_positive(own, strong=self.strong)
        for place, row in self.places.items():
            finite(f"{own}: place {place}", [row], (1, len(self.system.stroke)))

    @classmethod
    def column(cls, goal: Goal) -> int:
        """Of a period's results: mean squares and peaks of accelerations, then of displacements, a place each."""
        block = 2 * (goal.of == "displacement") + (goal.how == "peak")
        return block * len(cls.places) + list(cls.places).index(goal.place)

    @abstractmethod
    def mechanics(self) -> Mechanics:
        """The structure without its damper."""

    @abstractmethod
    def damper(self) -> Model:
        """The damper by default."""

    def forces(self, load: Any) -> Array:
        """(samples, k) of a load every `load.sample_time`, straight between; loads have a name, a duration and
        `scaled(factor)` too."""
        return np.asarray(load.acceleration[:, None])

    @cached_property
    def identity(self) -> str:
        """16 hexadecimal digits, of mechanics and places."""
        s = self.system
        matrices = [[f"{x:.9g}" for x in m.flat] for m in (s.mass, s.damping, s.stiffness, s.stroke, s.load, self.at)]
        return hashlib.sha256(repr((matrices, list(self.places), s.absolute)).encode()).hexdigest()[:16]

    @cached_property
    def system(self) -> Mechanics:
        return self.mechanics()

    @cached_property
    def at(self) -> Array:
        """(places, n)."""
        return np.array([np.asarray(row, dtype=np.float64) for row in self.places.values()])

    @cached_property
    def models(self) -> tuple[Model, ...]:
        return (model_of(self.model, self.damper),)

    def parts(self) -> dict[str, Any]:
        return {**super().parts(), "model": self.models[0]}

    @property
    def names(self) -> tuple[str, ...]:
        whats = ("acceleration", "displacement", "velocity")
        return (*(f"{what}_{place}" for what in whats for place in self.places), *SIGNALS[:-1])

    @property
    def first(self) -> float:
        return float(self.system.frequencies[0])

    def view(self, task: Task, camera: str, size: tuple[int, int]) -> View:
        return View(self.mjcf(1e-3, drawn=True), "frame3", camera, size)

    def sensors(self, command_max: Array, full_state: bool) -> tuple[list[str], dict[str, float]]:
        """Accelerations of all places, stroke and force; full_state: displacements and velocities, and the current."""
        w, strong = self.first, self.strong
        sizes = {"acceleration": strong, "displacement": strong / w**2, "velocity": strong / w}
        scale = {f"{what}_{place}": size for what, size in sizes.items() for place in self.places}
        largest = float(command_max[0])
        force = largest_force(self.models[0], strong / w**2, w, largest)
        scale |= {
            "stroke": strong / w**2, "stroke_velocity": strong / w, "current": largest, "force": force,
            "true_force": force,
        }  # fmt: skip
        whats = ("displacement", "velocity") if full_state else ("acceleration",)
        default = [f"{what}_{place}" for what in whats for place in self.places]
        return [*(self.signals or default), *(["current"] if full_state else []), "stroke", "force"], scale

    @classmethod
    def criteria(cls, **scored: float) -> Mapping[str, float]:
        return {f"{name}_ratio": goal.weight for name, goal in cls.goals.items()}

    def some(self, rng: np.random.Generator, count: int, spread: float = 0.0) -> list[Any]:
        source = self.training()
        return [drawn(source, rng) for _ in range(count)]

    def validation(self) -> list[Any]:
        return self.some(np.random.default_rng([VALIDATION_SEED, 4]), 6)

    def load(self, rng: np.random.Generator, source: Any, options: Mapping[str, Any]) -> Any:
        given, compression = options.get(self.option), options.get("compression")
        if given is None:
            return drawn(source, rng)
        return whole(given, f"{self.option} is") if self.option != "motion" else played(given, compression)

    def reference(self, given: Array, load: Any, task: Task) -> Array:
        return self.uncontrolled(load, task.rows.period)

    def uncontrolled(self, load: Any, period: float = 0.0) -> Array:
        """(goals,) mean squares or peaks without the damper, over the control periods (s) of a run, the last of which
        holds the load's last value. Raises InputError where nothing moves."""
        s, given, n = self.system, forces_of(self, load), len(self.system.stroke)
        inner = max(1, math.ceil(load.sample_time / _STEP - 1e-9))
        until = periods(load.duration, period) * period if period else load.duration
        at = np.arange(math.ceil(until / load.sample_time * inner - 1e-6) + 1) / inner
        w = np.stack([np.interp(at, np.arange(len(given)), column) for column in given.T], axis=1)
        plant = plant_of(s)
        phi, held, ramp = first_order_hold(plant.a, plant.e, load.sample_time / inner)
        state, push = np.zeros((len(w), 2 * n)), w[:-1] @ held.T + w[1:] @ ramp.T
        for k in range(len(push)):
            state[k + 1] = phi @ state[k] + push[k]
        acceleration = state @ s.rate.T + w[:, s.grounds :] @ s.loaded[:, s.grounds :].T
        moved = {"acceleration": acceleration @ self.at.T, "displacement": state[:, :n] @ self.at.T}
        places = list(self.places)
        columns = [(goal, moved[goal.of][:, places.index(goal.place)]) for goal in self.goals.values()]
        found = np.array(
            [np.trapezoid(x * x) / (len(x) - 1) if goal.how == "rms" else np.abs(x).max() for goal, x in columns]
        )
        if not (found > 0).all():
            raise InputError(f"{load.name}: the load moves nothing; there is nothing to control")
        return found

    def told(self, load: Any, reference: Sequence[float] | Array) -> dict[str, Any]:
        sizes = (math.sqrt(x) if g.how == "rms" else x for g, x in zip(self.goals.values(), reference, strict=True))
        found = {f"reference_{name}": float(x) for name, x in zip(self.goals, sizes, strict=True)}
        return found | ({"speed": load.speed} if hasattr(load, "speed") else {})

    def reference_motion(self, values: Array) -> float:
        """m, of the first displacement among the goals, or of the first goal's acceleration at the first frequency."""
        for k, goal in enumerate(self.goals.values()):
            if goal.of == "displacement":
                return float(values[k] if goal.how == "peak" else math.sqrt(values[k]))
        goal = next(iter(self.goals.values()))
        return float(values[0] if goal.how == "peak" else math.sqrt(values[0])) / self.first**2

    def site(self, command_max: float, period: float, force_max: float | None = None) -> LinearSite:
        force = registry.largest_force(self.models[0], command_max) if force_max is None else force_max
        return LinearSite(self, self.models[0], command_max, force, period)
