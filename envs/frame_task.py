"""Shear frames under ground motions: their dampers and motions, and what is measured and rewarded."""

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
from mrdamp.control.base import Controller, sensor_name
from mrdamp.envs.chain_rows import FrameChain
from mrdamp.envs.frame_rows import FrameRows
from mrdamp.envs.frame_xml import FrameView, Position, frame_models, frame_xml
from mrdamp.envs.loads import MotionSource, SyntheticMotions, cut, played
from mrdamp.envs.reward import FrameReward, reference_run
from mrdamp.envs.structure import Criterion, Structure, largest_force
from mrdamp.envs.task import KindTask, Task
from mrdamp.envs.training_loads import some_motions, training_motions, validation_motions
from mrdamp.errors import InputError, require_kind, require_positive
from mrdamp.model import Model, effects_from
from mrdamp.model.core import Array
from mrdamp.motions import GroundMotion
from mrdamp.simulation.mjcf import SIGNALS
from mrdamp.structures import ShearFrame


def default_damper() -> Model:
    """The damper of Dyke, Spencer, Sain and Carlson 1996: modified Bouc-Wen, 3 kN, 0 to 2.25 V, driver lag."""
    found = sets.load("dyke1996_3kN")
    effects = effects_from({k: v for k, v in found.attributes().items() if k not in found.parameters})
    return Model(found.law, dict(found.parameters), effects, name=found.id)


#: RMS over the scales under the default loads and commands that change evenly between none and the largest.
_TYPICAL = {
    "acceleration": 0.25, "displacement": 0.2, "velocity": 0.2, "drift": 0.1, "stroke": 0.1, "stroke_velocity": 0.1,
    "force": 0.13, "true_force": 0.13, "current": 0.6,
}  # fmt: skip
_STRONG = 5.0  # m/s2: floor acceleration that the scales of the observation belong to


