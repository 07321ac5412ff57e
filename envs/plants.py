"""Many copies of one rig, stepped a control period at a time, in MuJoCo or on the C++ chain without it.

Built on the engine's `Batch`: a row is a simulation, its state a row of numbers. One copy is a batch of one, so
that a single environment and a row of a vector environment do the same arithmetic.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from mrdamp.control.base import sensor_name
from mrdamp.errors import InputError, diverged
from mrdamp.model.core import Array
from mrdamp.simulation.mjcf import SIGNALS, actuator_name
from mrdamp.simulation.rows import ChainRows, RowMoment, Stepping, finite, require_finite

if TYPE_CHECKING:
    from mrdamp.envs.structure import Structure

_SEEDS = 2**53  # whole numbers that a double holds
_CONTROL = int(mujoco.mjtState.mjSTATE_CTRL)


class Plants:
    """n copies of a MuJoCo model whose inputs are loads (straight between samples) and dampers (held over a period).

    xml: MJCF with its timestep set. loads, dampers: names of actuators. inner: steps in a control period. fields:
    of MjData, what is read. Attributes: sensors, name -> slice of the sensor data; step (n,), of the engine since
    the start; record, name -> the fields at the last period's steps, as of `advance`.
    """

    def __init__(
        self,
        xml: str,
        loads: Sequence[str],
        dampers: Sequence[str],
        inner: int,
        n: int = 1,
        threads: int = 1,
        fields: Sequence[str] = ("sensordata",),
    ) -> None:
        try:
            self.model = mujoco.MjModel.from_xml_string(xml)
        except ValueError as error:
            raise InputError(str(error).splitlines()[0]) from None
        m = self.model
        self.n, self.inner = n, inner
        self.loads = _columns([m.actuator(name).id for name in loads])
        self.dampers, self._many = _columns([m.actuator(name).id for name in dampers]), len(dampers)
        found = [m.sensor(k) for k in range(m.nsensor)]
        self.sensors: Mapping[str, slice] = {
            s.name: slice(int(s.adr[0]), int(s.adr[0] + s.dim[0])) for s in found
        }
        self._fields, self._threads = tuple(fields), threads
        self._bind()
        self._pushes = np.zeros((n, inner, m.nu))
        self.record = {name: np.zeros((n, inner, a.shape[1])) for name, a in self._now.items()}
        # Loads (n, samples, loads); each row's sample time, last sample, and steps, from which on there is none.
        self._load = np.zeros((n, 1, len(loads)))
        self._sample_time, self._last = np.ones(n), np.zeros(n, dtype=np.int64)
        self._steps = np.zeros(n, dtype=np.int64)
        self._ahead = np.arange(inner + 1)
        self.step = np.zeros(n, dtype=np.int64)

    def _bind(self) -> None:
        self.batch = mujoco.batch.Batch(self.model, nsim=self.n, nthread=self._threads)
        self._now = {name: self.batch.bind(name) for name in self._fields}
        self._time = self.batch.bind("time")
        self._control = self.batch.bind("ctrl")

    def __getstate__(self) -> dict[str, Any]:
        """For copies: the engine's batch cannot be copied, its state can."""
        bound = ("batch", "_now", "_time", "_control")
        held = {name: value for name, value in self.__dict__.items() if name not in bound}
        return {**held, "state": np.array(self.batch.state)}

    def __setstate__(self, held: dict[str, Any]) -> None:
        state = held.pop("state")
        self.__dict__.update(held)
        self._bind()
        self.batch.state[:] = state

    @property
    def timestep(self) -> float:
        """Of the engine, s."""
        return float(self.model.opt.timestep)

    def start(self, row: int, load: Array, sample_time: float, steps: int) -> None:
        """Row at rest under a load (samples, loads) every sample_time (s), straight between samples.

        Behind its end it stays as it is, and is none from step `steps` on.
        """
        self.batch.reset([row], stage=mujoco.mjtStage.mjSTAGE_NONE)
        if load.shape[1] == 1:  # at the engine's steps: quicker, and of many loads it would be much memory
            time = self.timestep * np.arange(steps)
            load, sample_time = np.interp(time, sample_time * np.arange(len(load)), load[:, 0])[:, None], self.timestep
        self._give(row, load, sample_time, steps)
        self.step[row] = 0

    def measure(self, rows: Sequence[int] | None = None) -> dict[str, Array]:
        """The fields, (rows, size) each, at the present state, under the present load and the last commands."""
        some = list(range(self.n) if rows is None else rows)
        for row, load in zip(some, self.loads_at(np.array(some), self.step[some, None]), strict=True):
            self._control[row, self.loads] = load[0]
        self.batch.forward(rows)
        return {name: value[some] for name, value in self._now.items()}

    def advance(self, commands: Array) -> tuple[dict[str, Array], dict[str, Array]]:
        """One control period with commands (n, dampers) held.

        Returns the fields at the start of every step, (n, inner, size) each (of `qpos` and `qvel` those at its end),
        and the fields after the last step, (n, size) each, as `measure` does. The arrays are used again by the next
        call.
        """
        pushes, inner = self._pushes, self.inner
        pushes[:, :, self.dampers] = finite("command", commands, (self.n, self._many))[:, None, :]
        load = self.loads_at(np.arange(self.n), self.step[:, None] + self._ahead)
        pushes[:, :, self.loads] = load[:, :-1]
        self.batch.rollout(inner, pushes, _CONTROL, record=self._fields, out=self.record)
        self.step += inner
        # Where the engine warns of numbers that are none, or huge ones, it begins anew, and stops.
        behind = np.abs(self._time.ravel() - self.step * self.timestep) > 0.5 * self.timestep
        if behind.any():
            raise diverged(row=int(behind.argmax()))
        self._control[:, self.loads] = load[:, -1]
        self.batch.forward()
        return self.record, self._now

    def loads_at(self, rows: NDArray[np.int64], steps: NDArray[np.int64]) -> Array:
        """(rows, k, loads) of rows at steps (rows, k) since their start."""
        if len(rows) == 1:
            begin, end = int(steps[0, 0]), int(steps[0, -1])
            if self._sample_time[rows[0]] == self.timestep and end <= self._last[rows[0]]:
                return self._load[rows, begin : end + 1]
        time = steps * (self.timestep / self._sample_time[rows, None])
        last, row = self._last[rows, None], rows[:, None]
        before = np.minimum(time.astype(np.int64), last)
        # Behind the last sample the load stays: there the two are the same.
        first, second = self._load[row, before], self._load[row, np.minimum(before + 1, last)]
        found = first + (time - before)[:, :, None] * (second - first)
        over = steps >= self._steps[rows, None]
        if over[:, -1].any():
            found[over] = 0.0
        return np.asarray(found)

    def position(self, row: int) -> Array:
        """(nq,) of a row, for drawing."""
        return np.array(self.batch.bind("qpos")[row])

    def save(self, row: int) -> RowMoment:
        load, span = self._load[row, : self._last[row] + 1].copy(), (self._sample_time[row], self._steps[row])
        return RowMoment(np.array(self.batch.state[row]), load, float(span[0]), int(span[1]), int(self.step[row]))

    def restore(self, row: int, moment: RowMoment) -> None:
        self.batch.state[row] = moment.state
        self._give(row, moment.load, moment.sample_time, moment.steps)
        self.step[row] = moment.step

    def _give(self, row: int, load: Array, sample_time: float, steps: int) -> None:
        n, samples, width = self._load.shape
        if len(load) > samples:
            self._load = np.concatenate([self._load, np.zeros((n, len(load) - samples, width))], axis=1)
        self._load[row, : len(load)] = load
        self._last[row], self._sample_time[row], self._steps[row] = len(load) - 1, sample_time, steps


