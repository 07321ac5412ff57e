"""Task of an environment for n rows at once: loads, commands, observations and rewards.

A single environment is a task of one row; a vector environment is a task of many. The arithmetic of a row does not
depend on how many there are.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from numpy.typing import NDArray

from mrdamp.control.observe import Observation, Stack
from mrdamp.envs.options import Noise, TaskOptions
from mrdamp.envs.structure import Score, Structure
from mrdamp.errors import Diverged, InputError, diverged, nearest, require_kind, require_positive
from mrdamp.model.core import Array
from mrdamp.simulation.rows import finite


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


def check_options(options: Mapping[str, Any], *allowed: str) -> float:
    """The amplitude among the options of `reset`. Raises InputError for an unknown one, or no number > 0."""
    allowed = (*allowed, "amplitude")
    unknown = sorted(set(options) - set(allowed))
    if unknown:
        raise InputError(f"reset: option {unknown[0]!r} is unknown; allowed: {', '.join(allowed)}")
    if "compression" in options and options.get("motion") is None:
        raise InputError("reset: compression is that of a motion that is given; give one, or leave it out")
    numbers = {name: options[name] for name in ("amplitude", "speed", "compression") if name in options}
    require_positive("reset", **numbers)
    return float(options.get("amplitude", 1.0))


class Task:
    """n rows of a structure under control.

    loads: their source, None: the structure's default; reward: weights, see `Structure.weights`; options: of
    `TaskOptions`. Attributes: structure; rows; score; observer; command_max (m,) A or V; observation_space and
    action_space of one row; measured: (n, names) last sensor readings, in the order of `rows.names`; happened:
    (n, ...), results of the rows for the last control period. Raises InputError.
    """

    def __init__(
        self, structure: Structure, n: int = 1, *, loads: Any = None, reward: Any = None, **options: Any
    ) -> None:
        given = TaskOptions(**options)
        require_kind(f"a source of {structure.source}", structure.Source, **{structure.source: loads})
        self.structure = structure.in_full() if given.full_state else structure
        rows: Any = given.rows(self.structure, n)
        self.loads = structure.loads() if loads is None else loads
        self.weights = structure.reward(reward)
        self.command_max = command_max = rows.command_max
        observer = given.observes(self.structure, command_max)
        self.rows, self.score, self.observer, self.n = rows, Score(self.weights, n), observer, n
        self.noise = Noise(given.noise or {}, rows.names)
        self.disturbed = given.noise, given.randomise
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
        self.measured: Array = np.zeros((self.n, len(rows.names)))
        self.happened: Array = np.zeros((self.n, 0))
        self._stack = Stack(observer, self.n)
        self._command: Array = np.zeros((self.n, len(command_max)))
        self._rngs: list[np.random.Generator | None] = [None] * self.n
        self._under = [""] * self.n  # load and amplitude, for messages
        # By load and what was drawn of the structure; each is computed once for the rows that share them.
        self._references: dict[bytes, Sequence[float] | Array] = {}
        self.observation_space = Box(-observer.limit, observer.limit, (observer.size,), np.float32)
        self.action_space = Box(-1.0, 1.0, (len(command_max),), np.float32)

    @property
    def over(self) -> NDArray[np.bool_]:
        """(n,) whether the load of each row is."""
        return np.asarray(self.rows.plants.step >= self.rows.steps * self.rows.plants.inner)

    def require_begun(self, *, running: bool = True) -> None:
        """Raises Gymnasium's `ResetNeeded` where a row has no episode, or (running) one that is over."""
        if None in self._rngs:
            raise ResetNeeded("step: no episode has begun; call reset")
        if running and self.over.any():
            rows = f" in rows {np.flatnonzero(self.over).tolist()}" if self.n > 1 else ""
            raise ResetNeeded(f"step: the episode is over{rows}; call reset")

    def begin(
        self, row: int, rng: np.random.Generator, options: Mapping[str, Any], fixed: Mapping[str, float] | None = None
    ) -> dict[str, Any]:
        """Draws the row's load, and then what is drawn of its structure besides `fixed`, and sets both and the score to
        their start; returns its entries of `info`. A seed has the same load with noise and draws and without."""
        whole, rows = self.structure, self.rows
        amplitude = check_options(options, whole.option, *whole.more)
        load = whole.load(rng, self.loads, options).scaled(amplitude)
        self._under[row] = f"{load.name} at amplitude {amplitude:g}"
        drawn = rows.draw(row, rng, fixed)
        if self._own_noise:
            rows.seed(row, rng)
        given, own = rows.start(row, load), rows.of(row).structure
        clock = load.duration, getattr(load, "sample_time", None)  # a road has none
        key = hashlib.blake2b(given.tobytes() + repr((drawn, clock)).encode(), digest_size=16).digest()
        if key not in self._references:
            if len(self._references) >= _KEPT:
                self._references.clear()
            self._references[key] = own.reference(given, load, self)
        reference = self._references[key]
        self.score.start(row, reference, int(rows.steps[row]))
        told = whole.told(load, reference)
        told = {whole.option: load.name, "duration": load.duration, **told}
        return told | ({"drawn": dict(drawn)} if drawn else {})

    def commands(self, actions: Any) -> Array:
        """(n, m) commands from actions (n, m) in [-1, 1]; clipped to the range. Raises InputError."""
        share = 0.5 * (finite("action", actions, (self.n, len(self.command_max))) + 1.0)
        return np.asarray(np.minimum(np.maximum(share, 0.0), 1.0) * self.command_max)

    def reset(
        self, rows: Sequence[int], rngs: Sequence[np.random.Generator], options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, list[dict[str, Any]]]:
        """Starts rows anew: observations (rows, size) and one info each. rngs: a generator for each of all n rows."""
        require_kind("options by name", Mapping, **{"reset: options": options})
        given = dict(options or {})
        fixed, infos = given.pop("drawn", None), []
        for row in rows:
            infos.append(self.begin(row, rngs[row], given, fixed))
        values = self.rows.measure(rows)
        for k, row in enumerate(rows):
            self.noise.add(values, k, rngs[row])
            self._rngs[row] = rngs[row]
            self._command[row] = 0.0
        self.measured[list(rows)] = values
        observation = self._stack.restart(rows, values[:, self._observed], self._command[list(rows)])
        return observation, infos

    def step(self, actions: Any, quiet: Sequence[int] = ()) -> Step:
        """One control period of all rows. quiet: rows that draw no noise, as they are about to be reset."""
        self._command = self.commands(actions)
        try:
            period, values = self.rows.advance(self._command)
            self.happened = period
            reward, info = self.score.of(period)
            if not math.isfinite(np.add.reduce(reward)):
                raise diverged(row=int(np.argmin(np.isfinite(reward))))
        except Diverged as error:
            raise diverged(self._under[error.row], error.row) from None
        if self.noise.where:
            for row, rng in enumerate(self._rngs):
                if rng is not None and row not in quiet:
                    self.noise.add(values, row, rng)
        self.measured = values
        observation = self._stack.push(values[:, self._observed], self._command)
        return Step(observation, reward, self.over, info)

    def drive(self, commands: Array) -> Step:
        """`step` with commands in A or V, (n, m), or (n,) of all dampers."""
        return self.step(2.0 * commands.reshape(self.n, -1) / self.command_max - 1.0)

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
        try:
            period, values = rows.advance_one(self._command)
            reward, info = self.score.of_one(period)
            if not math.isfinite(reward):
                raise diverged()
        except Diverged:
            raise diverged(self._under[0]) from None
        self.measured = measured = np.array([values])
        if self.noise.where and self._rngs[0] is not None:
            self.noise.add(measured, 0, self._rngs[0])
            values = measured[0].tolist()
        observation = self._stack.push_one([values[k] for k in self._columns], commands)
        plants = rows.plants
        return observation, reward, bool(plants.step[0] >= rows.steps[0] * plants.inner), info

    def save(self, row: int) -> Episode:
        held = self.score.values, self._stack.past, self._command, self.measured
        return Episode(self.rows.save(row), *(values[row].copy() for values in held))

    def restore(self, row: int, episode: Episode, rng: np.random.Generator) -> None:
        """Restores a saved state exactly; rng: where noise comes from."""
        self.rows.restore(row, episode.rows)
        self.score.values[row] = episode.score
        self._stack.past[row] = episode.past
        self._command[row] = episode.command
        self.measured[row] = episode.measured
        self._rngs[row] = rng