@dataclass(frozen=True)
class Frame(Structure):
    """A shear frame on a moving ground, with a damper or several.

    model: any identified one (any law, with or without effects; None: `default_damper`), its file, or one a damper.
    structure: None takes the model's own, or Dyke's three-storey frame. damper_between: floors of the damper, or
    several pairs. duration: s, of a motion at most. Raises InputError.
    """

    model: Model | Sequence[Model] | Path | str | None = None
    structure: ShearFrame | None = None
    damper_between: Position | Sequence[Position] | None = None
    duration: float | None = None

    name, option, more, source, Source = "frame", "motion", ("compression",), "motions", MotionSource
    weights = FrameReward
    engines = {"mujoco": (FrameRows, 5e-4), "chain": (FrameChain, 5e-4)}  # noqa: RUF012
    typical, drawn_size = _TYPICAL, 0.10
    #: Of peak acceleration to peak drift: a constant command that saves drift costs acceleration; the weight is such
    #: that a policy gains in both over it.
    scored = {"weight": 0.3}  # noqa: RUF012
    #: searched: the engine at .1 ms gives the same peaks within .5 %
    exponent, searched, trained = 8.0, 5e-4, 5e-4

    def __post_init__(self) -> None:
        require_kind("a Model, its file, or one a damper", (Model, str, Path, list, tuple), model=self.model)
        require_kind("a ShearFrame", ShearFrame, structure=self.structure)
        if self.duration is not None:
            require_positive("motions", duration=self.duration)
        _ = self.models

    @cached_property
    def models(self) -> tuple[Model, ...]:
        given = default_damper() if self.model is None else self.model
        model = Model.read(given) if isinstance(given, str | Path) else given
        if isinstance(model, list | tuple) and not model:
            raise InputError("model is empty: allowed are a Model, its file, or a list with one a damper")
        between = self.damper_between
        if between is None:
            own = self.structure or (model if isinstance(model, Model) else model[0]).structure
            between = own.damper_between if own is not None else (0, 1)
        return frame_models(model, self.structure, positions(between))

    @property
    def frame(self) -> ShearFrame:
        """With the place of the first damper."""
        assert self.models[0].structure is not None
        return self.models[0].structure

    @property
    def places(self) -> list[Position]:
        """Of every damper."""
        return [model.structure.damper_between for model in self.models if model.structure is not None]

    @property
    def names(self) -> tuple[str, ...]:
        whats, floors = ("acceleration", "displacement", "velocity", "drift"), range(1, self.frame.storeys + 1)
        own = (sensor_name(s, k) for s in SIGNALS[:-1] for k in range(len(self.models)))
        return (*(f"{what}_{j}" for what in whats for j in floors), *own)

    load_names = ("ground",)

    def mjcf(self, timestep: float, *, drawn: bool = False) -> str:
        return frame_xml(self.models, timestep, drawn=drawn)

    def parts(self) -> dict[str, Any]:
        return {"model": self.models, "structure": None, "damper_between": tuple(self.places)}

    def loads(self) -> MotionSource:
        return SyntheticMotions()

    @property
    def first(self) -> float:
        return 2 * math.pi * float(self.frame.frequencies[0])

    @classmethod
    def criteria(cls, **scored: float) -> tuple[Criterion, ...]:
        return Criterion("drift_ratio", 1.0, 0), Criterion("acceleration_ratio", scored["weight"], 1)

    def training(self) -> MotionSource:
        return training_motions()

    def some(self, rng: np.random.Generator, count: int, spread: float = 0.0) -> list[GroundMotion]:
        return some_motions(rng, count, spread=spread)

    def validation(self) -> list[GroundMotion]:
        return validation_motions()

    def controller(self, spec: str, command_max: float, period: float, force_max: float) -> Controller:
        structure = replace(self.frame, others=tuple(self.places[1:]))
        site = registry.Site.of(replace(self.models[0], structure=structure), period)
        return registry.make(spec, replace(site, command_max=command_max))

    def load(self, rng: np.random.Generator, source: MotionSource, options: Mapping[str, Any]) -> GroundMotion:
        given = options.get("motion")
        motion = source.draw(rng) if given is None else played(given, options.get("compression"))
        return cut(motion, self.duration)

    def forces(self, load: GroundMotion) -> Array:
        return load.acceleration[:, None]

    def reward(self, given: Any) -> FrameReward:
        weights = FrameReward.of(given)
        if weights.reference == "passive-on" and len(self.models) > 1:
            raise InputError("reward: reference passive-on is for one damper; allowed here: uncontrolled")
        return weights

    def reference(
        self, given: Array, load: GroundMotion, timestep: float, weights: FrameReward, command_max: float, period: float
    ) -> Sequence[float]:
        return reference_run(self.models[0], given, timestep, weights.reference, command_max)

    def told(self, load: GroundMotion, reference: Sequence[float] | Array) -> dict[str, Any]:
        found = {"reference_drift": reference[0], "reference_acceleration": reference[1]}
        return {"pga": load.pga, "speed": load.speed, **found}

    def reference_motion(self, values: Array) -> float:
        """Peak drift, m."""
        return float(values[0])

    def view(self, task: Task, camera: str, size: tuple[int, int]) -> FrameView:
        return FrameView(self.models, camera, size)

    def sensors(self, command_max: Array, full_state: bool) -> tuple[list[str], dict[str, float]]:
        """Floor accelerations, stroke and force of every damper.

        full_state: displacements, velocities and coil currents instead of strokes. The scales are those of a strong
        motion, which is 5 m/s2, the motion of the first mode with that acceleration, and the damper's force in it at
        the largest command.
        """
        floors, dampers = range(1, self.frame.storeys + 1), range(len(self.models))

        def of_dampers(name: str) -> list[str]:
            return [sensor_name(name, k) for k in dampers]

        signals = [f"acceleration_{j}" for j in floors]
        if full_state:
            signals += [f"displacement_{j}" for j in floors] + [f"velocity_{j}" for j in floors]
        signals += of_dampers("current" if full_state else "stroke") + of_dampers("force")
        w = self.first
        velocity, displacement = _STRONG / w, _STRONG / w**2
        scale = dict.fromkeys((f"acceleration_{j}" for j in floors), _STRONG)
        scale |= dict.fromkeys((f"velocity_{j}" for j in floors), velocity)
        scale |= dict.fromkeys((f"{what}_{j}" for what in ("displacement", "drift") for j in floors), displacement)
        for k, (model, largest) in enumerate(zip(self.models, command_max.tolist(), strict=True)):
            force = largest_force(model, displacement, w, largest)
            own = {"stroke": displacement, "stroke_velocity": velocity, "current": largest}
            own |= {"force": force, "true_force": force}
            scale |= {sensor_name(name, k): value for name, value in own.items()}
        return signals, scale


class FrameTask(KindTask):
    """n frames under ground motions; arguments as in `FrameEnv`."""

    kind = Frame
    structure: Frame


def positions(damper_between: Position | Sequence[Position]) -> tuple[Position, ...]:
    """One pair of floors or several, as several."""
    pairs = np.asarray(damper_between)
    if pairs.ndim not in (1, 2) or pairs.shape[-1] != 2 or pairs.dtype.kind not in "iu":
        raise InputError(f"damper_between is {damper_between!r}; allowed: a pair of floors, or several pairs")
    return tuple((int(a), int(b)) for a, b in pairs.reshape(-1, 2))
