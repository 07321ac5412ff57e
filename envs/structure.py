"""What a structure says of itself, from which rows, tasks, environments, vector environments and plants follow; and
rewards: weights of their parts, how they come from names and values, and their sums over an episode."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from numbers import Real
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray

from mrdamp.control.base import sensor_name
from mrdamp.control.force_levels import sine_forces
from mrdamp.envs.randomise import varied
from mrdamp.errors import InputError, require_kind
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.mjcf import SIGNALS

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
    def reference(self, given: Array, load: Any, task: Task) -> Sequence[float] | Array:
        """What the reward of a task is relative to. given: of `EngineRows.start`. Raises InputError."""

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


def floor_names(storeys: int, dampers: int) -> tuple[str, ...]:
    """Measurements of a frame: those of every floor or storey, then those of every damper."""
    whats, floors = ("acceleration", "displacement", "velocity", "drift"), range(1, storeys + 1)
    own = (sensor_name(signal, k) for signal in SIGNALS[:-1] for k in range(dampers))
    return (*(f"{what}_{j}" for what in whats for j in floors), *own)


def largest_force(model: Model, stroke: float, w: float, command: float) -> float:
    """N, of the damper moved by a sine of `stroke` (m) and w (rad/s) at a command."""
    largest = float(sine_forces(model, stroke, w, command).max())
    return largest if largest > 0 else 1.0


_UNIT = 100.0  # of returns


@dataclass(frozen=True)
class Part:
    """A part of a reward. name: of its weight; column: of the results of a control period.

    over: which number of the reference it is divided by. power: the ratio to the power of that times the exponent;
    1/2 of a mean square. rise: only what it is above its largest so far; summed: a sum over the episode, not a mean.
    """

    name: str
    column: int
    over: int | None = None
    power: float = 0.0
    rise: bool = False
    summed: bool = False


@dataclass(frozen=True)
class Total:
    """A field of `info` about the row's start until now. column, over: as of a `Part`.

    how: `peak`, the largest; `mean` or `rms` over time, the latter of mean squares; `sum`. ratio: over the reference's.
    """

    name: str
    column: int
    how: Literal["peak", "mean", "rms", "sum"]
    over: int | None = None
    ratio: bool = False


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Base of weights, one a part and each at least 0, with an exponent above 0 to 20.

    A part is worth 100 times its weight times its mean over the episode, or its sum where it is `summed`: the
    structure that criteria are relative to has a return of -100 with weights of 1 in all, however long the load is.

    table: the parts, whose names are fields; each is in `info` as `reward_` and its name, and their sum is the reward.
    totals: the other fields of `info`. references: how many numbers the reference has.
    """

    current: float = 0.0
    power: float = 0.0
    exponent: float = 2.0

    table: ClassVar[tuple[Part, ...]]
    totals: ClassVar[tuple[Total, ...]]
    references: ClassVar[int] = 3

    def __post_init__(self) -> None:
        for part in (each.name for each in self.table):
            value: float = getattr(self, part)
            if not (isinstance(value, Real) and 0 <= value < math.inf):
                raise InputError(f"reward: weight {part} is {value!r}; allowed: a number >= 0")
        if not (isinstance(self.exponent, Real) and 0 < self.exponent <= 20):
            raise InputError(f"reward: exponent is {self.exponent!r}; allowed: above 0 to 20")

    @property
    def signed(self) -> NDArray[np.float64]:
        """(parts,) sign and weight of each part: energy is a gain, all others are costs."""
        return np.array([(_UNIT if p.name == "energy" else -_UNIT) * getattr(self, p.name) for p in self.table])

    @classmethod
    def of(cls, given: Self | Mapping[str, Any] | None) -> Self:
        """Weights as they are given, from names and values, or the default. Raises InputError."""
        require_kind(f"a {cls.__name__}, or numbers by name", (cls, Mapping), reward=given)
        if isinstance(given, cls):
            return given
        known, data = {f.name for f in fields(cls)}, dict(given or {})  # type: ignore[arg-type]
        for name in data:
            if name not in known:
                raise InputError(f"reward: {name!r} is unknown; allowed: {', '.join(sorted(known))}")
        return replace(cls(), **data)


