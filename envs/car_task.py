"""The task of the quarter car: roads, its default observation, and its reward."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp import sets
from mrdamp.envs.car_reward import CarReward, reference_run
from mrdamp.envs.car_roads import IsoRoads, RoadSource
from mrdamp.envs.chain_rows import CARS
from mrdamp.envs.frame_task import largest_force
from mrdamp.envs.options import RowOptions, TaskOptions, model_of
from mrdamp.envs.plant import RowPlant
from mrdamp.envs.task import Task, check_options
from mrdamp.envs.weights import Score
from mrdamp.errors import InputError, require_kind
from mrdamp.model import Model, effects_from
from mrdamp.simulation.roads import Road, read_road
from mrdamp.structures.cars import QuarterCar

Array = NDArray[np.float64]

#: RMS over the scales under the default loads and commands that change evenly between none and the largest.
_TYPICAL = {
    "acceleration": 0.65, "displacement": 0.5, "drift": 0.45, "stroke": 0.4, "stroke_velocity": 0.5, "force": 0.6,
    "true_force": 0.6, "current": 0.6,
}  # fmt: skip
# Sizes that the scales of the observation belong to, those on a rough road (class D): m/s2, m/s, m.
_BODY, _WHEEL, _VELOCITY, _STROKE, _TYRE = 3.0, 30.0, 0.5, 0.03, 0.01


def car_damper() -> Model:
    """The Lord RD-1005 of Lai and Liao 2002 (doi 10.1177/107754602023712): modified Bouc-Wen, 2 kN, 0 to 2 V.

    Without the preload of its accumulator, 21 N, which is part of what carries the body at rest.
    """
    found = sets.load("lai_liao2002_rd1005")
    effects = effects_from({k: v for k, v in found.attributes().items() if k not in found.parameters})
    return Model(found.law, {**found.parameters, "x0": 0.0}, effects, name=found.id)


class CarPlant(RowPlant):
    """A quarter car with a damper, in MuJoCo or on the chain (engine), for any controller, without rewards.

    car: None is that of `QuarterCar`. model: any identified one, None: `car_damper`. Floor 1 of the measurements is the
    wheel, 2 the body; displacements and velocities are those to the road. options: of `RowOptions`. Raises InputError.
    """

    def __init__(self, car: QuarterCar | None = None, model: Model | None = None, **options: Any) -> None:
        self.car = car or QuarterCar()
        damper = model or car_damper()
        super().__init__(RowOptions(**options).rows(CARS, [damper], self.car, damper))


class CarTask(Task):
    """n quarter cars on roads; arguments as in `CarEnv`."""

    def __init__(
        self,
        n: int = 1,
        *,
        car: QuarterCar | Mapping[str, float] | None = None,
        model: Model | Path | str | None = None,
        roads: RoadSource | None = None,
        reward: CarReward | Mapping[str, Any] | None = None,
        **options: Any,
    ) -> None:
        given = TaskOptions(**options)
        require_kind("a QuarterCar, or numbers by name", (QuarterCar, Mapping), car=car)
        require_kind("a source of roads", RoadSource, roads=roads)
        self.car = QuarterCar(**car) if isinstance(car, Mapping) else car or QuarterCar()
        self.model = model_of(model, car_damper)
        rows = given.rows(CARS, [self.model], self.car, self.model, n=n)
        self.roads = IsoRoads() if roads is None else roads
        self.weights = CarReward.of(reward)
        maximum = rows.command_max
        observer = given.observes(
            lambda full: car_sensors(self.car, self.model, float(maximum[0]), full), maximum, _TYPICAL
        )
        super().__init__(rows, Score(self.weights, n), observer, maximum, given.noise)

    drawn_size = 0.05

    def reference_motion(self, row: int) -> float:
        """RMS stroke, m."""
        return math.sqrt(self.score.values[row, 2])

    def begin(
        self, row: int, rng: np.random.Generator, options: Mapping[str, Any], drawn: Mapping[str, float]
    ) -> dict[str, Any]:
        road = self._road(rng, options)
        heights, car = self.rows.start(row, road), self.rows.of(row).car
        step = self.rows.plants.timestep
        reference = self._references.of(heights, drawn, lambda: reference_run(car, heights, step))
        self.score.start(row, reference, int(self.rows.steps[row]))
        acceleration, load, stroke = np.sqrt(reference).tolist()
        return {
            "road": road.name,
            "speed": road.speed,
            "duration": road.duration,
            "reference_acceleration": acceleration,
            "reference_load": load,
            "reference_stroke": stroke,
        }

    def _road(self, rng: np.random.Generator, options: Mapping[str, Any]) -> Road:
        amplitude = check_options(options, "road", "speed")
        road, speed = options.get("road"), options.get("speed")
        if road is None:
            road = self.roads.draw(rng)
        elif not isinstance(road, Road):
            require_kind("a Road, or its file", (Road, str, Path), road=road)
            if speed is None:
                raise InputError("reset: give the speed (m/s) beside a road file")
            road = read_road(road, float(speed))
        if speed is not None:
            road = replace(road, speed=float(speed))
        return road.scaled(amplitude)


def car_sensors(
    car: QuarterCar, model: Model, command_max: float, full_state: bool
) -> tuple[list[str], dict[str, float]]:
    """Signals of a car's sensors: accelerations of body and wheel, stroke and force of the damper.

    full_state: the stroke's velocity, the tyre's deflection and the coil's current besides. Returns the signals, and
    the scale of every measurement (SI): sizes on a rough road; of the force, the damper's in the body's bounce of 3 cm
    at the largest command.
    """
    more = ["stroke_velocity", "drift_1", "current"] if full_state else []
    scale = {
        "acceleration_1": _WHEEL, "acceleration_2": _BODY, "stroke": _STROKE, "stroke_velocity": _VELOCITY,
        "displacement_1": _TYRE, "displacement_2": _STROKE, "velocity_1": _VELOCITY, "velocity_2": _VELOCITY,
        "drift_1": _TYRE, "drift_2": _STROKE, "current": command_max,
    }  # fmt: skip
    scale["force"] = scale["true_force"] = largest_force(model, _STROKE, car.bounce, command_max)
    return ["acceleration_2", "acceleration_1", "stroke", *more, "force"], scale
