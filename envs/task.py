"""Task of an environment for n rows at once: loads, commands, observations and rewards.

A single environment is a task of one row; a vector environment is a task of many. The arithmetic of a row does not
depend on how many there are.
"""

from __future__ import annotations

import hashlib
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from mrdamp.control.observe import Observation, Observer, Stack
from mrdamp.envs.sensors import Noise
from mrdamp.errors import InputError, require_positive
from mrdamp.simulation.rows import finite

Array = NDArray[np.float64]
Kept = TypeVar("Kept")


class Rows(Protocol):
    """n structures with their sensors; the results of `advance` are the input of their score."""

    names: tuple[str, ...]
    plants: Any  # as `Plants`
    steps: NDArray[np.int64]
    period: float

    def measure(self, rows: Sequence[int]) -> Array: ...

    def advance(self, commands: Array) -> tuple[Array, Array]: ...

    def advance_one(self, commands: Array) -> tuple[list[float], list[float]]: ...

    def save(self, row: int) -> Any: ...

    def restore(self, row: int, state: Any) -> None: ...

    def position(self, row: int) -> Array: ...

    def add_noise(self, deviation: Array) -> bool: ...

    def seed(self, row: int, rng: np.random.Generator) -> None: ...

    def of(self, row: int) -> Any: ...

    def draw(self, row: int, rng: np.random.Generator, given: Any) -> Mapping[str, float]: ...

    def start(self, row: int, load: Any) -> Array: ...


class RowScore(Protocol):
    """Rewards of n rows; values (n, ...) are its whole state; NAMES of the columns of `info`."""

    NAMES: tuple[str, ...]
    values: Array

    def start(self, row: int, reference: Any, periods: int) -> None: ...

    def of(self, period: Array) -> tuple[Array, Array]: ...

    def of_one(self, period: Sequence[float]) -> tuple[float, dict[str, float]]: ...


@dataclass(frozen=True)
class Episode:
    """State of a row, without the random generator of noise and of the next load."""

    rows: Any
    score: Array
    past: Array
    command: Array
    measured: Array


@dataclass(frozen=True)
class Step:
    """Of n rows: observations (n, size), rewards (n,), whether the load is over (n,), and `info` (n, names)."""

    observation: Observation
    reward: Array
    over: NDArray[np.bool_]
    info: Array


_KEPT = 256  # references of loads


class References(Generic[Kept]):
    """Reference responses of loads without a damper; each is computed once and shared by rows of a structure with the
    same load."""

    def __init__(self) -> None:
        self._kept: dict[bytes, Kept] = {}

    def of(self, load: Array, drawn: Mapping[str, float], found: Callable[[], Kept]) -> Kept:
        """Result of `found` for a load and what was drawn of the structure, from the cache if it is recent."""
        key = hashlib.blake2b(load.tobytes() + repr(drawn).encode(), digest_size=16).digest()
        if key not in self._kept:
            if len(self._kept) >= _KEPT:
                self._kept.clear()
            self._kept[key] = found()
        return self._kept[key]


def check_options(options: Mapping[str, Any], *allowed: str) -> float:
    """The amplitude among the options of `reset`. Raises InputError for an unknown one, or no number > 0."""
    allowed = (*allowed, "amplitude")
    unknown = sorted(set(options) - set(allowed))
    if unknown:
        raise InputError(f"reset: option {unknown[0]!r} is unknown; allowed: {', '.join(allowed)}")
    numbers = {name: options[name] for name in ("amplitude", "speed", "compression") if name in options}
    require_positive("reset", **numbers)
    return float(options.get("amplitude", 1.0))