#: Results of a control period that every structure has last: means over dampers and time of the current's size over the
#: largest command, of its square, and of its size in A or V; energy taken in by the dampers, J.
OF_DAMPERS = ("share", "power", "current", "energy")


def of_dampers(first: int, energy: int | None = None) -> tuple[tuple[Part, ...], tuple[Total, ...]]:
    """The parts and totals of the dampers, whose results begin at column `first`; energy: its reference's number."""
    parts = [Part("current", first), Part("power", first + 1)]
    if energy is not None:
        parts.append(Part("energy", first + 3, energy, summed=True))
    totals = Total("mean_power", first + 1, "mean"), Total("mean_current", first + 2, "mean")
    return tuple(parts), (*totals, Total("dissipated_energy", first + 3, "sum"))


class Score:
    """Rewards of n rows, and their totals since each row's start.

    values (n, ...) are its whole state, a view of columns: the reference; the sums and peaks so far, peaks over the
    reference's where there is one; periods so far, and of the load. NAMES: columns of `info`, the parts of the reward
    first.
    """

    def __init__(self, weights: Weights, n: int) -> None:
        self.weights = weights
        self.NAMES = (*(f"reward_{part.name}" for part in weights.table), *(total.name for total in weights.totals))
        self._first = weights.references
        kept = dict.fromkeys((t.column, t.over if t.how == "peak" else None, t.how == "peak") for t in weights.totals)
        self._kept = {key: self._first + k for k, key in enumerate(kept)}
        self.values = np.ones((self._first + len(kept) + 2, n)).T
        self._signs: list[float] = weights.signed.tolist()
        self._parts = np.zeros(len(self._signs))

    def start(self, row: int, reference: Sequence[float] | NDArray[np.float64], periods: int) -> None:
        """Starts a row. reference: of its reward; periods: of control, that the load lasts."""
        self.values[row] = 0.0
        self.values[row, : self._first] = reference
        self.values[row, -1] = periods

    def _run(self, period: Any, v: Any, larger: Any, root: Any) -> tuple[list[Any], list[Any]]:
        """Parts and totals from columns of results and of `values`, which move on; of numbers as of arrays (n,)."""
        parts, totals = [], []
        for part, sign in zip(self.weights.table, self._signs, strict=True):
            x = period[part.column] if part.over is None else period[part.column] / v[part.over]
            if part.rise:
                x = larger(x - v[self._kept[part.column, part.over, True]], 0.0)
            elif part.power:
                power = part.power * self.weights.exponent
                x = x if power == 1.0 else x * x if power == 2.0 else np.power(x, power)
            parts.append(x * (sign if part.summed else sign / v[-1]))
        for (column, over, peak), at in self._kept.items():
            x = period[column] if over is None else period[column] / v[over]
            v[at] = larger(v[at], x) if peak else v[at] + x
        v[-2] = v[-2] + 1.0
        for t in self.weights.totals:
            peak = t.how == "peak"
            x = v[self._kept[t.column, t.over if peak else None, peak]]
            if peak:
                x = x if t.ratio or t.over is None else x * v[t.over]
            elif t.how != "sum":
                x = x / v[-2]
            if t.how == "rms":
                x = root(x) / root(v[t.over]) if t.ratio else root(x)
            totals.append(x)
        return parts, totals

    def of(self, period: Array) -> tuple[Array, Array]:
        """Rewards (n,) of a control period from its results (n, columns), and the columns of `info`, (n, names)."""
        columns = self.values.T
        values = list(columns)
        parts, totals = self._run(np.ascontiguousarray(period.T), values, np.maximum, np.sqrt)
        columns[self._first :] = values[self._first :]
        info = np.array([*parts, *totals])
        return np.add.reduce(info[: len(parts)], axis=0), info.T

    def of_one(self, period: Sequence[float]) -> tuple[float, dict[str, float]]:
        """`of` a single row in plain numbers, bit-identical, and its `info` by name."""
        values = self.values[0].tolist()
        parts, totals = self._run(period, values, max, math.sqrt)
        self.values[0] = values
        self._parts[:] = parts
        return float(np.add.reduce(self._parts)), dict(zip(self.NAMES, (*self._parts.tolist(), *totals), strict=True))
