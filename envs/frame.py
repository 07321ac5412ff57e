"""Shear frames under ground motions: dampers and motions, what is measured and rewarded, and `mrdamp/Frame-v0`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from mrdamp import sets
from mrdamp.control.base import sensor_name
from mrdamp.control.registry import Site
from mrdamp.envs.frame_rows import FrameChain, FrameRows
from mrdamp.envs.frame_xml import FrameView, Position, frame_models, frame_xml
from mrdamp.envs.loads import MotionSource, SyntheticMotions, cut, played
from mrdamp.envs.plant_env import KindPlant, PlantEnv
from mrdamp.envs.structure import Part, Structure, Total, Weights, floor_names, largest_force, of_dampers
from mrdamp.envs.task import KindTask, Task
from mrdamp.envs.training_loads import some_motions, training_motions, validation_motions
from mrdamp.errors import InputError, require_kind, require_one_of, require_positive
from mrdamp.model import Model, core
from mrdamp.model.core import Array
from mrdamp.motions import GroundMotion
from mrdamp.structures import ShearFrame

_PARTS, _TOTALS = of_dampers(2, energy=2)


@dataclass(frozen=True)
class FrameReward(Weights):
    """Weights of the reward's parts.

    With d and a the largest |drift| and |absolute acceleration| within a control period, over storeys, floors and
    the steps of the engine, each over the same motion's peak in the `reference` run, and i the coil current over
    the largest command, averaged over the period and the dampers:

    | part | of a control period | over an episode of T |
    |---|---|---|
    | drift_peak | the rise of d's maximum so far | -100 drift_peak J1 |
    | acceleration_peak | the rise of a's maximum so far | -100 acceleration_peak J2 |
    | drift | d^exponent / T | -100 drift mean(d^exponent) |
    | acceleration | a^exponent / T | -100 acceleration mean(a^exponent) |
    | current | i / T | -100 current mean(i) |
    | power | i^2 / T, the coil's heat over that at the largest current | -100 power mean(i^2) |
    | energy | what the dampers take in over the reference run's peak strain energy | +100 energy times the sum |

    The default return is -50 (J1 + J2), what `mrdamp compare` reports: -100 without dampers.

    reference: `uncontrolled`, the frame without dampers, or `passive-on`, the largest command all the time (of one
    damper; it costs more at every reset).
    """

    drift: float = 0.0
    acceleration: float = 0.0
    drift_peak: float = 0.5
    acceleration_peak: float = 0.5
    energy: float = 0.0
    reference: Literal["uncontrolled", "passive-on"] = "uncontrolled"

    table: ClassVar[tuple[Part, ...]] = (
        Part("drift", 0, 0, 1.0), Part("acceleration", 1, 1, 1.0), Part("drift_peak", 0, 0, rise=True, summed=True),
        Part("acceleration_peak", 1, 1, rise=True, summed=True), *_PARTS,
    )  # fmt: skip
    totals: ClassVar[tuple[Total, ...]] = (
        Total("peak_drift", 0, "peak", 0), Total("peak_acceleration", 1, "peak", 1),
        Total("drift_ratio", 0, "peak", 0, ratio=True), Total("acceleration_ratio", 1, "peak", 1, ratio=True), *_TOTALS,
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of("reward", ("uncontrolled", "passive-on"), reference=self.reference)


class Reference(NamedTuple):
    """Response of the frame in the reference run: peaks over storeys or floors, SI."""

    drift: float  # m
    acceleration: float  # m/s2
    strain_energy: float  # J


def reference_run(
    model: Model, ground: Array, dt: float, kind: str = "uncontrolled", command_max: float = 0.0
) -> Reference:
    """Peaks of the frame under ground acceleration (samples,) m/s2 every dt, by the C entry.

    Raises InputError where the ground does not move.
    """
    frame = model.frame
    sensors: dict[str, Any] = {f.name: None for f in fields(frame) if f.name.startswith("acc_")}
    ideal = replace(frame, **sensors)
    if kind == "uncontrolled":
        ideal = replace(ideal, damper_between=None)
    out = core.run_frame(model.law, model.attributes, ideal, dt, ground, command_max, narx=model.narx)
    floors = range(1, len(frame.mass) + 1)
    displacement = np.array([out[f"displacement_{j}"] for j in floors])
    drift = np.diff(displacement, axis=0, prepend=0.0)
    acceleration = np.array([out[f"acceleration_{j}"] for j in floors])
    found = Reference(
        drift=float(np.abs(drift).max()),
        acceleration=float(np.abs(acceleration).max()),
        strain_energy=float((0.5 * frame.stiffness @ drift**2).max()),
    )
    if not found.drift > 0:
        raise InputError("the ground motion is zero throughout; there is nothing to control")
    return found


def default_damper() -> Model:
    """The damper of Dyke, Spencer, Sain and Carlson 1996: modified Bouc-Wen, 3 kN, 0 to 2.25 V, driver lag."""
    return sets.load("dyke1996_3kN").model()


#: RMS over the scales under the default loads and commands that change evenly between none and the largest.
_TYPICAL = {
    "acceleration": 0.25, "displacement": 0.2, "velocity": 0.2, "drift": 0.1, "stroke": 0.1, "stroke_velocity": 0.1,
    "force": 0.13, "true_force": 0.13, "current": 0.6,
}  # fmt: skip
_STRONG = 5.0  # m/s2: floor acceleration that the scales of the observation belong to


@dataclass(frozen=True)
class Frame(Structure):
    """A shear frame on a moving ground, with a damper or several.

    model: any identified one (any law, with or without effects; None: `default_damper`), its file or set's name, or one
    a damper. structure: None takes the model's own, or Dyke's three-storey frame. damper_between: floors of the damper,
    or several pairs. duration: s, of a motion at most. Raises InputError.
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
        model = sets.named_model(given) if isinstance(given, Model | str | Path) else given
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
        return floor_names(self.frame.storeys, len(self.models))

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
    def criteria(cls, **scored: float) -> Mapping[str, float]:
        return {"drift_ratio": 1.0, "acceleration_ratio": scored["weight"]}

    def training(self) -> MotionSource:
        return training_motions()

    def some(self, rng: np.random.Generator, count: int, spread: float = 0.0) -> list[GroundMotion]:
        return some_motions(rng, count, spread=spread)

    def validation(self) -> list[GroundMotion]:
        return validation_motions()

    def site(self, command_max: float, period: float, force_max: float | None = None) -> Site:
        structure = replace(self.frame, others=tuple(self.places[1:]))
        return replace(Site.of(replace(self.models[0], structure=structure), period), command_max=command_max)

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

    def reference(self, given: Array, load: GroundMotion, task: Task) -> Sequence[float]:
        step, kind, largest = task.rows.plants.timestep, task.weights.reference, float(task.command_max[0])
        return reference_run(self.models[0], given, step, kind, largest)

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
    pairs = np.asarray(damper_between)
    if pairs.ndim not in (1, 2) or pairs.shape[-1] != 2 or pairs.dtype.kind not in "iu":
        raise InputError(f"damper_between is {damper_between!r}; allowed: a pair of floors, or several pairs")
    return tuple((int(a), int(b)) for a, b in pairs.reshape(-1, 2))


