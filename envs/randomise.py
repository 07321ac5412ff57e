"""Parameters of structure, damper and sensors that are drawn anew for every episode."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from numbers import Real
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.envs.loads import Range
from mrdamp.errors import Diverged, InputError, nearest, require_kind
from mrdamp.model import Effect, Model, core
from mrdamp.model.core import Array
from mrdamp.model.damper import FLOOR_SENSOR_EFFECTS, STRUCTURE_EFFECTS, damper_effects
from mrdamp.simulation.rows import ChainRows, Each, require_finite
from mrdamp.structures import ShearFrame
from mrdamp.structures.cables import StayCable
from mrdamp.structures.lumped import QuarterCar

_STRUCTURES = (ShearFrame, StayCable, QuarterCar)


@dataclass(frozen=True)
class Randomise:
    """Ranges (low, high), evenly drawn from, by name. parts: the structure and the dampers that they are of.

    | name | what is drawn |
    |---|---|
    | `mass`, `stiffness`, `damping` of a frame, `tension` of a cable, `body` of a car ... | a factor on it |
    | a parameter of the damper's law, as `alpha_b` | a factor on it |
    | a parameter of an effect, as `driver_lag_tau` or `sensor_gain_g` | the value, SI |
    | one of a storey or a floor's sensor, as `storey_stiffness_e_1` or `sensor_lag_tau_3` | the value, SI |

    Raises InputError.
    """

    ranges: Mapping[str, Range]
    parts: tuple[Any, ...]

    def __post_init__(self) -> None:
        require_kind("ranges by name", Mapping, randomise=self.ranges)
        known = dict.fromkeys(name for part in self.parts for name in _factors(part))
        for name, span in self.ranges.items():
            pair = isinstance(span, tuple | list) and len(span) == 2
            ordered = pair and all(isinstance(x, int | float) for x in span) and span[0] <= span[1]
            if not ordered or not all(math.isfinite(x) for x in span):
                raise InputError(f"randomise: {name} is {span!r}; allowed: (low, high), two numbers")
            if name not in known and _effect(name) is None:
                more = f"{', '.join(known)}, and effects, as driver_lag_tau{nearest(name, known)}"
                raise InputError(f"randomise: {name!r} is unknown; allowed: {more}")
            if name in known and not span[0] > 0:
                raise InputError(f"randomise: {name} is {span!r}; allowed: factors > 0")
        for end in (0, 1):
            varied(self.parts, {name: span[end] for name, span in self.ranges.items()})

    def draw(self, rng: np.random.Generator, given: Mapping[str, float]) -> dict[str, float]:
        """A value of each name, evenly from its range, or as given. Raises InputError for a name without a range."""
        unknown = [name for name in given if name not in self.ranges]
        if unknown:
            raise InputError(f"reset: drawn: {unknown[0]!r} is not randomised; allowed: {', '.join(self.ranges)}")
        factors = _factors(self.parts)
        for name, value in given.items():
            if not isinstance(value, Real) or not math.isfinite(value) or (name in factors and value <= 0):
                allowed = "a factor > 0" if name in factors else "a number"
                raise InputError(f"reset: drawn: {name} is {value!r}; allowed: {allowed}")
        return {name: float(given.get(name, rng.uniform(*span))) for name, span in self.ranges.items()}

    def spread(self, rng: np.random.Generator, count: int) -> list[dict[str, float]]:
        """count draws that share every range evenly: one in each of count equal parts of it."""
        shares = {name: (rng.permutation(count) + rng.random(count)) / count for name in self.ranges}
        return [
            {name: low + (high - low) * float(shares[name][k]) for name, (low, high) in self.ranges.items()}
            for k in range(count)
        ]


def varied(part: Any, drawn: Mapping[str, float]) -> Any:
    """A structure or a damper with the drawn values; what is in a tuple one by one, anything else as it is."""
    if isinstance(part, tuple):
        return tuple(varied(each, drawn) for each in part)
    if isinstance(part, _STRUCTURES):
        return replace(part, **{name: getattr(part, name) * drawn[name] for name in _factors(part) if name in drawn})
    if not isinstance(part, Model):
        return part
    parameters = {name: value * drawn.get(name, 1.0) for name, value in part.parameters.items()}
    effects = {(e.name, e.place): dict(e.parameters) for e in part.effects}
    for name, value in drawn.items():
        found = _effect(name)
        if found is not None:
            effects.setdefault(found[::2], {})[found[1]] = value
    return replace(
        part,
        parameters=parameters,
        effects=tuple(Effect(name, values, place) for (name, place), values in effects.items()),
        structure=varied(part.structure, drawn),
    )


def _factors(part: Any) -> tuple[str, ...]:
    if isinstance(part, tuple):
        return tuple(name for each in part for name in _factors(each))
    if isinstance(part, Model):
        return (*part.parameters, *_factors(part.structure))
    if isinstance(part, _STRUCTURES):
        return tuple(f.name for f in fields(part) if f.type in ("float", "FloatArray"))
    return ()


def _effect(name: str) -> tuple[str, str, int | None] | None:
    """Effect, parameter and place of a name; None: it is none."""
    for row in core.attributes():
        if row.name == name and row.group in damper_effects():
            return row.group, name[len(row.group) + 1 :], None
    at = re.fullmatch(r"(.+)_(\d+)", name)
    if at:
        placed: Mapping[str, Mapping[str, str]] = {**STRUCTURE_EFFECTS, **FLOOR_SENSOR_EFFECTS}
        for effect, known in placed.items():
            for key in known:
                if at[1] == f"{effect}_{key}":
                    return effect, key, int(at[2])
    return None


class DrawnRows:
    """n rows, each with a structure and dampers of its own, made anew at every start; else as the rows they are of.

    like: a row as it is without draws. On the chain all are stepped in one call, in MuJoCo one after the other.
    """

    def __init__(self, like: Any, ranges: Mapping[str, Range], n: int) -> None:
        self.randomise = Randomise(ranges, tuple(like.structure.parts().values()))
        self._like, self._noise = like, np.zeros(len(like.names))
        self.names, self.period, self.command_max = like.names, like.period, like.command_max
        # What is the same in all rows, and the steps (n,) since each row's start.
        step, plants = np.zeros(n, dtype=np.int64), like.plants
        self.plants = SimpleNamespace(n=n, inner=plants.inner, timestep=plants.timestep, step=step)
        self.steps: NDArray[np.int64] = np.ones(n, dtype=np.int64)
        self.drawn: list[dict[str, float]] = [{} for _ in range(n)]
        self._rows = [self._made({}) for _ in range(n)]
        self._join()

    def _made(self, drawn: Mapping[str, float]) -> Any:
        row = type(self._like)(self._like.structure.varied(drawn), self._like.stepping)
        if self._noise.any():
            row.add_noise(self._noise)
        return row

    def _join(self, *some: int) -> None:
        """The counters of some rows, or all, and on the chain their results, are places in those of all."""
        if not some:
            on_chain = isinstance(self._like.plants, ChainRows)
            self._each = Each(self._like.plants, len(self._rows)) if on_chain else None
        for k in some or range(len(self._rows)):
            own = self._rows[k]
            for holder, name, whole in ((own, "steps", self.steps), (own.plants, "step", self.plants.step)):
                place = whole[k : k + 1]
                place[:] = getattr(holder, name)
                setattr(holder, name, place)
            if self._each is not None:
                self._each.join(k, own.plants)

    def __getstate__(self) -> dict[str, Any]:
        """For copies, whose arrays are no longer places in others."""
        return {name: value for name, value in vars(self).items() if name != "_each"}

    def __setstate__(self, held: dict[str, Any]) -> None:
        self.__dict__.update(held)
        self._join()

    def of(self, row: int) -> Any:
        """The row alone, number 0 of one."""
        return self._rows[row]

    def draw(self, row: int, rng: np.random.Generator, given: Mapping[str, float] | None) -> dict[str, float]:
        """What the row's next start is with; given: not drawn."""
        require_kind("numbers by name", Mapping, drawn=given)
        self.drawn[row] = self.randomise.draw(rng, given or {})
        self._rows[row] = self._made(self.drawn[row])
        self._join(row)
        return self.drawn[row]

    def add_noise(self, deviation: Array) -> bool:
        self._noise = deviation
        return all(row.add_noise(deviation) for row in self._rows)

    def seed(self, row: int, rng: np.random.Generator) -> None:
        self._rows[row].seed(0, rng)

    def start(self, row: int, load: Any) -> Array:
        return np.asarray(self._rows[row].start(0, load))

    def measure(self, rows: Sequence[int]) -> Array:
        return np.concatenate([self._rows[row].measure([0]) for row in rows])

    def advance(self, commands: Array) -> tuple[Array, Array]:
        if self._each is not None:
            self.plants.step += self.plants.inner
            period, values = require_finite(self._each.advance(commands))
            for k, row in enumerate(self._rows):
                row.seen(values[k : k + 1], None)
            return period, values
        found = []
        for k, row in enumerate(self._rows):
            try:
                found.append(row.advance_one(commands[k : k + 1]))
            except Diverged as error:
                error.row = k
                raise
        return np.array([period for period, _ in found]), np.array([values for _, values in found])

    def advance_one(self, commands: Array) -> tuple[list[float], list[float]]:
        return self._rows[0].advance_one(commands)  # type: ignore[no-any-return]

    def position(self, row: int) -> Array:
        return np.asarray(self._rows[row].position(0))

    def save(self, row: int) -> Any:
        return self.drawn[row], self._rows[row].save(0)

    def restore(self, row: int, state: Any) -> None:
        self.drawn[row], moment = state
        self._rows[row] = self._made(self.drawn[row])
        self._join(row)
        self._rows[row].restore(0, moment)