class Task(ABC):
    """n rows of a structure under control.

    rows: the structures; score: their rewards; observer: of the observations; command_max: (m,) A or V; noise: on the
    measurements, see `Noise`. Attributes: observation_space and action_space of one row; happened: (n, ...),
    results of the rows for the last control period.
    """

    def __init__(
        self,
        rows: Rows,
        score: RowScore,
        observer: Observer,
        command_max: Array,
        noise: Mapping[str, float] | None,
    ) -> None:
        self.rows, self.score, self.observer = rows, score, observer
        self.n, self.command_max = rows.plants.n, command_max
        self.noise = Noise(noise or {}, rows.names)
        # If the rows add it themselves, its seed is drawn at every start.
        self._own_noise = bool(self.noise.where) and rows.add_noise(self.noise.all)
        if self._own_noise:
            self.noise = Noise({}, rows.names)
        unknown = [name for name in observer.signals if name not in rows.names]
        if unknown:
            raise InputError(f"observer: no measurement {unknown[0]!r}; there are: {', '.join(rows.names)}")
        if len(observer.command_max) != len(command_max):
            raise InputError(f"observer: {len(observer.command_max)} commands for {len(command_max)} dampers")
        self._observed = np.array([rows.names.index(name) for name in observer.signals], dtype=np.intp)
        # As plain numbers, for `step_one`.
        self._columns: list[int] = self._observed.tolist()
        self._largest: list[float] = command_max.tolist()
        self._currents = [k for k, name in enumerate(rows.names) if re.fullmatch(r"current(_\d+)?", name)]
        self._measured: Array = np.zeros((self.n, len(rows.names)))
        self.happened: Array = np.zeros((self.n, 0))
        self._stack = Stack(observer, self.n)
        self._command: Array = np.zeros((self.n, len(command_max)))
        self._rngs: list[np.random.Generator | None] = [None] * self.n
        self._references = References[Any]()
        self.observation_space = Box(-observer.limit, observer.limit, (observer.size,), np.float32)
        self.action_space = Box(-1.0, 1.0, (len(command_max),), np.float32)

    @property
    def measured(self) -> Array:
        """(n, names) last sensor readings, in the order of `rows.names`."""
        return self._measured

    #: Rendered size (m) of the motion without a damper.
    drawn_size: float

    @abstractmethod
    def reference_motion(self, row: int) -> float:
        """Size (m) of the row's motion without a damper."""

    def current_shares(self, row: int) -> list[float]:
        """Of each damper's current in its largest, now."""
        return (self._measured[row, self._currents] / self.command_max).tolist()  # type: ignore[no-any-return]

    @abstractmethod
    def begin(
        self, row: int, rng: np.random.Generator, options: Mapping[str, Any], drawn: Mapping[str, float]
    ) -> dict[str, Any]:
        """Draws the row's load and sets its structure, with what was drawn of it, and score to their start; returns its
        entries of `info`."""

    def commands(self, actions: Any) -> Array:
        """(n, m) commands from actions (n, m) in [-1, 1]; clipped to the range. Raises InputError."""
        share = 0.5 * (finite("action", actions, (self.n, len(self.command_max))) + 1.0)
        return np.asarray(np.minimum(np.maximum(share, 0.0), 1.0) * self.command_max)

    def reset(
        self,
        rows: Sequence[int],
        rngs: Sequence[np.random.Generator],
        options: Mapping[str, Any] | None = None,
    ) -> tuple[Observation, list[dict[str, Any]]]:
        """Starts rows anew: observations (rows, size) and one info each. rngs: a generator for each of all n rows."""
        given = dict(options or {})
        fixed, infos = given.pop("drawn", None), []
        for row in rows:
            drawn = self.rows.draw(row, rngs[row], fixed)
            if self._own_noise:
                self.rows.seed(row, rngs[row])
            infos.append(self.begin(row, rngs[row], given, drawn) | ({"drawn": dict(drawn)} if drawn else {}))
        values = self.rows.measure(rows)
        for k, row in enumerate(rows):
            self.noise.add(values, k, rngs[row])
            self._rngs[row] = rngs[row]
            self._command[row] = 0.0
        self._measured[list(rows)] = values
        observation = self._stack.restart(rows, values[:, self._observed], self._command[list(rows)])
        return observation, infos

    def step(self, actions: Any, quiet: Sequence[int] = ()) -> Step:
        """One control period of all rows. quiet: rows that draw no noise, as they are about to be reset."""
        self._command = self.commands(actions)
        period, values = self.rows.advance(self._command)
        self.happened = period
        reward, info = self.score.of(period)
        self.check(np.add.reduce(reward))
        if self.noise.where:
            for row, rng in enumerate(self._rngs):
                if rng is not None and row not in quiet:
                    self.noise.add(values, row, rng)
        self._measured = values
        observation = self._stack.push(values[:, self._observed], self._command)
        return Step(observation, reward, self.rows.plants.step >= self.rows.steps * self.rows.plants.inner, info)

    def check(self, reward: float) -> None:
        """Raises InputError if a reward is NaN: the simulation has diverged."""
        if not math.isfinite(reward):
            raise InputError("the simulation diverged; check the structure, the damper and the load's unit")

    def step_one(self, action: Any) -> tuple[Observation, float, bool, dict[str, float]]:
        """`step` for a single row in plain numbers, bit-identical: arrays of one row cost more than the engine.

        Its observation (size,), reward, whether the load is over, and `info`.
        """
        array = np.asarray(action)
        given = array.reshape(-1).tolist()
        if array.dtype.kind != "f" or len(given) != len(self._largest) or not math.isfinite(sum(given)):
            given = finite("action", action, (1, len(self._largest)))[0].tolist()
        shares = [0.5 * (a + 1.0) for a in given]
        commands = [
            m * (s if 0.0 <= s <= 1.0 else 1.0 if s > 1.0 else 0.0 if s < 0.0 else s)
            for s, m in zip(shares, self._largest, strict=True)
        ]
        self._command = np.array([commands])
        rows = self.rows
        period, values = rows.advance_one(self._command)
        reward, info = self.score.of_one(period)
        self.check(reward)
        self._measured = measured = np.array([values])
        if self.noise.where and self._rngs[0] is not None:
            self.noise.add(measured, 0, self._rngs[0])
            values = measured[0].tolist()
        observation = self._stack.push_one([values[k] for k in self._columns], commands)
        plants = rows.plants
        return observation, reward, bool(plants.step[0] >= rows.steps[0] * plants.inner), info

    def save(self, row: int) -> Episode:
        """The row's state."""
        return Episode(
            self.rows.save(row),
            self.score.values[row].copy(),
            self._stack.past[row].copy(),
            self._command[row].copy(),
            self._measured[row].copy(),
        )

    def restore(self, row: int, episode: Episode, rng: np.random.Generator) -> None:
        """Restores a saved state exactly; rng: where noise comes from."""
        self.rows.restore(row, episode.rows)
        self.score.values[row] = episode.score
        self._stack.past[row] = episode.past
        self._command[row] = episode.command
        self._measured[row] = episode.measured
        self._rngs[row] = rng