class FramePlant(KindPlant):
    """A shear frame on a moving ground, in MuJoCo or on the chain (engine), with a damper or several.

    The ground moves at each of the engine's steps. The measurements of a second damper have `_2` at the end, as
    `force_2`. Arguments: fields of `Frame`, and those of `RowOptions` by name. Raises InputError.
    """

    kind = Frame


class FrameEnv(PlantEnv):
    """
    ## Description

    A shear frame of N storeys on a shake table. Magnetorheological dampers between its floors dissipate energy. The
    action is the current of their coils, which their drivers follow with a lag. The default is the three-storey model
    frame of Dyke, Spencer, Sain and Carlson (Smart Materials and Structures 5 (1996) 565-575, doi
    10.1088/0964-1726/5/5/006) with its 3 kN damper between the ground and floor 1, at 0 to 2.25 V. The damper is the
    MuJoCo plugin `mrdamp.damper`. The aim is small drift and small floor acceleration with little current.

    The physics is that of `models_xml/frame3/model.xml`, with the given storeys, dampers and sensors.

    Spaces, starting state, episode end and the arguments of every environment are those of `PlantEnv`. A damper's
    transmission is the joint of its storey, or a tendon over several.

    ## Observation Space

    With the defaults, three storeys and one damper:

    | Num | Observation | Name (in the XML file) | Joint | Unit before scaling |
    |-----|-------------|------------------------|-------|------|
    | 0 | absolute acceleration of floor 1 | acceleration_1 | storey1 | m/s2 |
    | 1 | absolute acceleration of floor 2 | acceleration_2 | storey2 | m/s2 |
    | 2 | absolute acceleration of floor 3 | acceleration_3 | storey3 | m/s2 |
    | 3 | stroke of the damper | stroke | storey1 | m |
    | 4 | force of the damper, by its own sensor | force | storey1 | N |
    | 5 | command held in the period that ended | damper | storey1 | A or V |

    The scales are those of a strong motion; under the default motions the RMS is .1 to .3, with `normalise=True` about
    1. Other `signals`: `displacement_j`, `velocity_j` (floor to ground, m and m/s), `drift_j` (m), `stroke_velocity`
    (m/s), `current` (A or V), `true_force` (N, an ideal load cell); those of a second damper end in `_2`.
    `full_state=True` gives all displacements, velocities and currents. `mrdamp compare` gives a policy what a rig
    measures: accelerations, displacements, stroke, its velocity and force; a policy that sees more is for training
    alone. Sensors have the effects of the model (`sensor_gain`, `sensor_lag`, ...).

    ## Rewards

    The sum of the parts of `mrdamp.envs.frame.FrameReward`, each in `info` as `reward_` and its name. By default an
    episode's return is -50 (J1 + J2), -100 without dampers, and the current is free.

    `info` also has, since the episode's start: `peak_drift` (m), `peak_acceleration` (m/s2), both over all steps of
    the engine; `drift_ratio` and `acceleration_ratio`, the same over the reference run (J1 and J2 of the benchmark
    problems); `mean_current` (A or V), `mean_power` (over that at the largest current), `dissipated_energy` (J).
    The `info` of `reset`: `motion`, `pga` (m/s2), `duration` (s), `speed` (times that of the record), `reference_drift`
    (m), `reference_acceleration` (m/s2).

    ## Starting State

    `reset(options={"motion": GroundMotion or file, "amplitude": factor, "compression": factor})`. A file is played five
    times as fast as it was recorded, as for the model frame of Dyke et al., a `GroundMotion` as it is, unless there is
    a `compression`: the rule of `RecordedMotions` too.

    ## Arguments

    | Parameter | Type | Default | Description |
    |-----------|------|---------|-------------|
    | `model` | `Model`, path, set's name, one a damper | Dyke's 3 kN damper | any identified one: law, NARX, effects |
    | `structure` | `ShearFrame` | the model's own, or Dyke's | N storeys |
    | `damper_between` | pair or pairs of floors | the structure's | (0, 1) is ground to floor 1 |
    | `motions` | `MotionSource` | `SyntheticMotions()` | Kanai-Tajimi, Clough-Penzien, files, mixtures, amplitudes |
    | `reward` | `FrameReward`, mapping | `FrameReward()` | weights of the parts, exponent, reference |
    | `timestep` | s | 0.0005 | the largest of the engine |
    | `duration` | s | the motion's | cuts long motions |
    | `camera` | str | corner | `front`, `corner`, `damper` |
    """

    kind = Frame
