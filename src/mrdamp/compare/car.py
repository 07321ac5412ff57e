"""A quarter car on roads: one run, what is kept of it, and what tuning tries."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mrdamp import __version__
from mrdamp.compare import own as outside
from mrdamp.compare.bench import ELECTRIC, UNCONTROLLED, Measure, digest
from mrdamp.compare.frame import specs
from mrdamp.compare.plant_run import PlantBench, require_periods, run_plant
from mrdamp.control import car as controllers
from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.car_plant import CarSite
from mrdamp.control.told import knowledge
from mrdamp.envs.car_reward import linear_run
from mrdamp.envs.car_rows import PERIOD
from mrdamp.envs.car_task import CarPlant, CarTask, car_damper
from mrdamp.errors import InputError
from mrdamp.library import library_path
from mrdamp.model import Model
from mrdamp.simulation.roads import Road, bump, iso8608
from mrdamp.structures.cars import QuarterCar

_VERSION = 3
#: Class, speed (m/s) and seed of the roads; seeds from nine million on are for judging alone, at other speeds.
_TUNING = (("B", 25.0, 301), ("C", 15.0, 302), ("C", 25.0, 303), ("D", 10.0, 304))
_UNSEEN = (
    ("A", 30.0, 9_000_201), ("B", 20.0, 9_000_202), ("B", 30.0, 9_000_203), ("C", 12.0, 9_000_204),
    ("C", 20.0, 9_000_205), ("C", 28.0, 9_000_206), ("D", 8.0, 9_000_207), ("D", 18.0, 9_000_208),
)  # fmt: skip
_DURATION = 12.0  # s
_TUNED = {
    "best-constant": "constant",
    "skyhook-switch-tuned": "skyhook-switch",
    "skyhook-tuned": "skyhook",
    "groundhook-tuned": "groundhook",
    "hybrid-tuned": "hybrid",
    "add-tuned": "add",
    "sh-add-tuned": "sh-add",
    "clipped-lq-tuned": "clipped-lq",
    "lq-tracking-tuned": "lq-tracking",
    "clipped-mpc-tuned": "clipped-mpc",
}
_MPC = "clipped-mpc"
_DEFAULT = (
    "passive-off",
    "passive-on",
    "best-constant",
    "skyhook-switch-tuned",
    "skyhook-tuned",
    "groundhook-tuned",
    "hybrid-tuned",
    "add-tuned",
    "sh-add-tuned",
    "clipped-lq-tuned",
    "lq-tracking-tuned",
    "clipped-mpc-tuned",
)


@dataclass(frozen=True)
class CarBench(PlantBench):
    """A quarter car with its damper. Raises InputError."""

    car: QuarterCar = field(default_factory=QuarterCar)
    model: Model = field(default_factory=car_damper, kw_only=True)
    timestep: float = field(default=5e-4, kw_only=True)

    environment: ClassVar[str] = "car"
    options: ClassVar[Mapping[str, Mapping[str, float]]] = controllers.OPTIONS
    reference: ClassVar[str] = "the linear suspension, a dashpot of .3 of critical"
    measures: ClassVar[tuple[Measure, ...]] = (
        Measure("comfort", "weighted acceleration", ratio=True),
        Measure("load", "dynamic tyre load", ratio=True),
        Measure("stroke", "RMS stroke", ratio=True),
        Measure("acceleration", "weighted acceleration (m/s2)"),
        Measure("load_share", "dynamic tyre load over static"),
        Measure("airborne", "without contact (%)"),
        Measure("peak_stroke", "peak stroke (mm)"),
        *ELECTRIC,
        Measure("dissipated_energy", "dissipated (J)"),
    )
    headline: ClassVar[tuple[str, ...]] = (
        "comfort",
        "load",
        "stroke",
        "airborne",
        "mean_command",
        "switching_rate",
    )
    claimed: ClassVar[tuple[str, ...]] = ("comfort", "load", "mean_command")
    tuning_amplitudes: ClassVar[tuple[float, ...]] = (1.0,)
    unseen_amplitudes: ClassVar[tuple[float, ...]] = (1.0,)
    #: The largest command makes the suspension nearly rigid: the way to a bound begins at none.
    base: ClassVar[str] = "passive-off"
    #: The trade-off that is tuned for, and one near comfort alone; its weights are a choice.
    bounds: ClassVar[Mapping[str, Mapping[str, float]]] = {
        "clairvoyant": {"comfort": 0.5, "load": 0.5},
        "clairvoyant-comfort": {"comfort": 0.9, "load": 0.1},
    }

    @property
    def tuned(self) -> Mapping[str, str]:
        return {name: kind for name, kind in _TUNED.items() if kind != _MPC or _solver()}

    @property
    def default(self) -> tuple[str, ...]:
        """Without clipped MPC where its solver is not installed."""
        return tuple(name for name in _DEFAULT if _TUNED.get(name) != _MPC or _solver())

    @cached_property
    def site(self) -> CarSite:
        """What controllers are made for."""
        largest = self.command_max
        force = registry.Site(self.car.frame, self.model, largest, self.period).force_max()
        return CarSite(self.car, self.model, largest, force, self.period)

    def run(self, spec: str, load: Road, amplitude: float) -> dict[str, Any]:
        if spec == UNCONTROLLED:
            road = load.scaled(amplitude)
            require_periods(road, self.period)
            time = np.arange(0.0, road.duration, self.timestep)
            square = [float(np.mean(x * x)) for x in linear_run(self.car, road.at(time), self.timestep)]
            return dict(zip(PERIOD[:3], square, strict=True))
        return self.driven(self.controller(spec), load, amplitude)

    def controller(self, spec: str) -> Controller:
        return outside.make(spec, self.site, controllers.make, partial(CarTask, car=self.car, model=self.model))

    def driven(self, controller: Controller, load: Road, amplitude: float) -> dict[str, Any]:
        """What is kept of a controller's run. Raises InputError."""
        run = run_plant(self.plant, load.scaled(amplitude), controller, self.period)
        mean = dict(zip(PERIOD, run.of_period.mean(axis=0).tolist(), strict=True))
        if not all(map(math.isfinite, mean.values())):
            raise InputError(f"{self.model.name}: the simulation diverged; check the car and the road's unit")
        return {
            **{key: mean[key] for key in ("comfort", "load", "stroke", "airborne")},
            "peak_stroke": 1e3 * float(run.of_period[:, PERIOD.index("stroke_peak")].max()),
            "dissipated_energy": float(run.of_period[:, PERIOD.index("energy")].sum()),
            **run.electric(self.command_unit, self.site.command_max),
        }

    def plant(self, period: float) -> CarPlant:
        return CarPlant(self.car, self.model, period=period, timestep=self.timestep, engine=self.engine)

    def values(self, kept: Mapping[str, Any], uncontrolled: Mapping[str, Any]) -> Mapping[str, float]:
        ratios = {key: math.sqrt(kept[key] / uncontrolled[key]) for key in PERIOD[:3]}
        own = {"acceleration": math.sqrt(kept["comfort"]), "load_share": math.sqrt(kept["load"])}
        return {**kept, **own, **ratios, "airborne": 100 * kept["airborne"]}

    def grid(self, kind: str) -> tuple[str, ...]:
        largest, critical = self.site.command_max, self.car.critical_damping
        dampings = [critical * k for k in (0.05, 0.1, 0.2, 0.4, 0.6, 1.0)]
        levels = [0.025, 0.05, 0.1, 0.2, 0.4, 1.0]
        weights: Mapping[str, Sequence[float]] = {
            "holding": [0.03, 0.1, 0.3, 1.0],
            "stroke": [0.01, 0.1, 0.3],
            "r": [1e-2, 1e-1, 1.0],
        }
        choices: Mapping[str, Mapping[str, Sequence[float]]] = {
            "constant": {"value": [largest * k / 20 for k in (0, 0.5, 1, 1.5, 2, 3, 4, 6, 12, 20)]},
            "skyhook-switch": {"level": levels},
            "skyhook": {"damping": dampings},
            "groundhook": {"damping": dampings},
            "hybrid": {"damping": dampings, "share": [0.25, 0.5, 0.75]},
            "add": {"level": levels},
            "sh-add": {"alpha": [1.5, 3.0, 6.0, 12.0, 24.0], "level": levels},
            "clipped-lq": {"holding": weights["holding"], "r": [1e-2, 1.0], "level": levels[1:5]},
            "lq-tracking": weights,
            "clipped-mpc": {"holding": weights["holding"], "stroke": [0.1], "r": [1e-2, 1e-1, 1.0]},
        }
        return specs(kind, choices)

    def score(self, values: Mapping[str, float]) -> float:
        """The mean of weighted acceleration and dynamic tyre load, over those of the linear suspension."""
        return (values["comfort"] + values["load"]) / 2

    def tuning_loads(self) -> tuple[Road, ...]:
        return (*_roads(_TUNING), bump(0.06, 1.5, 8.0))

    def unseen_loads(self) -> tuple[Road, ...]:
        return (*_roads(_UNSEEN), bump(0.08, 1.0, 6.0), bump(0.05, 4.0, 20.0))

    def key(self, spec: str, load: Road, amplitude: float) -> str:
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("model", "car")}
        parts = [_VERSION, __version__, own, asdict(self.car), self.model.to_dict()]
        digest = hashlib.sha256(json.dumps([*parts, spec, amplitude, load.speed, load.spacing]).encode())
        digest.update(load.height.tobytes() + Path(library_path()).read_bytes() + outside.files_of(spec))
        return digest.hexdigest()[:32]

    def identity(self) -> str:
        loads = [load.name for load in self.tuning_loads()]
        return digest([asdict(self.car), self.model.to_dict()["model"], self.period, self.timestep, loads])

    def about(self) -> str:
        c = self.car
        return (
            f"{self.model.name} in a quarter car of {c.body:g} and {c.wheel:g} kg, control period "
            f"{1e3 * self.period:g} ms; ratios are over {self.reference}; {knowledge(self.model)}"
        )


def _solver() -> bool:
    return importlib.util.find_spec("osqp") is not None


def _roads(drawn: Sequence[tuple[str, float, int]]) -> tuple[Road, ...]:
    return tuple(iso8608(road_class, speed, _DURATION, seed) for road_class, speed, seed in drawn)
