"""Stay cables under ambient and wind loads: damper and loads, and what is measured and rewarded."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from mrdamp import sets
from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.cable import CableSite
from mrdamp.envs.cable_loads import CableLoad, LoadSource, WindLoads
from mrdamp.envs.cable_reward import CableReward, free_run
from mrdamp.envs.cable_rows import CableChain, CableRows
from mrdamp.envs.cable_xml import CableView
from mrdamp.envs.linear_xml import linear_xml
from mrdamp.envs.options import model_of
from mrdamp.envs.structure import Criterion, Structure
from mrdamp.envs.task import KindTask, Task
from mrdamp.envs.training_loads import CableLoads, validation_loads
from mrdamp.errors import InputError, require_kind
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.mjcf import SIGNALS
from mrdamp.structures.cables import StayCable
from mrdamp.structures.mechanics import Mechanics

#: RMS over the scales under the default loads and commands that change evenly between none and the largest.
_TYPICAL = {"acceleration_1": 10.0, "acceleration": 2.8, "force": 0.5, "true_force": 0.5, "current": 0.6}
_DRAWN = 12.0  # s, of the loads that a search draws
_LARGE = 0.002  # of the length: motion at mid-span that the scales of the observation belong to


def cable_damper() -> Model:
    """A small shear-mode damper that fits the laboratory cable: 4 to 21 N at 0.6 to 4 V (Zapateiro et al. 2010)."""
    found = sets.load("zapateiro_foam_bouc_wen")
    return Model(found.law, dict(found.parameters), name=found.id)


def default_places(cable: StayCable) -> tuple[float, ...]:
    """Default places of measurement: at the damper, and farther from the anchorage."""
    return (cable.damper_at, min(5 * cable.damper_at, 0.25))


@dataclass(frozen=True)
class Cable(Structure):
    """A stay cable with a damper.

    cable: None is the laboratory cable of `StayCable`. model: any identified one or its file, None: `cable_damper`.
    measured_at: places x / L where acceleration_1 ..., displacement_1 ... and velocity_1 ... are measured; the
    first is the damper's own by default. bandwidth: Hz, of the accelerometers there (`Accelerometers`); None: their
    readings are those of the coordinates at the instant. Raises InputError.
    """

    cable: StayCable = None  # type: ignore[assignment]
    model: Model | Path | str | None = None
    measured_at: Sequence[float] | None = None
    bandwidth: float | None = None

    name, Source, weights = "cable", LoadSource, CableReward
    engines = {"mujoco": (CableRows, 1.25e-4), "chain": (CableChain, 1.25e-4)}  # noqa: RUF012
    typical, drawn_size, cameras = _TYPICAL, 0.45, ("front", "along", "damper")

    def __post_init__(self) -> None:
        require_kind("a StayCable", StayCable, cable=self.cable)
        require_kind("a list of places x / L", (list, tuple, np.ndarray), measured_at=self.measured_at)
        object.__setattr__(self, "cable", self.cable or StayCable())
        object.__setattr__(self, "model", model_of(self.model, cable_damper))
        for x in self.places:
            if not 0 < x < 1:
                raise InputError(f"cable: measured at {x} of the length; allowed: between 0 and 1")

    @cached_property
    def models(self) -> tuple[Model, ...]:
        return (model_of(self.model, cable_damper),)

    @property
    def places(self) -> tuple[float, ...]:
        """Where motion is measured, x / L."""
        return default_places(self.cable) if self.measured_at is None else tuple(self.measured_at)

    @property
    def system(self) -> Mechanics:
        return self.cable.mechanics

    @cached_property
    def at(self) -> Array:
        """(places, modes)."""
        return self.cable.at(np.array(self.places, dtype=np.float64))

    @property
    def whole(self) -> float:
        """kg."""
        return self.cable.mass * self.cable.length

    def forces(self, load: CableLoad) -> Array:
        """(samples, modes) N on the natural coordinates."""
        return self.cable.forces(load.force, load.places)

    @property
    def names(self) -> tuple[str, ...]:
        many = range(1, len(self.places) + 1)
        return (*(f"{what}_{j}" for what in ("acceleration", "displacement", "velocity") for j in many), *SIGNALS[:-1])

    @property
    def load_names(self) -> list[str]:
        return [f"load_{k + 1}" for k in range(len(self.cable.natural))]

    def mjcf(self, timestep: float, *, drawn: bool = False) -> str:
        return linear_xml(self.name, self.system, self.models[0], timestep, drawn=drawn)

    def in_full(self) -> Self:
        """At as many places as the sines can be distinguished at, between the anchorages."""
        return replace(self, measured_at=tuple(np.arange(1, self.cable.modes + 1) / (self.cable.modes + 1)))

    def loads(self) -> LoadSource:
        return WindLoads()

    @property
    def first(self) -> float:
        return self.cable.first

    @classmethod
    def criteria(cls, **scored: float) -> tuple[Criterion, ...]:
        return (Criterion("motion_ratio", 1.0, 0, 0.5),)

    def training(self) -> CableLoads:
        return CableLoads()

    def some(self, rng: np.random.Generator, count: int, spread: float = 0.0) -> list[CableLoad]:
        return CableLoads(_DRAWN).some(rng, count, self.cable.length, spread=spread)

    def validation(self) -> list[CableLoad]:
        return validation_loads(self.cable.length)

    def controller(self, spec: str, command_max: float, period: float, force_max: float) -> Controller:
        site = CableSite(self.cable, command_max, default_places(self.cable), force_max, period, self.models[0])
        return registry.make(spec, site)

    def load(self, rng: np.random.Generator, source: LoadSource, options: Mapping[str, Any]) -> CableLoad:
        given = options.get("load")
        load = source.draw(rng, self.cable.length) if given is None else given
        require_kind("a CableLoad", CableLoad, load=load)
        return load

    def reference(
        self, given: Array, load: CableLoad, timestep: float, weights: CableReward, command_max: float, period: float
    ) -> Array:
        return free_run(self.cable, given, load.sample_time)

    def told(self, load: CableLoad, reference: Sequence[float] | Array) -> dict[str, Any]:
        return {"load_rms": load.rms, "reference_motion": math.sqrt(reference[0])}

    def reference_motion(self, values: Array) -> float:
        """RMS over time and length, m."""
        return math.sqrt(values[0])

    def view(self, task: Task, camera: str, size: tuple[int, int]) -> CableView:
        return CableView(self.cable, self.models[0], camera, size)

    def sensors(self, command_max: Array, full_state: bool) -> tuple[list[str], dict[str, float]]:
        """Accelerations at the places of measurement, and the damper's stroke and force.

        full_state: displacements and velocities all along the cable, and the coil's current. The scales are those of
        the first mode with an amplitude of 0.2 % of the length at mid-span, at each place; of the force, what holds the
        cable fast there.
        """
        cable, places = self.cable, self.places
        many = range(1, len(places) + 1)
        if full_state:
            signals = [f"{what}_{j}" for what in ("displacement", "velocity") for j in many] + ["current"]
        else:
            signals = [f"acceleration_{j}" for j in many]
        amplitude, w = _LARGE * cable.length, cable.first
        here = amplitude * math.sin(math.pi * cable.damper_at)
        force = cable.tension * here / (cable.damper_at * cable.length)
        scale = {"stroke": here, "stroke_velocity": here * w, "current": float(command_max[0])}
        scale |= {"force": force, "true_force": force}
        for j, x in zip(many, places, strict=True):
            there = amplitude * math.sin(math.pi * x)
            scale |= {f"displacement_{j}": there, f"velocity_{j}": there * w, f"acceleration_{j}": there * w * w}
        return [*signals, "stroke", "force"], scale


class CableTask(KindTask):
    """n cables under ambient or wind loads; arguments as in `CableEnv`."""

    kind = Cable
    structure: Cable
