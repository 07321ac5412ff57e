"""Frames in MuJoCo with their measurements: n of them, one a row, a control period at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import TYPE_CHECKING, Any

import numpy as np

from mrdamp.envs.plants import EngineRows
from mrdamp.model.core import Array
from mrdamp.simulation.floor_sensors import FloorSensors

if TYPE_CHECKING:
    from mrdamp.envs.frame_task import Frame



class FrameRows(EngineRows):
    """n frames, each with its own ground motion. Results of a period: largest |drift| of a storey, m, and |absolute
    acceleration| of a floor, m/s2; then `OF_DAMPERS`."""

    structure: Frame

    def _build(self) -> None:
        super()._build()
        self.sensors = FloorSensors(self.structure.models[0].frame, self.period, self.stepping.n)
        top, at = self.structure.frame.storeys, self.plants.sensors
        self._acceleration = slice(at["acceleration_1"].start, at[f"acceleration_{top}"].stop, 3)
        self._drift = slice(at["drift_1"].start, at[f"drift_{top}"].stop)
        self._drift_velocity = slice(at["drift_velocity_1"].start, at[f"drift_velocity_{top}"].stop)
        self._velocities = np.r_[self._drift_velocity, self._velocity]
        self._sums = DamperSums(self.plants.inner, self.command_max, self.plants.timestep)

    def start(self, row: int, load: Any) -> Array:
        """Row at rest under a motion; returns the ground's acceleration (samples,) at the engine's steps, m/s2.

        The motion is linear between its samples, also within the control period.
        """
        self._begin(row, load.acceleration[:, None], load.sample_time, load.duration)
        return np.asarray(np.interp(self._times(load.duration), load.time, load.acceleration))

    def _criteria(self, record: Mapping[str, Array]) -> Sequence[Array]:
        data = record["sensordata"]
        return [np.abs(data[:, :, some]).max(axis=(1, 2)) for some in (self._drift, self._acceleration)]

    def _moved_on(self, record: Mapping[str, Array], now: Mapping[str, Array]) -> Mapping[str, Array]:
        after, before = now["sensordata"].copy(), record["sensordata"][:, -1, self._velocities]
        # From two steps of them.
        after[:, self._velocities] += 0.5 * (after[:, self._velocities] - before)
        return {"sensordata": after}

    def _read(self, now: Mapping[str, Array], fresh: Sequence[int] | None) -> Array:
        data = now["sensordata"]
        drift, acceleration = data[:, self._drift], self.sensors.read(data[:, self._acceleration], fresh)
        velocity = data[:, self._drift_velocity].cumsum(axis=1)
        return np.concatenate([acceleration, drift.cumsum(axis=1), velocity, drift, data[:, self._direct]], axis=1)

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
        after = self._moved_on(record, now)["sensordata"][0].tolist()
        drift, floors = after[self._drift], after[self._acceleration]
        if not self.sensors.ideal:
            floors = self.sensors.read(np.array([floors]), None)[0].tolist()
        moving = accumulate(drift), accumulate(after[self._drift_velocity])
        return period, [*floors, *moving[0], *moving[1], *drift, *after[self._direct]]

    def _beside(self, row: int) -> Any:
        return self.sensors.save(row)

    def _put_back(self, row: int, beside: Any) -> None:
        self.sensors.restore(row, beside)


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