class EngineRows(ABC):
    """n rows of a structure in the engine, each under its own load.

    Attributes: structure; stepping; names of the measurements, in the order of the columns of `measure`; period, s;
    command_max (m,), A or V; steps (n,), how many control periods each row's load lasts; plants, which `_build` makes;
    window, s: a load lasts as long as with control periods of it.
    """

    plants: Plants
    #: Of MjData, what the measurements and the results of a period are made from.
    fields: ClassVar[tuple[str, ...]] = ("sensordata",)

    def __init__(self, structure: Structure, stepping: Stepping) -> None:
        self.structure, self.stepping, self.names = structure, stepping, structure.names
        self.period, self.command_max = stepping.period, stepping.command_max
        self.window = self.period
        self.steps: NDArray[np.int64] = np.ones(stepping.n, dtype=np.int64)
        self._build()

    def _build(self) -> None:
        s, inner, many = self.stepping, self.stepping.inner, len(self.structure.models)
        xml, loads = self.structure.mjcf(self.period / inner), self.structure.load_names
        dampers = [actuator_name(k) for k in range(many)]
        self.plants = Plants(xml, loads, dampers, inner, s.n, s.threads, self.fields)
        at = self.plants.sensors
        # The sensors of one kind stand together.
        of = {name: slice(at[name].start, at[sensor_name(name, many - 1)].stop) for name in SIGNALS}
        self._pull, self._velocity, self._current = of["pull"], of["stroke_velocity"], of["current"]
        self._direct = slice(of["force"].start, of["current"].stop)

    @abstractmethod
    def start(self, row: int, load: Any) -> Array:
        """Row at rest under a load; returns what `Structure.reference` is made from."""

    @abstractmethod
    def _criteria(self, record: Mapping[str, Array]) -> Sequence[Array]:
        """Results (n,) of a period before those of the dampers, from the fields at its steps, (n, inner, size)."""

    @abstractmethod
    def _moved_on(self, record: Mapping[str, Array], now: Mapping[str, Array]) -> Mapping[str, Array]:
        """The fields now, (n, size), with all velocities, which stand half a step before the positions, moved on."""

    @abstractmethod
    def _read(self, now: Mapping[str, Array], fresh: Sequence[int] | None) -> Array:
        """Measurements (rows, names) from the fields; fresh: rows that have just started, None: all, a period on."""

    def measure(self, rows: Sequence[int]) -> Array:
        """(rows, names) sensor readings of rows that have just started."""
        return self._read(self.plants.measure(rows), rows)

    def advance(self, commands: Array) -> tuple[Array, Array]:
        """One control period with commands (n, m) held: its results (n, columns), and the sensor readings after it."""
        record, now = self.plants.advance(commands)
        data, after = record["sensordata"], now["sensordata"]
        share, power, current = currents(data[:, :, self._current], self.command_max)
        velocity, step = data[:, :, self._velocity], self.plants.timestep
        energy = work(data[:, :, self._pull], velocity, after[:, self._velocity], step)
        found = np.stack([*self._criteria(record), share, power, current, energy], axis=1)
        return found, self._read(self._moved_on(record, now), None)

    def advance_one(self, commands: Array) -> tuple[list[float], list[float]]:
        """`advance` for a single row in plain numbers."""
        period, values = self.advance(commands)
        return period[0].tolist(), values[0].tolist()

    def _beside(self, row: int) -> Any:
        """The row's state beside that of the plants."""
        return None

    def _put_back(self, row: int, beside: Any) -> None:  # noqa: B027 - most have nothing to restore
        """Restores it."""

    def save(self, row: int) -> tuple[Any, Any]:
        return self.plants.save(row), self._beside(row)

    def restore(self, row: int, state: tuple[Any, Any]) -> None:
        self.plants.restore(row, state[0])
        self.steps[row] = state[0].steps // self.plants.inner
        self._put_back(row, state[1])

    def position(self, row: int) -> Array:
        """The coordinates of its drawing."""
        return np.asarray(self.plants.position(row))

    def of(self, row: int) -> Self:
        """The rows that the row's structure is of: all have the same."""
        return self

    def draw(self, row: int, rng: np.random.Generator, given: Any) -> Mapping[str, float]:
        """Nothing: no parameter is drawn here. Raises InputError where one is given."""
        if given:
            raise InputError(f"reset: drawn is {given!r}; allowed: with randomise, see its environment")
        return {}

    def follow(self, names: Sequence[str]) -> None:
        """What `within` gives from now on: measurements that the engine has a sensor of, as `true_force`."""
        self._followed = np.array([self.plants.sensors[name].start for name in names])

    def within(self) -> Array:
        """(inner, names) measurements of the first row at the start of every step of the last period, by ideal sensors,
        under the command of that period."""
        return np.asarray(self.plants.record["sensordata"][0][:, self._followed])

    def add_noise(self, deviation: Array) -> bool:
        """True if the rows add noise themselves; the engine's do not."""
        return False

    def seed(self, row: int, rng: np.random.Generator) -> None:  # noqa: B027 - the chain's have
        """Ignored: the engine's rows have no noise of their own."""

    def _begin(self, row: int, load: Array, sample_time: float, duration: float) -> None:
        """Row at rest under a load, as of `Plants.start`, for its whole control periods: the row's `steps`."""
        self.steps[row] = self._lasting(duration)
        self.plants.start(row, load, sample_time, int(self.steps[row] * self.plants.inner))

    def _times(self, duration: float) -> Array:
        """(samples,) s, the engine's steps in the whole control periods of a load."""
        return np.asarray(self.plants.timestep * np.arange(self._lasting(duration) * self.plants.inner))

    def _lasting(self, duration: float) -> int:
        """How many control periods a load lasts: to the nearest of the window's end."""
        return round(periods(duration, self.window) * self.window / self.period)


