"""A quarter car on roads: one run, what is kept of it, and what tuning tries."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mrdamp.compare.bench import ELECTRIC, Measure, require_periods
from mrdamp.compare.plant_run import PlantBench, PlantRun
from mrdamp.control.car import CarSite
from mrdamp.control.registry import largest_force
from mrdamp.control.told import knowledge
from mrdamp.envs.car import Car, car_damper, linear_run
from mrdamp.envs.frame_rows import PERIOD
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.simulation.roads import Road, bump, iso8608, read_road
from mrdamp.structures.cars import QuarterCar

#: Class, speed (m/s) and seed of the roads; seeds from nine million on are for judging alone, at other speeds.
_UNSEEN = (
    ("A", 30.0, 9_000_201), ("B", 20.0, 9_000_202), ("B", 30.0, 9_000_203), ("C", 12.0, 9_000_204),
    ("C", 20.0, 9_000_205), ("C", 28.0, 9_000_206), ("D", 8.0, 9_000_207), ("D", 18.0, 9_000_208),
)  # fmt: skip
_DURATION = 12.0  # s
_MPC = "clipped-mpc"
_TUNED = {"best-constant": "constant"} | {
    f"{kind}-tuned": kind
    for kind in (
        "skyhook-switch", "skyhook", "groundhook", "hybrid", "add", "sh-add", "clipped-lq", "lq-tracking", _MPC,
    )
}  # fmt: skip


@dataclass(frozen=True)
class CarBench(PlantBench):
    """A quarter car with its damper. Raises InputError."""

    car: QuarterCar = field(default_factory=QuarterCar)
    model: Model = field(default_factory=car_damper, kw_only=True)

    reference: ClassVar[str] = "the linear suspension, a dashpot of .3 of critical"
    measures: ClassVar[tuple[Measure, ...]] = (
        Measure("comfort", "weighted acceleration", ratio=True),
        Measure("load", "dynamic tyre load", ratio=True),
        Measure("stroke", "RMS stroke", ratio=True),
        Measure("acceleration", "weighted acceleration (m/s2)"),
        Measure("load_share", "dynamic tyre load over static"),
        Measure("airborne", "without contact (%)"),
        Measure("peak_stroke", "peak stroke (m)"),
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
    #: The mean of weighted acceleration and dynamic tyre load, over those of the linear suspension.
    objective: ClassVar[Mapping[str, tuple[str, float]]] = {
        "comfort": ("comfort_ratio", 0.5),
        "load": ("load_ratio", 0.5),
    }
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
        """Without clipped MPC where its solver is not installed."""
        solver = importlib.util.find_spec("osqp") is not None
        return {name: kind for name, kind in _TUNED.items() if kind != _MPC or solver}

    @property
    def default(self) -> tuple[str, ...]:
        return "passive-off", "passive-on", *self.tuned

    @cached_property
    def structure(self) -> Car:
        return Car(self.car, self.model)

    @cached_property
    def site(self) -> CarSite:
        largest = self.command_max
        return CarSite(self.car, self.model, largest, largest_force(self.model, largest), self.period)

    def uncontrolled(self, load: Road) -> dict[str, Any]:
        require_periods(load, self.period)
        time = np.arange(0.0, load.duration, self.timestep)
        square = [float(np.mean(x * x)) for x in linear_run(self.car, load.at(time), self.timestep)]
        return dict(zip(PERIOD[:3], square, strict=True))

    def kept(self, run: PlantRun) -> dict[str, Any]:
        mean = dict(zip(PERIOD, run.of_period.mean(axis=0).tolist(), strict=True))
        return {
            **{key: mean[key] for key in ("comfort", "load", "stroke", "airborne")},
            "peak_stroke": float(run.of_period[:, PERIOD.index("stroke_peak")].max()),
            "dissipated_energy": float(run.of_period[:, PERIOD.index("energy")].sum()),
        }

    def values(self, kept: Mapping[str, Any], uncontrolled: Mapping[str, Any]) -> Mapping[str, float]:
        ratios = {key: math.sqrt(kept[key] / uncontrolled[key]) for key in PERIOD[:3]}
        own = {"acceleration": math.sqrt(kept["comfort"]), "load_share": math.sqrt(kept["load"])}
        return {**kept, **own, **ratios, "airborne": 100 * kept["airborne"]}

    def effort(self, kind: str) -> tuple[int, int]:
        """Every class of roads is among the loads; inverse models are slow."""
        quick = kind in ("constant", "skyhook-switch", "add", "sh-add", "clipped-lq")
        return 7, 3_000_000 if quick else 1_000_000

    def unseen_loads(self) -> tuple[Road, ...]:
        drawn = (iso8608(road_class, speed, _DURATION, seed) for road_class, speed, seed in _UNSEEN)
        return (*drawn, bump(0.08, 1.0, 6.0), bump(0.05, 4.0, 20.0))

    def read(self, files: Sequence[Path], speed: float) -> list[Road]:
        roads = [read_road(file, speed) for file in files]
        for file, road in zip(files, roads, strict=True):
            if not np.ptp(road.height) > 0:
                raise InputError(f"{file}: the road is flat throughout; there is nothing to control")
        return roads

    def own_identity(self) -> list[Any]:
        return [asdict(self.car), self.model.to_dict()["model"], self.period, self.timestep]

    def about(self) -> str:
        c = self.car
        return (
            f"{self.model.name} in a quarter car of {c.body:g} and {c.wheel:g} kg, control period "
            f"{1e3 * self.period:g} ms; ratios are over {self.reference}; {knowledge(self.model)}"
        )
