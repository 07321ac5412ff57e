"""The task of the quarter car: roads, its default observation, and its reward."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp import sets
from mrdamp.control.observe import Observer
from mrdamp.envs.car_reward import CarReward, CarScore, reference_run
from mrdamp.envs.car_roads import IsoRoads, RoadSource
from mrdamp.envs.chain_rows import CARS, of_engine
from mrdamp.envs.frame_rows import command_range
from mrdamp.envs.frame_task import largest_force
from mrdamp.envs.plant import RowPlant
from mrdamp.envs.task import References, Task, check_options, observer_of
from mrdamp.errors import InputError
from mrdamp.model import Model, effects_from
from mrdamp.simulation.roads import Road, read_road
from mrdamp.structures.cars import QuarterCar

Array = NDArray[np.float64]

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
    """A quarter car with a damper, in MuJoCo or on the chain (engine), for any controller to run on, without rewards.

    car: None is that of `QuarterCar`. model: any identified one, None: `car_damper`. Floor 1 of the measurements is the
    wheel, 2 the body; displacements and velocities are those to the road. period: of control, s; timestep: the largest
    of the engine, s. Raises InputError.
    """

    def __init__(
        self,
        car: QuarterCar | None = None,
        model: Model | None = None,
        *,
        period: float = 5e-3,
        timestep: float | None = None,
        command_max: float | None = None,
        engine: str = "mujoco",
    ) -> None:
        structures, step = of_engine(CARS, engine)
        self.car = car or QuarterCar()
        damper = model or car_damper()
        maximum = command_range([damper], command_max)
        self.period, self.command_max = period, float(maximum[0])
        self.rows = structures(self.car, damper, period, step if timestep is None else timestep, maximum)


class CarTask(Task):
    """n quarter cars on roads; arguments as in `CarEnv`, observed: those of `car_observer`."""

    def __init__(
        self,
        n: int = 1,
        *,
        car: QuarterCar | Mapping[str, float] | None = None,
        model: Model | Path | str | None = None,
        roads: RoadSource | None = None,
        reward: CarReward | Mapping[str, Any] | None = None,
        observer: Observer | Mapping[str, Any] | None = None,
        noise: Mapping[str, float] | None = None,
        period: float = 5e-3,
        timestep: float | None = None,
        command_max: float | None = None,
        engine: str = "mujoco",
        threads: int = 1,
        **observed: Any,
    ) -> None:
        structures, step = of_engine(CARS, engine)
        self.car = QuarterCar(**car) if isinstance(car, Mapping) else car or QuarterCar()
        self.model = Model.read(model) if isinstance(model, str | Path) else model or car_damper()
        maximum = command_range([self.model], command_max)
        self.car_rows = structures(
            self.car, self.model, period, step if timestep is None else timestep, maximum, n, threads
        )
        self._references = References[Array]()
        self.roads = IsoRoads() if roads is None else roads
        self.weights = reward if isinstance(reward, CarReward) else CarReward.from_dict(reward or {})
        self.car_score = CarScore(self.weights, n)
        own = car_observer(self.car, self.model, float(maximum[0]), **observed)
        super().__init__(self.car_rows, self.car_score, observer_of(observer, lambda: own), maximum, noise)

    drawn_size = 0.05

    def reference_motion(self, row: int) -> float:
        """RMS stroke, m."""
        return math.sqrt(self.car_score.values[row, 2])

    def begin(self, row: int, rng: np.random.Generator, options: Mapping[str, Any]) -> dict[str, Any]:
        road = self._road(rng, options)
        heights = self.car_rows.start(row, road)
        step = self.car_rows.plants.timestep
        reference = self._references.of(heights, lambda: reference_run(self.car, heights, step))
        self.car_score.start(row, reference)
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
        check_options(options, "road", "amplitude", "speed")
        road, speed = options.get("road"), options.get("speed")
        if road is None:
            road = self.roads.draw(rng)
        elif not isinstance(road, Road):
            if speed is None:
                raise InputError("reset: give the speed (m/s) beside a road file")
            road = read_road(road, float(speed))
        if speed is not None:
            road = replace(road, speed=float(speed))
        return road.scaled(float(options.get("amplitude", 1.0)))


def car_observer(
    car: QuarterCar,
    model: Model,
    command_max: float,
    signals: Sequence[str] | None = None,
    history: int = 1,
    action_in_observation: bool = True,
    memory: Sequence[float] = (),
    full_state: bool = False,
    peaks: Mapping[str, float] | None = None,
) -> Observer:
    """What a car's sensors give: accelerations of body and wheel, stroke and force of the damper.

    full_state: the stroke's velocity, the tyre's deflection and the coil's current besides. The scales are sizes on
    a rough road; of the force, the damper's in the body's bounce of 3 cm at the largest command.
    """
    if signals is None:
        signals = ["acceleration_2", "acceleration_1", "stroke"]
        if full_state:
            signals += ["stroke_velocity", "drift_1", "current"]
        signals = [*signals, "force"]
    scale = {
        "acceleration_1": _WHEEL, "acceleration_2": _BODY, "stroke": _STROKE, "stroke_velocity": _VELOCITY,
        "displacement_1": _TYRE, "displacement_2": _STROKE, "velocity_1": _VELOCITY, "velocity_2": _VELOCITY,
        "drift_1": _TYRE, "drift_2": _STROKE, "current": command_max,
    }  # fmt: skip
    scale["force"] = scale["true_force"] = largest_force(model, _STROKE, car.bounce, command_max)
    unknown = [name for name in signals if name not in scale]
    if unknown:
        raise InputError(f"observer: no measurement {unknown[0]!r}; there are: {', '.join(scale)}")
    return Observer(
        tuple(signals), tuple(scale[name] for name in signals), history, action_in_observation, (command_max,),
        memory=tuple(memory), peaks=peaks or {},
    )  # fmt: skip