class Chained(EngineRows):
    """Base of rows on the chain. Attributes: plants, seeds (n,) of the rows' noise."""

    plants: Any
    seeds: NDArray[np.int64]

    def _hold(self, plants: ChainRows) -> None:
        self.plants = plants
        self.seeds = np.zeros(plants.n, dtype=np.int64)

    def follow(self, names: Sequence[str]) -> None:
        self._followed = np.array([self.names.index(name) for name in names])
        self.plants.follow()

    def within(self) -> Array:
        return np.asarray(self.plants.within[0][:, self._followed])

    def add_noise(self, deviation: Array) -> bool:
        """Sets white noise (names,), SI, on all measurements; True: the rows add it themselves."""
        self.plants.noise(deviation)
        return True

    def seed(self, row: int, rng: np.random.Generator) -> None:
        """Of the noise of the row's next start."""
        self.seeds[row] = rng.integers(_SEEDS)

    def _begin(self, row: int, load: Array, sample_time: float, duration: float) -> None:
        self.steps[row] = self._lasting(duration)
        steps = int(self.steps[row] * self.plants.inner)
        self.plants.start(row, load, sample_time, steps, int(self.seeds[row]))

    def measure(self, rows: Sequence[int]) -> Array:
        """(rows, names) sensor readings of rows that have just started."""
        return self.seen(np.asarray(self.plants.measured[list(rows)]), rows)

    def seen(self, values: Array, fresh: Sequence[int] | None) -> Array:
        """Measurements (rows, names) as sensors that the chain does not have read them, in place; fresh: rows that have
        just started, None: all, a period on."""
        return values

    def advance(self, commands: Array) -> tuple[Array, Array]:
        """One control period with commands (n, m) held: `PERIOD` (n, 6), and the sensor readings after it."""
        period, values = require_finite(self.plants.advance(commands))
        return period, self.seen(values, None)

    advance_one = EngineRows.advance_one
    #: The plants' state is all.
    _beside, _put_back = EngineRows._beside, EngineRows._put_back


