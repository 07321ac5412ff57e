"""Quarter cars on roads: damper, what is measured and rewarded, and `mrdamp/QuarterCar-v0`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mrdamp import sets
from mrdamp.control import registry
from mrdamp.control.car import CarSite
from mrdamp.envs.frame_rows import CarChain, CarRows
from mrdamp.envs.frame_xml import CarView, car_xml, frame_models
from mrdamp.envs.loads import IsoRoads, RoadSource
from mrdamp.envs.options import model_of
from mrdamp.envs.plant_env import KindPlant, PlantEnv
from mrdamp.envs.structure import Part, Structure, Total, Weights, floor_names, largest_force, of_dampers
from mrdamp.envs.task import KindTask, Task
from mrdamp.envs.training_loads import TrainingRoads, validation_roads
from mrdamp.errors import InputError, require_kind
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.criteria import wk
from mrdamp.simulation.roads import Road, read_road
from mrdamp.structures import ShearFrame
from mrdamp.structures.lumped import QuarterCar

_PARTS, _TOTALS = of_dampers(5)
#: Of critical: the dashpot of the linear suspension. Passenger cars have .2 to .4 (T. D. Gillespie, Fundamentals of
#: Vehicle Dynamics, SAE 1992, chapter 5).
CONVENTIONAL = 0.3


@dataclass(frozen=True)
class CarReward(Weights):
    """Weights of the reward's parts.

    With a, l and s the RMS over a control period of the body's acceleration weighted by Wk (ISO 2631-1), of the dynamic
    tyre load and of the stroke, each over its RMS on the whole of the same road with a linear suspension (a dashpot of
    .3 of critical, a tyre that never lifts off), and i the coil current over the largest command:

    | part | of a control period | over an episode of T |
    |---|---|---|
    | comfort | a^exponent / T | -100 comfort mean(a^exponent) |
    | holding | l^exponent / T | -100 holding mean(l^exponent) |
    | stroke | s^exponent / T | -100 stroke mean(s^exponent) |
    | airborne | the share of it without contact / T | -100 airborne mean(share) |
    | current | i / T | -100 current mean(i) |
    | power | i^2 / T, the coil's heat over that at the largest current | -100 power mean(i^2) |

    The default return is -50 times the sum of the squares of `comfort_ratio` and `load_ratio`, which `mrdamp compare`
    reports: -100 with the linear suspension.
    """

    comfort: float = 0.5
    holding: float = 0.5
    stroke: float = 0.0
    airborne: float = 0.0

    table: ClassVar[tuple[Part, ...]] = (
        Part("comfort", 0, 0, 0.5), Part("holding", 1, 1, 0.5), Part("stroke", 2, 2, 0.5), Part("airborne", 4), *_PARTS,
    )  # fmt: skip
    totals: ClassVar[tuple[Total, ...]] = (
        *(Total(name, k, "rms", k) for k, name in enumerate(("weighted_acceleration", "rms_load", "rms_stroke"))),
        *(Total(f"{name}_ratio", k, "rms", k, ratio=True) for k, name in enumerate(("comfort", "load", "stroke"))),
        Total("peak_stroke", 3, "peak"), Total("airborne", 4, "mean"), *_TOTALS,
    )  # fmt: skip


def linear_run(car: QuarterCar, heights: Array, step: float) -> tuple[Array, Array, Array]:
    """Weighted acceleration (m/s2), dynamic tyre load over the weight, stroke (m) of the linear suspension, (n,) each.

    heights: (n,) m under the wheel, straight between samples every step (s), from rest. In the frequency domain, exact
    but for what lies above half the sampling frequency.
    """
    a, b, c, d = car.passive(CONVENTIONAL * car.critical_damping)
    many = len(heights)
    rest = float(np.linalg.eigvals(a).real.max())  # of the slowest pole, 1/s
    behind = int(min(12.0 / max(-rest, 1e-3), 60.0) / step)
    f = np.fft.rfftfreq(many + behind, step)
    velocity = np.append(np.diff(heights), 0.0) / step
    # Held over each step: its spectrum is that of the samples times this.
    given = np.fft.rfft(velocity, many + behind) * np.sinc(f * step) * np.exp(-1j * np.pi * f * step)
    resolvent = np.linalg.solve(2j * np.pi * f[:, None, None] * np.eye(4) - a, b.astype(np.complex128))
    out = (c @ resolvent + d)[:, :, 0].T * given
    out[0] *= wk(np.maximum(f, 1e-9))
    found = np.fft.irfft(out, many + behind, axis=1)[:, :many]
    return found[0], found[1], found[2]


def reference_run(car: QuarterCar, heights: Array, step: float) -> Array:
    """(3,) mean squares of `linear_run`. Raises InputError where the road is flat."""
    if not np.ptp(heights) > 0:
        raise InputError("the road is flat throughout; there is nothing to control")
    return np.array([np.mean(x * x) for x in linear_run(car, heights, step)])


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
    found = sets.load("lai_liao2002_rd1005").model()
    return replace(found, parameters={**found.parameters, "x0": 0.0})


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

    names = floor_names(2, 1)
    load_names = ("road",)

    def mjcf(self, timestep: float, *, drawn: bool = False) -> str:
        return car_xml(self.car, self.models[0], timestep, drawn=drawn)

    def loads(self) -> RoadSource:
        return IsoRoads()

    @property
    def first(self) -> float:
        return self.car.bounce

    @classmethod
    def criteria(cls, **scored: float) -> Mapping[str, float]:
        return {"comfort_ratio": 1.0 - scored["holding"], "load_ratio": scored["holding"]}

    def training(self) -> TrainingRoads:
        return TrainingRoads()

    def some(self, rng: np.random.Generator, count: int, spread: float = 0.0) -> list[Road]:
        return TrainingRoads(10.0 if spread else _DRAWN).some(rng, count, spread=spread)

    def validation(self) -> list[Road]:
        return validation_roads()

    def site(self, command_max: float, period: float, force_max: float | None = None) -> CarSite:
        damper = model_of(self.model, car_damper)  # alone: inverse models are of a damper, not of a frame
        force = registry.largest_force(damper, command_max) if force_max is None else force_max
        return CarSite(self.car, damper, command_max, force, period)

    def load(self, rng: np.random.Generator, source: RoadSource, options: Mapping[str, Any]) -> Road:
        road, speed = options.get("road"), options.get("speed")
        if road is None:
            road = source.draw(rng)
        elif not isinstance(road, Road):
            require_kind("a Road, or its file", (Road, str, Path), road=road)
            if speed is None:
                raise InputError("reset: give the speed (m/s) beside a road file")
            road = read_road(road, float(speed))
        return road if speed is None else road.at_speed(float(speed))

    def forces(self, load: Road) -> Array:
        return load.height[:, None]

    def reference(self, given: Array, load: Road, task: Task) -> Array:
        return reference_run(self.car, given, task.rows.plants.timestep)

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


class CarPlant(KindPlant):
    """A quarter car with a damper, in MuJoCo or on the chain (engine), for any controller, without rewards.

    Floor 1 of the measurements is the wheel, 2 the body; displacements and velocities are those to the road.
    Arguments: fields of `Car`, and those of `RowOptions` by name. Raises InputError.
    """

    kind = Car


class CarEnv(PlantEnv):
    """
    ## Description

    A quarter car on a road: a wheel on its tyre, and a body on the suspension's spring, with a magnetorheological
    damper in parallel. The action is the current of the damper's coil, which its driver follows with a lag. The aim is
    small body acceleration as people perceive it (ISO 2631-1), a tyre load near its static value, and little current.
    The tyre transmits no tension: the wheel lifts off if its load would fall below zero. The damper is the MuJoCo
    plugin `mrdamp.damper`, by default the Lord RD-1005 (2 kN, 0 to 2 V) of Lai and Liao (Journal of Vibration and
    Control 8 (2002) 527-547, doi 10.1177/107754602023712). The car's masses and stiffnesses are those of doi
    10.1155/2021/8084343 (`mrdamp.structures.lumped.QuarterCar`).

    The physics is that of `models_xml/quarter_car/model.xml`.

    Spaces, starting state, episode end and the arguments of every environment are those of `PlantEnv`. The damper's
    transmission is the joint `suspension`.

    ## Observation Space

    With the defaults:

    | Num | Observation | Name (in the XML file) | Joint | Unit before scaling |
    |-----|-------------|------------------------|-------|------|
    | 0 | vertical acceleration of the body | acceleration_2 | suspension | m/s2 |
    | 1 | vertical acceleration of the wheel | acceleration_1 | tyre | m/s2 |
    | 2 | stroke of the damper | stroke | suspension | m |
    | 3 | force of the damper, by its own sensor | force | suspension | N |
    | 4 | command held in the period that ended | damper | suspension | A or V |

    Other `signals`: `displacement_j`, `velocity_j` (of wheel, 1, and body, 2, to the road), `drift_1` (deflection of
    the tyre, m), `drift_2`, `stroke_velocity`, `current`, `true_force`. `full_state=True` adds the stroke's velocity,
    the tyre's deflection and the current.

    ## Rewards

    The sum of the parts of `mrdamp.envs.car.CarReward`, each in `info` as `reward_` and its name. By default the return
    is -50 times the sum of the squares of `comfort_ratio` and `load_ratio`, -100 with the linear suspension (a dashpot
    of .3 of critical), and the current is free.

    `info` also has, since the episode's start: `weighted_acceleration` (RMS, m/s2), `rms_load` (of the dynamic tyre
    load, over the weight), `rms_stroke`, `peak_stroke` (m), `comfort_ratio`, `load_ratio`, `stroke_ratio` (over the
    linear suspension's), `airborne` (share of the time without contact), `mean_current` (A or V), `mean_power` (over
    that at the largest current), `dissipated_energy` (J). The `info` of `reset`: `road`, `speed` (m/s), `duration` (s),
    `reference_acceleration` (m/s2), `reference_load`, `reference_stroke` (m).

    ## Starting State

    `reset(options={"road": Road or file, "speed": m/s, "amplitude": factor})`.

    ## Arguments

    | Parameter | Type | Default | Description |
    |-----------|------|---------|-------------|
    | `car` | `QuarterCar`, mapping | doi 10.1155/2021/8084343 | masses, stiffnesses, damping |
    | `model` | `Model`, path, set's name | the RD-1005 | any identified one: law, NARX, effects |
    | `roads` | `RoadSource` | `IsoRoads()` | classes of ISO 8608 by speed, `Bumps`, `RecordedRoads`, your own |
    | `reward` | `CarReward`, mapping | `CarReward()` | weights of the parts, exponent |
    | `timestep` | s | 0.0005, chain: 0.001 | the largest of the engine, 0.002 at most |
    | `camera` | str | corner | `front`, `corner`, `damper` |
    """

    kind = Car
