"""A stay cable under ambient and wind loads: one run, what is kept of it, and what tuning tries."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mrdamp import __version__
from mrdamp.compare import own as outside
from mrdamp.compare.bench import (
    DEFAULT,
    ELECTRIC,
    TUNED,
    UNCONTROLLED,
    WITHOUT,
    Measure,
    Ranges,
    digest,
    of_kind,
)
from mrdamp.compare.motions import UNSEEN_AMPLITUDES
from mrdamp.compare.plant_run import PlantBench, PlantRun, run_plant
from mrdamp.control import cable as controllers
from mrdamp.control.base import Controller
from mrdamp.control.told import knowledge
from mrdamp.envs.cable_loads import AmbientLoads, CableLoad, WindLoads
from mrdamp.envs.cable_reward import free_run
from mrdamp.envs.cable_task import CablePlant, CableTask, cable_damper, default_places
from mrdamp.envs.chain_rows import CABLES
from mrdamp.library import library_path
from mrdamp.model import Model
from mrdamp.structures.cables import StayCable
from mrdamp.train.loads import validation_loads

_VERSION = 3
#: s, of the engine's step at least while controllers are tuned: the motion is that of half of it within .001.
_TUNING_STEP = 2.5e-4
#: Seeds of the loads; from nine million on they are for judging alone.
_UNSEEN_SEED = 9_000_101
_SOURCES = (WindLoads(), AmbientLoads(), AmbientLoads(shape="uniform"))


@dataclass(frozen=True)
class CableBench(PlantBench):
    """A cable with its damper. timestep: as that of the environment. Raises InputError."""

    cable: StayCable = field(default_factory=StayCable)
    model: Model = field(default_factory=cable_damper, kw_only=True)
    timestep: float = field(default=CABLES["mujoco"][1], kw_only=True)

    environment: ClassVar[str] = "cable"
    options: ClassVar[Mapping[str, Mapping[str, float]]] = controllers.OPTIONS
    measures: ClassVar[tuple[Measure, ...]] = (
        Measure("motion", "RMS motion", ratio=True),
        Measure("peak_force", "peak force (N)"),
        *ELECTRIC,
        Measure("dissipated_energy", "dissipated (J)"),
    )
    headline: ClassVar[tuple[str, ...]] = ("motion", "peak_force", "mean_command", "switching_rate")
    claimed: ClassVar[tuple[str, ...]] = ("motion", "mean_command")
    tuned: ClassVar[Mapping[str, str]] = TUNED
    default: ClassVar[tuple[str, ...]] = DEFAULT
    objective: ClassVar[Mapping[str, tuple[str, float]]] = {"motion": ("motion_ratio", 1.0)}
    option: ClassVar[str] = "load"
    unseen_amplitudes: ClassVar[tuple[float, ...]] = UNSEEN_AMPLITUDES
    reference: ClassVar[str] = WITHOUT
    bounds: ClassVar[Mapping[str, Mapping[str, float]]] = {"clairvoyant": {"motion": 1.0}}

    @cached_property
    def site(self) -> controllers.CableSite:
        """What controllers are made for."""
        largest = self.command_max
        return controllers.CableSite(
            self.cable, largest, default_places(self.cable), self._force_max(largest), self.period, self.model
        )

    def run(self, spec: str, load: CableLoad, amplitude: float) -> dict[str, Any]:
        if spec == UNCONTROLLED:
            forces = self.plant(self.period).rows.forces(load.scaled(amplitude))
            free = free_run(self.cable, forces, load.sample_time)
            return {"motion": math.sqrt(float(free[0]))}
        return self.driven(self.controller(spec), load, amplitude)

    def controller(self, spec: str) -> Controller:
        return outside.make(spec, self.site, controllers.make, partial(CableTask, cable=self.cable, model=self.model))

    def driven(self, controller: Controller, load: CableLoad, amplitude: float) -> dict[str, Any]:
        """What is kept of a controller's run."""
        return self._kept(run_plant(self.plant, load.scaled(amplitude), controller, self.period))

    def values(self, kept: Mapping[str, Any], uncontrolled: Mapping[str, Any]) -> Mapping[str, float]:
        return {**kept, "motion": kept["motion"] / uncontrolled["motion"]}

    def ranges(self, kind: str) -> Ranges:
        c, force = self.cable, self.site.force_max
        best = 0.1 * c.mass * c.length * c.first / c.damper_at
        noise, level = {"noise_ratio": (0.1, 1e4)}, {"level": (0.1, 1.0)}
        optimal = {"r": (1e-11, 1e-6), **noise}
        ranges: Mapping[str, Ranges] = {
            "constant": {"value": (0.0, self.command_max)},
            "clipped-optimal": {**optimal, **level},
            "modulated-optimal": {**optimal, "force_max": (0.1 * force, 4.0 * force)},
            "force-tracking": optimal,
            "lyapunov": {**noise, **level},
            "max-dissipation": {**noise, **level},
            "skyhook": {"damping": (0.05 * best, 50.0 * best), "leak": (1.0 / c.first, 100.0 / c.first), **level},
        }
        return of_kind(ranges, kind)

    def effort(self, kind: str) -> tuple[int, int]:
        """Every source is among the loads; inverse models are slow."""
        return 2, 1_000_000 if kind == "force-tracking" else 3_000_000

    def task(self, n: int) -> CableTask:
        step = max(self.timestep, _TUNING_STEP)
        return CableTask(
            n, cable=self.cable, model=self.model, period=self.period, timestep=step, engine="chain", reward=None
        )

    def tuning_loads(self) -> tuple[CableLoad, ...]:
        return tuple(validation_loads(self.cable.length))

    def unseen_loads(self) -> tuple[CableLoad, ...]:
        return self._loads(_UNSEEN_SEED, 2)

    def key(self, spec: str, load: CableLoad, amplitude: float) -> str:
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("model", "cable")}
        parts = [_VERSION, __version__, own, asdict(self.cable), self.model.to_dict()]
        digest = hashlib.sha256(json.dumps([*parts, spec, amplitude, load.sample_time]).encode())
        digest.update(load.force.tobytes() + load.places.tobytes())
        digest.update(Path(library_path()).read_bytes())
        digest.update(outside.files_of(spec))
        return digest.hexdigest()[:32]

    def identity(self) -> str:
        loads = [load.name for load in self.tuning_loads()]
        steps = self.period, self.timestep
        return digest([asdict(self.cable), self.model.to_dict()["model"], *steps, loads])

    def about(self) -> str:
        c = self.cable
        return (
            f"{self.model.name} on a cable of {c.length:g} m, {c.first / (2 * math.pi):.2f} Hz, at {c.damper_at:g} of "
            f"its length, control period {1e3 * self.period:g} ms; {knowledge(self.model)}"
        )

    def plant(self, period: float) -> CablePlant:
        return CablePlant(self.cable, self.model, period=period, timestep=self.timestep, engine=self.engine)

    def _loads(self, seed: int, each: int) -> tuple[CableLoad, ...]:
        rng = np.random.default_rng(seed)
        drawn = [source.draw(rng, self.cable.length) for _ in range(each) for source in _SOURCES]
        return tuple(
            CableLoad(f"{load.name}_{k + 1}", load.sample_time, load.places, load.force)
            for k, load in enumerate(drawn)
        )

    def _force_max(self, largest: float) -> float:
        """N at the largest command, in a slow motion of 1 % of the damper's distance from the anchorage."""
        dt, n = 1e-3, 2000
        x = 0.01 * self.cable.damper_at * self.cable.length * np.sin(self.cable.first * dt * np.arange(n))
        return float(
            np.abs(
                self.model.simulate(dt, {"displacement_m": x, "command": np.full(n, largest)})["force_N"]
            ).max()
        )

    def _kept(self, run: PlantRun) -> dict[str, Any]:
        force = run.force
        return {
            "motion": math.sqrt(float(run.of_period[:, 0].mean())),
            "peak_force": float(np.abs(force).max()),
            "dissipated_energy": float(np.sum((force[1:] + force[:-1]) / 2 * np.diff(run.stroke))),
            **run.electric(self.command_unit, self.site.command_max),
        }