def periods(duration: float, period: float) -> int:
    """How many control periods (s) a load lasts: one for each of the instants 0, period, .. up to its last sample.

    N samples every period are N commands. A load's duration is that from its first to its last sample, (N - 1) periods;
    without a period for the last one it would not act, nor its peak be seen. It stays until that period's end.
    """
    return math.floor(duration / period + 1e-9) + 1


def _columns(ids: Sequence[int]) -> slice | NDArray[np.intp]:
    """Of an array's last axis: a slice where they stand together, which is quicker."""
    if list(ids) == list(range(ids[0], ids[0] + len(ids))):
        return slice(ids[0], ids[0] + len(ids))
    return np.array(ids, dtype=np.intp)


def currents(current: Array, command_max: Array) -> Array:
    """(3, n) means over (n, k, m) currents: |current| over its largest (m,), its square, and |current|."""
    size = np.abs(current)
    share = size / command_max
    parts = [np.add.reduce(part, axis=(1, 2)) for part in (share, share * share, size)]
    return np.asarray(np.array(parts) / (current.shape[1] * current.shape[2]))


def work(pull: Array, velocity: Array, after: Array, timestep: float) -> Array:
    """(n,) J taken from a structure by actuators that pull with (n, k, m) N over k steps.

    velocity: (n, k, m) m/s at the steps, after: (n, m) behind the last one. A step changes the velocity by the pull, so
    the pull times the mean of both velocities is the work of the step, exactly.
    """
    both = velocity.copy()
    both[:, :-1] += velocity[:, 1:]
    both[:, -1] += after
    both *= pull
    return np.asarray(-0.5 * timestep * np.add.reduce(both.reshape(len(both), -1), axis=1))
