"""Quarter cars on roads: damper and roads, and what is measured and rewarded."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp import sets
from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.car import CarSite
from mrdamp.envs.car_reward import CarReward, reference_run
from mrdamp.envs.car_roads import IsoRoads, RoadSource
from mrdamp.envs.car_rows import CarRows
from mrdamp.envs.car_xml import CarView, car_xml
from mrdamp.envs.chain_rows import CarChain
from mrdamp.envs.frame_xml import frame_models
from mrdamp.envs.options import model_of
from mrdamp.envs.structure import Criterion, Structure, largest_force
from mrdamp.envs.task import KindTask, Task
from mrdamp.envs.training_loads import TrainingRoads, validation_roads
from mrdamp.errors import InputError, require_kind
from mrdamp.model import Model, effects_from
from mrdamp.model.core import Array
from mrdamp.simulation.mjcf import SIGNALS
from mrdamp.simulation.roads import Road, read_road
from mrdamp.structures import ShearFrame
from mrdamp.structures.cars import QuarterCar

#: RMS over the scales under the default loads and commands that change evenly between none and the largest.
_TYPICAL = {
    "acceleration": 0.65, "displacement": 0.5, "drift": 0.45, "stroke": 0.4, "stroke_velocity": 0.5, "force": 0.6,
    "true_force": 0.6, "current": 0.6,
}  # fmt: skip
_DRAWN = 5.0  # s, of the roads that a search draws: more of them for the same periods
# Sizes that the scales of the observation belong to, those on a rough road (class D): m/s2, m/s, m.
_BODY, _WHEEL, _VELOCITY, _STROKE, _TYRE = 3.0, 30.0, 0.5, 0.03, 0.01


def car_damper() -> Model:
    """The Lord RD-1005 of Lai and Liao 2002 (doi 10.1177/107754602023712): modified Bouc-Wen, 2 kN, 0 to 2 V.

    Without the preload of its accumulator, 21 N, which is part of what carries the body at rest.
    """
    found = sets.load("lai_liao2002_rd1005")
    effects = effects_from({k: v for k, v in found.attributes().items() if k not in found.parameters})
    return Model(found.law, {**found.parameters, "x0": 0.0}, effects, name=found.id)


@dataclass(frozen=True)
class Car(Structure):
    """A quarter car with a damper.

    car: None is that of `QuarterCar`, or numbers by name. model: any identified one or its file, None: `car_damper`;
    effects with a place in a frame are left out. Raises InputError.
    """

    car: QuarterCar = None  # type: ignore[assignment]
    model: Model | Path | str | None = None

    name, option, more, source, Source = "car", "road", ("speed",), "roads", RoadSource
    weights = CarReward
    engines = {"mujoco": (CarRows, 5e-4), "chain": (CarChain, 1e-3)}  # noqa: RUF012
    typical, drawn_size = _TYPICAL, 0.05
    #: Share of the dynamic tyre load in the score, the rest is comfort's; as `mrdamp compare car` tunes.
    scored = {"holding": 0.5}  # noqa: RUF012
    #: The same scores as at .5 ms within .1 %.
    searched = 1e-3

    def __post_init__(self) -> None:
        require_kind("a QuarterCar, or numbers by name", (QuarterCar, Mapping), car=self.car)
        car = QuarterCar(**self.car) if isinstance(self.car, Mapping) else self.car or QuarterCar()
        object.__setattr__(self, "car", car)
        object.__setattr__(self, "model", model_of(self.model, car_damper))

    @cached_property
    def models(self) -> tuple[Model, ...]:
        model = model_of(self.model, car_damper)
        own = replace(model, effects=tuple(e for e in model.effects if e.place is None))
        return frame_models(own, self.car.frame, [(1, 2)])

    @property
    def frame(self) -> ShearFrame:
        """The car as a frame."""
        return self.car.frame

    @property
    def names(self) -> tuple[str, ...]:
        whats = ("acceleration", "displacement", "velocity", "drift")
        return (*(f"{what}_{j}" for what in whats for j in (1, 2)), *SIGNALS[:-1])

    load_names = ("road",)

    def mjcf(self, timestep: float, *, drawn: bool = False) -> str:
        return car_xml(self.car, self.models[0], timestep, drawn=drawn)

    def loads(self) -> RoadSource:
        return IsoRoads()

    @property
    def first(self) -> float:
        return self.car.bounce

    @classmethod
    def criteria(cls, **scored: float) -> tuple[Criterion, ...]:
        holding = scored["holding"]
        return Criterion("comfort_ratio", 1.0 - holding, 0, 0.5), Criterion("load_ratio", holding, 1, 0.5)

    def training(self) -> TrainingRoads:
        return TrainingRoads()

    def some(self, rng: np.random.Generator, count: int, spread: float = 0.0) -> list[Road]:
        return TrainingRoads(10.0 if spread else _DRAWN).some(rng, count, spread=spread)

    def validation(self) -> list[Road]:
        return validation_roads()

    def controller(self, spec: str, command_max: float, period: float, force_max: float) -> Controller:
        damper = model_of(self.model, car_damper)  # alone: inverse models are of a damper, not of a frame
        return registry.make(spec, CarSite(self.car, damper, command_max, force_max, period))

    def load(self, rng: np.random.Generator, source: RoadSource, options: Mapping[str, Any]) -> Road:
        road, speed = options.get("road"), options.get("speed")
        if road is None:
            road = source.draw(rng)
        elif not isinstance(road, Road):
            require_kind("a Road, or its file", (Road, str, Path), road=road)
            if speed is None:
                raise InputError("reset: give the speed (m/s) beside a road file")
            road = read_road(road, float(speed))
        if speed is not None:
            road = replace(road, speed=float(speed))
        return road

    def forces(self, load: Road) -> Array:
        return load.height[:, None]

    def reference(
        self, given: Array, load: Road, timestep: float, weights: CarReward, command_max: float, period: float
    ) -> Array:
        return reference_run(self.car, given, timestep)

    def told(self, load: Road, reference: Sequence[float] | Array) -> dict[str, Any]:
        names = ("reference_acceleration", "reference_load", "reference_stroke")
        return {"speed": load.speed, **dict(zip(names, np.sqrt(reference).tolist(), strict=True))}

    def reference_motion(self, values: Array) -> float:
        """RMS stroke, m."""
        return math.sqrt(values[2])

    def view(self, task: Task, camera: str, size: tuple[int, int]) -> CarView:
        plants = task.rows.plants

        def ahead(places: Array) -> Array:
            road: Road = task.rows.of(0).roads[0]
            return road.at(plants.timestep * plants.step[0] + places / road.speed)

        return CarView(self.car, self.models[0], ahead, camera, size)

    def sensors(self, command_max: Array, full_state: bool) -> tuple[list[str], dict[str, float]]:
        """Accelerations of body and wheel, stroke and force of the damper.

        full_state: the stroke's velocity, the tyre's deflection and the coil's current besides. The scales are sizes on
        a rough road; of the force, the damper's in the body's bounce of 3 cm at the largest command.
        """
        more = ["stroke_velocity", "drift_1", "current"] if full_state else []
        scale = {
            "acceleration_1": _WHEEL, "acceleration_2": _BODY, "stroke": _STROKE, "stroke_velocity": _VELOCITY,
            "displacement_1": _TYRE, "displacement_2": _STROKE, "velocity_1": _VELOCITY, "velocity_2": _VELOCITY,
            "drift_1": _TYRE, "drift_2": _STROKE,
            "current": float(command_max[0]),
        }  # fmt: skip
        force = largest_force(self.models[0], _STROKE, self.car.bounce, float(command_max[0]))
        scale |= {"force": force, "true_force": force}
        return ["acceleration_2", "acceleration_1", "stroke", *more, "force"], scale


class CarTask(KindTask):
    """n quarter cars on roads; arguments as in `CarEnv`."""

    kind = Car
    structure: Car