class KindTask(Task):
    """n rows of a structure of one kind, from arguments of its environment."""

    kind: ClassVar[type[Structure]]

    def __init__(self, n: int = 1, **arguments: Any) -> None:
        structure, others = divided(self.kind, arguments)
        super().__init__(structure, n, **others)


def begun(task: Task, loads: Sequence[Any]) -> Observation:
    """Observations (n, size) at the start of the n rows of a task, row k under loads[k]."""
    rngs = [np.random.default_rng(k) for k in range(task.n)]
    return np.concatenate([task.reset([k], rngs, {task.structure.option: load})[0] for k, load in enumerate(loads)])


def episodes(
    task: Task, measures: Sequence[str], loads: Sequence[Any], act: Callable[[Observation], Array]
) -> dict[str, Array]:
    """Fields of `info` (n,) at the end of the n rows of a task, row k under loads[k].

    act: commands (n,), or (n, dampers), A or V, from observations (n, size).
    """
    observation = begun(task, loads)
    alive = np.ones(task.n, dtype=np.bool_)
    columns = [task.score.NAMES.index(name) for name in measures]
    found = np.zeros((task.n, len(columns)))
    while alive.any():
        step = task.drive(act(observation))
        ended = step.over & alive
        found[ended] = step.info[ended][:, columns]
        alive &= ~step.over
        observation = step.observation
    return dict(zip(measures, found.T, strict=True))


def task_of(structure: Structure, n: int, **arguments: Any) -> Task:
    """n rows of a structure, with other arguments of its environment, its own fields among them."""
    own = {f.name for f in fields(structure)}  # type: ignore[arg-type]
    others = {"loads" if k == structure.source else k: v for k, v in arguments.items() if k not in own}
    changed: Any = replace(structure, **{k: v for k, v in arguments.items() if k in own})  # type: ignore[type-var]
    return Task(changed, n, **others)


def divided(kind: type[Structure], arguments: Mapping[str, Any]) -> tuple[Structure, dict[str, Any]]:
    """A structure from arguments of its environment, and those of its task."""
    own = {f.name for f in fields(kind)}  # type: ignore[arg-type]
    known = own | {kind.source, "reward", *(f.name for f in fields(TaskOptions))}
    for name in arguments:
        if name not in known:
            raise InputError(f"{name!r} is no argument{nearest(name, known)}; allowed: {', '.join(sorted(known))}")
    others = {"loads" if k == kind.source else k: v for k, v in arguments.items() if k not in own}
    return kind(**{k: v for k, v in arguments.items() if k in own}), others
