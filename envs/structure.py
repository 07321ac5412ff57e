"""What a structure says of itself; rows, tasks, environments, vector environments and plants follow from it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from mrdamp.envs.randomise import varied
from mrdamp.envs.weights import Weights
from mrdamp.model import Model, core
from mrdamp.model.core import Array

if TYPE_CHECKING:
    from mrdamp.control.registry import AnySite
    from mrdamp.envs.plants import EngineRows
    from mrdamp.envs.task import Task
    from mrdamp.envs.view import View


class Structure(ABC):
    """A structure with its dampers, a dataclass whose fields are arguments of its environment.

    name: in the commands, as `frame`. option: of a reset, that names the load; more: its other options. source: the
    environment's argument for the loads' source, of the type `Source`. weights: of the reward. engines: by engine, the
    rows and their default largest step (s). typical: RMS of signals over their scales, see `TaskOptions.observes`.
    drawn_size: rendered size (m) of the motion without a damper. cameras: of the drawing, the default first.

    Of training: scored: options of `criteria` with their defaults, from 0 to 1; exponent: of the criteria's norm over
    time, unless the hyperparameters say otherwise; searched, trained: s, the step at least of rows on the chain where a
    search runs them, and of others.
    """

    name: ClassVar[str]
    option: ClassVar[str] = "load"
    more: ClassVar[tuple[str, ...]] = ()
    source: ClassVar[str] = "loads"
    Source: ClassVar[type]
    weights: ClassVar[type[Weights]]
    engines: ClassVar[Mapping[str, tuple[type[EngineRows], float]]]
    typical: ClassVar[Mapping[str, float]]
    drawn_size: ClassVar[float]
    cameras: ClassVar[tuple[str, ...]] = ("corner", "front", "damper")
    scored: ClassVar[Mapping[str, float]] = {}
    exponent: ClassVar[float] = 2.0
    searched: ClassVar[float] = 0.0
    trained: ClassVar[float] = 0.0

    @property
    @abstractmethod
    def models(self) -> tuple[Model, ...]:
        """Of the dampers."""

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Of the measurements."""

    @property
    @abstractmethod
    def load_names(self) -> Sequence[str]:
        """Actuators of the loads in the MJCF."""

    @abstractmethod
    def mjcf(self, timestep: float, *, drawn: bool = False) -> str:
        """MJCF text; drawn: with visual elements."""

    @abstractmethod
    def sensors(self, command_max: Array, full_state: bool) -> tuple[Sequence[str], dict[str, float]]:
        """Signals that are observed, with `full_state` other ones, and the scale (SI) of every measurement."""

    @property
    @abstractmethod
    def first(self) -> float:
        """rad/s, of the motion that forces of the damper are told by."""

    @classmethod
    @abstractmethod
    def criteria(cls, **scored: float) -> Mapping[str, float]:
        """What the score of a policy is made of, with the options `scored`: measures, fields of `info`, and weights."""

    @abstractmethod
    def loads(self) -> Any:
        """The source of the loads by default."""

    def training(self) -> Any:
        """The source of the loads of a training."""
        return self.loads()

    @abstractmethod
    def some(self, rng: np.random.Generator, count: int, spread: float = 0.0) -> list[Any]:
        """Loads for searches that run every candidate under all of them. spread: by which share durations may be longer
        or shorter: rows that start together must not stay in step, or a batch of them is all calm or all strong."""

    @abstractmethod
    def validation(self) -> Sequence[Any]:
        """Loads that policies are evaluated by while they are trained, and that controllers are tuned on."""

    @abstractmethod
    def site(self, command_max: float, period: float, force_max: float | None = None) -> AnySite:
        """What controllers are made for. force_max: N, of the damper at the largest command, None: in a slow motion."""

    @abstractmethod
    def load(self, rng: np.random.Generator, source: Any, options: Mapping[str, Any]) -> Any:
        """A load from its source, or of the options of a reset. Raises InputError."""

    @abstractmethod
    def forces(self, load: Any) -> Array:
        """(samples, k) of a load over its duration: N, m/s2 of the ground, or m of a road."""

    @property
    def identity(self) -> str:
        """Of a structure of one's own: what a policy's file says that it was trained on."""
        return ""

    @abstractmethod
    def reference(
        self, given: Array, load: Any, timestep: float, weights: Any, command_max: float, period: float
    ) -> Sequence[float] | Array:
        """What the reward is relative to. given: of `EngineRows.start`; timestep: of the rows, period: of control, s.
        Raises InputError."""

    @abstractmethod
    def told(self, load: Any, reference: Sequence[float] | Array) -> dict[str, Any]:
        """Of a reset's `info`."""

    @abstractmethod
    def reference_motion(self, values: Array) -> float:
        """Size (m) of the motion without a damper, from a row of `Score.values`."""

    @abstractmethod
    def view(self, task: Task, camera: str, size: tuple[int, int]) -> View:
        """The drawing of a task's first row."""

    def reward(self, given: Any) -> Any:
        """Weights as they are given. Raises InputError."""
        return self.weights.of(given)

    def in_full(self) -> Self:
        """The same with what `full_state` needs to be measured."""
        return self

    def parts(self) -> dict[str, Any]:
        """Arguments whose parameters may be drawn."""
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]

    def varied(self, drawn: Mapping[str, float]) -> Self:
        """The same with drawn values, see `mrdamp.envs.randomise`."""
        return replace(self, **{name: varied(part, drawn) for name, part in self.parts().items()})  # type: ignore[type-var]


def largest_force(model: Model, stroke: float, w: float, command: float) -> float:
    """N, of the damper moved by a sine of `stroke` (m) and w (rad/s) at a command."""
    t = np.linspace(0.0, 4 * math.pi / w, 801)
    x, v = stroke * np.sin(w * t), stroke * w * np.cos(w * t)
    out = core.run(model.law, model.attributes, float(t[1]), x, v, u=command, narx=model.narx)
    largest = float(np.abs(out["force"]).max())
    return largest if largest > 0 else 1.0
