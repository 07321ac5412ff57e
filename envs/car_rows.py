"""Quarter cars in MuJoCo with their measurements: n of them, one a row, a control period at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.envs.car_xml import car_xml
from mrdamp.envs.frame_rows import FrameRows, currents, work
from mrdamp.envs.frame_xml import frame_models
from mrdamp.model import Model
from mrdamp.simulation.comfort import STATES, BlockFilter
from mrdamp.simulation.roads import Road
from mrdamp.simulation.rows import Stepping
from mrdamp.structures.cars import QuarterCar

Array = NDArray[np.float64]

#: Results of one control period over all steps of the engine: columns of (n, 9).
#: mean squares of the body's acceleration weighted by Wk, m2/s4, of the dynamic tyre load over the weight, and of the
#: stroke, m2; largest stroke in size, m; share of the steps without contact; means of the current's size over the
#: largest command, of its square, and of its size in A or V; energy taken in by the damper, J.
PERIOD = ("comfort", "load", "stroke", "stroke_peak", "airborne", "share", "power", "current", "energy")


@dataclass(frozen=True)
class CarState:
    """A row's state, with its weighting filter and the road it is on."""

    row: Any
    weighted: Array
    road: Road


class CarRows(FrameRows):
    """n quarter cars, each on its own road: frames of two floors, wheel and body, on a ground that is the road.

    model: of the damper; effects with a place in a frame are left out. Attributes: as of `FrameRows`; roads, of each
    row.
    """

    def __init__(self, car: QuarterCar, model: Model, stepping: Stepping) -> None:
        self.car = car
        self.roads: list[Road] = [Road("none", 1.0, np.zeros(3), 1.0)] * stepping.n
        own = replace(model, effects=tuple(e for e in model.effects if e.place is None))
        super().__init__(frame_models(own, car.frame, [(1, 2)]), stepping)

    def _build(self) -> None:
        super()._build()
        self._filter = BlockFilter(self.plants.timestep, self.plants.inner)
        self.weighted = np.zeros((self.stepping.n, STATES))

    def _mjcf(self, timestep: float) -> tuple[str, str]:
        return car_xml(self.car, self.models[0], timestep), "road"

    def start(self, row: int, motion: Any) -> Array:
        """Row at rest at the start of a road; returns the heights (samples,) at the engine's steps, m."""
        self.roads[row] = motion
        heights = self._heights(motion)
        self._begin(row, self._load(heights)[:, None], self.plants.timestep, motion.duration)
        return heights[:-1]

    def _begin(self, row: int, load: Array, sample_time: float, duration: float) -> None:
        super()._begin(row, load, sample_time, duration)
        self.weighted[row] = 0.0

    def _load(self, heights: Array) -> Array:
        """(samples,) m/s2 at the steps."""
        return road_acceleration(heights, self.plants.timestep)

    def _heights(self, road: Road) -> Array:
        """(samples + 1,) m."""
        time = self._times(road.duration)
        time = np.append(time, time[-1] + self.plants.timestep)
        # Straight on within the last period: a stop would be a blow at the road's end.
        beyond, last = np.maximum(time - road.duration, 0.0), np.array([road.duration - 1e-6, road.duration])
        return np.asarray(road.at(time) + beyond * np.diff(road.at(last)) / 1e-6)

    def advance(self, commands: Array) -> tuple[Array, Array]:
        """One control period with commands (n, 1) held: `PERIOD` (n, 9), and the sensor readings after it."""
        record, now = self.plants.advance(commands)
        data, after = record["sensordata"], now["sensordata"]
        drift, rate = data[:, :, self._drift], data[:, :, self._drift_velocity]
        load = self.car.tyre_load(drift[:, :, 0], rate[:, :, 0])
        dynamic, stroke = load / self.car.weight - 1.0, drift[:, :, 1]
        found = np.empty((len(data), len(PERIOD)))
        found[:, 0], self.weighted = self._filter(self.weighted, data[:, :, self._acceleration][:, :, 1])
        found[:, 1] = (dynamic * dynamic).sum(axis=1) / dynamic.shape[1]
        found[:, 2] = (stroke * stroke).sum(axis=1) / stroke.shape[1]
        found[:, 3] = np.abs(stroke).max(axis=1)
        found[:, 4] = (load == 0.0).sum(axis=1) / load.shape[1]
        found[:, 5:8] = currents(data[:, :, self._current], self.command_max)
        found[:, 8] = work(
            data[:, :, self._pull], data[:, :, self._velocity], after[:, self._velocity], self.plants.timestep
        )
        return found, self._read(self._moved_on(data, after), None)

    def advance_one(self, commands: Array) -> tuple[list[float], list[float]]:
        """`advance` for a single car in plain numbers."""
        period, values = self.advance(commands)
        return period[0].tolist(), values[0].tolist()

    def save(self, row: int) -> Any:
        return CarState(super().save(row), self.weighted[row].copy(), self.roads[row])

    def restore(self, row: int, state: Any) -> None:
        super().restore(row, state.row)
        self.weighted[row], self.roads[row] = state.weighted, state.road


def road_acceleration(heights: Array, step: float) -> Array:
    """(samples,) m/s2 that take the engine from height to height (samples + 1,) m, every step (s), from rest."""
    velocity = np.diff(heights, prepend=heights[0]) / step
    return np.asarray(np.diff(velocity) / step)
