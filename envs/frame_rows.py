"""Frames in MuJoCo with their measurements: n of them, one a row, a control period at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.envs.damper_sensors import SIGNALS
from mrdamp.envs.frame_xml import actuator_name, frame_xml, sensor_name
from mrdamp.envs.plants import EngineRows, Moment, Plants
from mrdamp.envs.sensors import FloorSensors
from mrdamp.model import Model
from mrdamp.simulation.rows import Stepping

Array = NDArray[np.float64]


#: Results of one control period over all steps of the engine: columns of (n, 6).
#: largest |drift| of a storey, m; largest |absolute acceleration| of a floor, m/s2; means over period and dampers of
#: |current| over the largest command, of its square, and of |current| in A or V; energy taken in by the dampers, J.
PERIOD = ("drift", "acceleration", "share", "power", "current", "energy")


@dataclass(frozen=True)
class RowState:
    """A row's state, with its sensors."""

    moment: Moment
    sensors: Sequence[Array]


class FrameRows(EngineRows):
    """n frames of `frame_models`, each with its own ground motion.

    Attributes: names of the measurements, in the order of the columns of `measure`; plants; steps (n,), how many
    control periods each motion lasts.
    """

    def __init__(self, models: Sequence[Model], stepping: Stepping) -> None:
        structure = models[0].structure
        assert structure is not None
        self.models, self.structure = tuple(models), structure
        floors, many = range(1, self.structure.storeys + 1), range(len(self.models))
        self.names: tuple[str, ...] = (
            *(
                f"{what}_{j}"
                for what in ("acceleration", "displacement", "velocity", "drift")
                for j in floors
            ),
            *(sensor_name(s, k) for s in SIGNALS[:-1] for k in many),
        )
        super().__init__(stepping)

    def _build(self) -> None:
        s, inner, many = self.stepping, self.stepping.inner, range(len(self.models))
        dampers = [actuator_name(k) for k in many]
        xml, load = self._mjcf(self.period / inner)
        self.plants = Plants(xml, (load,), dampers, inner, s.n, s.threads)
        self.sensors = FloorSensors(self.models[0].frame, self.period, s.n)
        floors, at = range(1, self.structure.storeys + 1), self.plants.sensors
        # `frame_xml` writes the sensors of one kind consecutively.
        self._acceleration = slice(at["acceleration_1"].start, at[f"acceleration_{floors[-1]}"].stop, 3)
        self._drift = slice(at["drift_1"].start, at[f"drift_{floors[-1]}"].stop)
        self._drift_velocity = slice(at["drift_velocity_1"].start, at[f"drift_velocity_{floors[-1]}"].stop)
        of = {name: slice(at[name].start, at[sensor_name(name, many[-1])].stop) for name in SIGNALS}
        self._pull, self._velocity = of["pull"], of["stroke_velocity"]
        self._velocities = np.r_[self._drift_velocity, self._velocity]
        self._current = of["current"]
        self._direct = slice(of["force"].start, of["current"].stop)
        self._sums = DamperSums(inner, self.command_max, self.plants.timestep)

    def _mjcf(self, timestep: float) -> tuple[str, str]:
        """The structure's MJCF, and the name of its load."""
        return frame_xml(self.models, timestep), "ground"

    def start(self, row: int, motion: Any) -> Array:
        """Row at rest under a motion; returns the ground's acceleration (samples,) at the engine's steps, m/s2.

        The motion is linear between its samples, also within the control period.
        """
        self._begin(row, motion.acceleration[:, None], motion.sample_time, motion.duration)
        return np.asarray(np.interp(self._times(motion.duration), motion.time, motion.acceleration))

    def measure(self, rows: Sequence[int]) -> Array:
        """(rows, names) sensor readings of rows that have just started."""
        return self._read(self.plants.measure(rows)["sensordata"], rows)

    def advance(self, commands: Array) -> tuple[Array, Array]:
        """One control period with commands (n, m) held: `PERIOD` (n, 6), and the sensor readings after it."""
        record, now = self.plants.advance(commands)
        data, after = record["sensordata"], now["sensordata"]
        found = np.empty((len(data), 6))
        np.maximum.reduce(np.abs(data[:, :, self._drift]), axis=(1, 2), out=found[:, 0])
        np.maximum.reduce(np.abs(data[:, :, self._acceleration]), axis=(1, 2), out=found[:, 1])
        found[:, 2:5] = currents(data[:, :, self._current], self.command_max)
        found[:, 5] = work(
            data[:, :, self._pull], data[:, :, self._velocity], after[:, self._velocity], self.plants.timestep
        )
        return found, self._read(self._moved_on(data, after), None)

    def _moved_on(self, data: Array, after: Array) -> Array:
        """Sensor data (rows, sensors) with all velocities at the time of the positions: `moved_on`."""
        now = after.copy()
        now[:, self._velocities] = moved_on(data[:, -1, self._velocities], after[:, self._velocities])
        return now

    def advance_one(self, commands: Array) -> tuple[list[float], list[float]]:
        """`advance` for a single frame in plain numbers, bit-identical: every sum is NumPy's over the same numbers."""
        record, now = self.plants.advance(commands)
        data, after = record["sensordata"][0], now["sensordata"][0].tolist()
        size = np.abs(data)
        largest = np.maximum.reduce(size, axis=0).tolist()
        velocity = data[:, self._velocity]
        period = [
            # max() may ignore NaN.
            max(largest[self._drift]) if math.isfinite(sum(largest)) else math.nan,
            max(largest[self._acceleration]),
            *self._sums(size[:, self._current], data[:, self._pull], velocity, after[self._velocity]),
        ]
        after = self._moved_on(record["sensordata"], now["sensordata"])[0].tolist()
        drift, floors = after[self._drift], after[self._acceleration]
        if not self.sensors.ideal:
            floors = self.sensors.read(np.array([floors]), None)[0].tolist()
        values = [
            *floors,
            *accumulate(drift),
            *accumulate(after[self._drift_velocity]),
            *drift,
            *after[self._direct],
        ]
        return period, values

    def _read(self, data: Array, fresh: Sequence[int] | None) -> Array:
        drift = data[:, self._drift]
        return np.concatenate(
            [
                self.sensors.read(data[:, self._acceleration], fresh),
                drift.cumsum(axis=1),
                data[:, self._drift_velocity].cumsum(axis=1),
                drift,
                data[:, self._direct],
            ],
            axis=1,
        )

    def save(self, row: int) -> RowState:
        return RowState(self.plants.save(row), self.sensors.save(row))

    def restore(self, row: int, state: RowState) -> None:
        self.plants.restore(row, state.moment)
        self.sensors.restore(row, state.sensors)
        self.steps[row] = state.moment.steps // self.plants.inner


