"""A stay cable under ambient and wind loads: one run, what is kept of it, and what tuning tries."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from mrdamp.compare.bench import ELECTRIC, Measure
from mrdamp.compare.plant_run import PlantBench, PlantRun
from mrdamp.control.cable import CableSite
from mrdamp.control.told import knowledge
from mrdamp.envs.cable import Cable, cable_damper, default_places, free_run
from mrdamp.envs.loads import AmbientLoads, CableLoad, WindLoads
from mrdamp.model import Model
from mrdamp.structures.cables import StayCable

#: Seeds of the loads; from nine million on they are for judging alone.
_UNSEEN_SEED = 9_000_101
_SOURCES = (WindLoads(), AmbientLoads(), AmbientLoads(shape="uniform"))


@dataclass(frozen=True)
class CableBench(PlantBench):
    """A cable with its damper. timestep: as that of the environment. Raises InputError."""

    cable: StayCable = field(default_factory=StayCable)
    model: Model = field(default_factory=cable_damper, kw_only=True)
    timestep: float = field(default=Cable.engines["mujoco"][1], kw_only=True)

    measures: ClassVar[tuple[Measure, ...]] = (
        Measure("motion", "RMS motion", ratio=True),
        Measure("peak_force", "peak force (N)"),
        *ELECTRIC,
        Measure("dissipated_energy", "dissipated (J)"),
    )
    headline: ClassVar[tuple[str, ...]] = ("motion", "peak_force", "mean_command", "switching_rate")
    claimed: ClassVar[tuple[str, ...]] = ("motion", "mean_command")
    objective: ClassVar[Mapping[str, tuple[str, float]]] = {"motion": ("motion_ratio", 1.0)}
    #: The motion is that of half of it within .001.
    tuning_step: ClassVar[float] = 2.5e-4
    bounds: ClassVar[Mapping[str, Mapping[str, float]]] = {"clairvoyant": {"motion": 1.0}}

    @cached_property
    def structure(self) -> Cable:
        return Cable(self.cable, self.model)

    @cached_property
    def site(self) -> CableSite:
        largest = self.command_max
        return CableSite(
            self.cable, largest, default_places(self.cable), self._force_max(largest), self.period, self.model
        )

    def uncontrolled(self, load: CableLoad) -> dict[str, Any]:
        free = free_run(self.cable, self.cable.forces(load.force, load.places), load.sample_time)
        return {"motion": math.sqrt(float(free[0]))}

    def kept(self, run: PlantRun) -> dict[str, Any]:
        force = run.force
        return {
            "motion": math.sqrt(float(run.of_period[:, 0].mean())),
            "peak_force": float(np.abs(force).max()),
            "dissipated_energy": float(np.sum((force[1:] + force[:-1]) / 2 * np.diff(run.stroke))),
        }

    def values(self, kept: Mapping[str, Any], uncontrolled: Mapping[str, Any]) -> Mapping[str, float]:
        return {**kept, "motion": kept["motion"] / uncontrolled["motion"]}

    def effort(self, kind: str) -> tuple[int, int]:
        """Every source is among the loads; inverse models are slow."""
        return 2, 1_000_000 if kind == "force-tracking" else 3_000_000

    def unseen_loads(self) -> tuple[CableLoad, ...]:
        rng = np.random.default_rng(_UNSEEN_SEED)
        drawn = [source.draw(rng, self.cable.length) for _ in range(2) for source in _SOURCES]
        return tuple(replace(load, name=f"{load.name}_{k + 1}") for k, load in enumerate(drawn))

    def own_identity(self) -> list[Any]:
        return [asdict(self.cable), self.model.to_dict()["model"], self.period, self.timestep]

    def about(self) -> str:
        c = self.cable
        return (
            f"{self.model.name} on a cable of {c.length:g} m, {c.first / (2 * math.pi):.2f} Hz, at {c.damper_at:g} of "
            f"its length, control period {1e3 * self.period:g} ms; {knowledge(self.model)}"
        )

    def _force_max(self, largest: float) -> float:
        """N at the largest command, in a slow motion of 1 % of the damper's distance from the anchorage."""
        dt, n = 1e-3, 2000
        x = 0.01 * self.cable.damper_at * self.cable.length * np.sin(self.cable.first * dt * np.arange(n))
        run = self.model.simulate(dt, {"displacement_m": x, "command": np.full(n, largest)})
        return float(np.abs(run["force_N"]).max())
