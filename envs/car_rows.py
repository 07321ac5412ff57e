"""Quarter cars in MuJoCo with their measurements: n of them, one a row, a control period at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mrdamp.envs.frame_rows import FrameRows
from mrdamp.envs.plants import EngineRows
from mrdamp.model.core import Array
from mrdamp.simulation.comfort import STATES, BlockFilter
from mrdamp.simulation.roads import Road
from mrdamp.simulation.rows import Stepping

if TYPE_CHECKING:
    from mrdamp.envs.car_task import Car


#: Results of one control period over all steps of the engine: columns of (n, 9).
#: mean squares of the body's acceleration weighted by Wk, m2/s4, of the dynamic tyre load over the weight, and of the
#: stroke, m2; largest stroke in size, m; share of the steps without contact; means of the current's size over the
#: largest command, of its square, and of its size in A or V; energy taken in by the damper, J.
PERIOD = ("comfort", "load", "stroke", "stroke_peak", "airborne", "share", "power", "current", "energy")


class CarRows(FrameRows):
    """n quarter cars, each on its own road: frames of two floors, wheel and body, on a ground that is the road.

    Attributes: as of `FrameRows`; roads, of each row.
    """

    structure: Car  # type: ignore[assignment]

    def __init__(self, structure: Car, stepping: Stepping) -> None:
        self.roads: list[Road] = [Road("none", 1.0, np.zeros(3), 1.0)] * stepping.n
        super().__init__(structure, stepping)

    def _build(self) -> None:
        super()._build()
        self._filter = BlockFilter(self.plants.timestep, self.plants.inner)
        self.weighted = np.zeros((self.stepping.n, STATES))

    def start(self, row: int, load: Any) -> Array:
        """Row at rest at the start of a road; returns the heights (samples,) at the engine's steps, m."""
        self.roads[row] = load
        heights = self._heights(load)
        self._begin(row, self._load(heights)[:, None], self.plants.timestep, load.duration)
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

    def _criteria(self, record: Mapping[str, Array]) -> Sequence[Array]:
        data, car = record["sensordata"], self.structure.car
        drift, rate = data[:, :, self._drift], data[:, :, self._drift_velocity]
        load = car.tyre_load(drift[:, :, 0], rate[:, :, 0])
        dynamic, stroke, steps = load / car.weight - 1.0, drift[:, :, 1], load.shape[1]
        comfort, self.weighted = self._filter(self.weighted, data[:, :, self._acceleration][:, :, 1])
        squares = ((x * x).sum(axis=1) / steps for x in (dynamic, stroke))
        return [comfort, *squares, np.abs(stroke).max(axis=1), (load == 0.0).sum(axis=1) / steps]

    advance_one = EngineRows.advance_one

    def _beside(self, row: int) -> Any:
        return super()._beside(row), self.weighted[row].copy(), self.roads[row]

    def _put_back(self, row: int, beside: Any) -> None:
        super()._put_back(row, beside[0])
        self.weighted[row], self.roads[row] = beside[1:]


def road_acceleration(heights: Array, step: float) -> Array:
    """(samples,) m/s2 that take the engine from height to height (samples + 1,) m, every step (s), from rest."""
    velocity = np.diff(heights, prepend=heights[0]) / step
    return np.asarray(np.diff(velocity) / step)