def moved_on(before: Array, after: Array) -> Array:
    """Velocities at the time of the engine's positions, half a step after its own, from two steps (...) of these."""
    return np.asarray(after + 0.5 * (after - before))


def currents(current: Array, command_max: Array) -> Array:
    """(n, 3) means over (n, k, m) currents: |current| over its largest (m,), its square, and |current|."""
    n, k, m = current.shape
    size = np.abs(current)
    share = size / command_max
    found = np.empty((n, 3))
    for column, part in zip(found.T, (share, share * share, size), strict=True):
        np.add.reduce(part, axis=(1, 2), out=column)
    found /= k * m
    return found


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


class DamperSums:
    """`currents` and `work` of a single row at once, to the last bit: m dampers over steps of timestep (s)."""

    def __init__(self, steps: int, command_max: Array, timestep: float) -> None:
        self.command_max, self.half_step = command_max, -0.5 * timestep
        self.parts = np.zeros((4, steps, len(command_max)))

    def __call__(self, size: Array, pull: Array, velocity: Array, after: Sequence[float]) -> list[float]:
        """Shares, powers, currents and energy from |current|, pull and velocity (steps, m), after (m,) as in `work`."""
        current, share, power, both = self.parts
        current[:] = size
        np.divide(current, self.command_max, share)
        np.multiply(share, share, power)
        both[:-1] = velocity[1:]
        both[-1] = after
        both += velocity
        both *= pull
        currents, shares, powers, worked = np.add.reduce(self.parts.reshape(4, -1), axis=1).tolist()
        many = current.size
        return [shares / many, powers / many, currents / many, self.half_step * worked]


def as_mapping(names: Sequence[str], values: Sequence[float]) -> Mapping[str, float]:
    """Measurements by name."""
    return dict(zip(names, values, strict=True))
