"""Stay cables under ambient and wind loads: damper, what is measured and rewarded, and `mrdamp/Cable-v0`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from scipy import signal

from mrdamp import sets
from mrdamp.control.cable import CableSite
from mrdamp.control.lqg import first_order_hold
from mrdamp.control.registry import largest_force
from mrdamp.envs.cable_xml import CableView
from mrdamp.envs.linear_rows import ByMatrices, CableChain, CableRows
from mrdamp.envs.loads import CableLoad, LoadSource, WindLoads
from mrdamp.envs.options import model_of
from mrdamp.envs.plant_env import KindPlant, PlantEnv
from mrdamp.envs.structure import Part, Total, Weights, of_dampers
from mrdamp.envs.task import KindTask, Task
from mrdamp.envs.training_loads import VALIDATION_SEED, CableLoads
from mrdamp.errors import InputError, require_kind
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.mjcf import SIGNALS
from mrdamp.structures.cables import StayCable
from mrdamp.structures.lumped import Mechanics

_STEP = 1e-3  # s

_PARTS, _TOTALS = of_dampers(2, energy=2)


@dataclass(frozen=True)
class CableReward(Weights):
    """Weights of the reward's parts.

    With m and a the RMS of motion and acceleration over the cable's length and the control period, each over its RMS
    in the whole of the same load's run without a damper, and i the coil current over the largest command:

    | part | of a control period | over an episode of T |
    |---|---|---|
    | motion | m^exponent / T | -100 motion mean(m^exponent) |
    | acceleration | a^exponent / T | -100 acceleration mean(a^exponent) |
    | current | i / T | -100 current mean(i) |
    | power | i^2 / T, the coil's heat over that at the largest current | -100 power mean(i^2) |
    | energy | what the damper takes in over the largest that the free cable held | +100 energy times the sum |

    The default return is -100 times the square of `motion_ratio`, what `mrdamp compare` reports: -100 without a damper.
    """

    motion: float = 1.0
    acceleration: float = 0.0
    energy: float = 0.0

    table: ClassVar[tuple[Part, ...]] = (Part("motion", 0, 0, 0.5), Part("acceleration", 1, 1, 0.5), *_PARTS)
    totals: ClassVar[tuple[Total, ...]] = (
        Total("rms_motion", 0, "rms", 0), Total("motion_ratio", 0, "rms", 0, ratio=True), *_TOTALS,
    )  # fmt: skip


def free_run(cable: StayCable, forces: Array, sample_time: float) -> Array:
    """(3,) of the cable without a damper, from rest, under loads (samples, modes) N on its natural coordinates.

    Means of int v^2 dx / L (m2) and int (v'')^2 dx / L (m2/s4), and the largest energy held (J), at steps of 1 ms at
    most. The coordinates are oscillators of their own: exact for loads that are straight from sample to sample
    (sample_time, s). Raises InputError where there is no load.
    """
    inner = math.ceil(sample_time / _STEP - 1e-9)
    dt, samples = sample_time / inner, np.arange(len(forces))
    at = np.arange((len(forces) - 1) * inner + 1) / inner
    squares, energies = np.zeros(2), np.zeros(len(at))
    for w, force in zip(cable.natural, forces.T, strict=True):
        push, damping = np.interp(at, samples, force), 2 * cable.ratio * w
        system = np.array([[0.0, 1.0], [-w * w, -damping]])
        a, before, after = first_order_hold(system, np.array([[0.0], [1.0]]), dt)
        given = before * push[:-1] + after * push[1:]  # (2, steps): coordinate and rate
        poles, state = [1.0, -np.trace(a), np.linalg.det(a)], np.zeros((2, len(at)))
        # (1 - a / z)^-1 by Cramer's rule.
        state[:, 1:] = given
        state[:, 2:] += np.array([[-a[1, 1], a[0, 1]], [a[1, 0], -a[0, 0]]]) @ given[:, :-1]
        q, v = signal.lfilter([1.0], poles, state, axis=1)
        squares += [np.mean(q * q), np.mean((push - damping * v - w * w * q) ** 2)]
        energies += 0.5 * (v * v + w * w * q * q)
    if not squares[0] > 0:
        raise InputError("the load is zero throughout; there is nothing to control")
    return np.array([*squares / (cable.mass * cable.length), energies.max()])


#: RMS over the scales under the default loads and commands that change evenly between none and the largest.
_TYPICAL = {"acceleration_1": 10.0, "acceleration": 2.8, "force": 0.5, "true_force": 0.5, "current": 0.6}
_DRAWN = 12.0  # s, of the loads that a search draws
_LARGE = 0.002  # of the length: motion at mid-span that the scales of the observation belong to


def cable_damper() -> Model:
    """A small shear-mode damper that fits the laboratory cable: 4 to 21 N at 0.6 to 4 V (Zapateiro et al. 2010)."""
    return sets.load("zapateiro_foam_bouc_wen").model()


def default_places(cable: StayCable) -> tuple[float, ...]:
    """Default places of measurement: at the damper, and farther from the anchorage."""
    return (cable.damper_at, min(5 * cable.damper_at, 0.25))


@dataclass(frozen=True)
class Cable(ByMatrices):
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

    def in_full(self) -> Self:
        """At as many places as the sines can be distinguished at, between the anchorages."""
        return replace(self, measured_at=tuple(np.arange(1, self.cable.modes + 1) / (self.cable.modes + 1)))

    def loads(self) -> LoadSource:
        return WindLoads()

    @property
    def first(self) -> float:
        return self.cable.first

    @classmethod
    def criteria(cls, **scored: float) -> Mapping[str, float]:
        return {"motion_ratio": 1.0}

    def training(self) -> CableLoads:
        return CableLoads()

    def some(self, rng: np.random.Generator, count: int, spread: float = 0.0) -> list[CableLoad]:
        return CableLoads(_DRAWN).some(rng, count, self.cable.length, spread=spread)

    def validation(self) -> list[CableLoad]:
        return CableLoads().some(np.random.default_rng([VALIDATION_SEED, 2]), 12, self.cable.length)

    def site(self, command_max: float, period: float, force_max: float | None = None) -> CableSite:
        """By default of a slow motion of 1 % of the damper's distance from the anchorage."""
        cable, model = self.cable, self.models[0]
        if force_max is None:
            force_max = largest_force(model, command_max, 0.01 * cable.damper_at * cable.length, cable.first, 2000)
        return CableSite(cable, command_max, default_places(cable), force_max, period, model)

    def load(self, rng: np.random.Generator, source: LoadSource, options: Mapping[str, Any]) -> CableLoad:
        given = options.get("load")
        load = source.draw(rng, self.cable.length) if given is None else given
        require_kind("a CableLoad", CableLoad, load=load)
        return load

    def reference(self, given: Array, load: CableLoad, task: Task) -> Array:
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


class CablePlant(KindPlant):
    """A stay cable with a damper, in MuJoCo or on the chain (engine), for any controller, without rewards.

    Arguments: fields of `Cable`, and those of `RowOptions` by name. Raises InputError.
    """

    kind = Cable


class CableEnv(PlantEnv):
    """
    ## Description

    A stay cable vibrates transversely under wind or ambient loads. A magnetorheological damper close to its
    anchorage dissipates energy; the action is the current of its coil. The default is a laboratory cable of 12.65 m
    with 2172 N and 0.747 kg/m (2.13 Hz). Its damper at 2 % of the length is a small shear-mode one of up to 21 N at
    4 V (Zapateiro, Luo, Taylor, Dyke, Smart Structures and Systems 6 (2010) 101-113). A dashpot at this place gives
    a modal damping ratio of at most about half of x_d / L. Semi-active control can do better (Johnson, Christenson,
    Spencer, Comput.-Aided Civ. Infrastruct. Eng. 18 (2003) 132-146, doi 10.1111/1467-8667.00305). The aim is small
    motion with little current.

    The state is in natural coordinates of the first sines and the static shape under the damper's force
    (`mrdamp.structures.cables.StayCable`). Each is a slide joint in MuJoCo (`mrdamp.envs.cable_xml.linear_xml`); the
    damper is the plugin `mrdamp.damper` on a tendon over all of them. The slide chain with sag of `models_xml/cable`
    is the reference in the tests and the model that is rendered.

    Spaces, starting state, episode end and the arguments of every environment are those of `PlantEnv`. The damper's
    transmission is the tendon `stroke`. Below its least command, .6 V of 4 V (actions up to -.7), the default damper
    does as at .6 V: a dead zone, which the law has by a limit of the command, so that current and power count .6 V too.

    ## Observation Space

    With the defaults:

    | Num | Observation | Name (in the XML file) | Place | Unit before scaling |
    |-----|-------------|------------------------|-------|------|
    | 0 | acceleration across the chord | of the modes | at the damper | m/s2 |
    | 1 | acceleration across the chord | of the modes | five times as far from the anchorage | m/s2 |
    | 2 | stroke of the damper | stroke | at the damper | m |
    | 3 | force of the damper, by its own sensor | force | at the damper | N |
    | 4 | command held in the period that ended | damper | | A or V |

    The accelerometers are ideal by default, and what they read hangs on the number of modes
    (docs/reference/environments.md). `signals=["acceleration_2", "stroke", "stroke_velocity", "force"], bandwidth=62.5`
    does not.
    Other `signals`: `displacement_j`, `velocity_j` at place j, `stroke_velocity`, `current`, `true_force`.
    `full_state=True` gives displacements and velocities at as many places as there are sines, and the current.

    ## Rewards

    The sum of the parts of `mrdamp.envs.cable.CableReward`, each in `info` as `reward_` and its name. By default an
    episode's return is -100 times the square of `motion_ratio`, and the current is free. `info` also has, since the
    episode's start: `rms_motion` (m, over time and length), `motion_ratio` (the same over the run without the damper),
    `mean_current` (A or V), `mean_power` (over that at the largest current), `dissipated_energy` (J). The `info` of
    `reset(options={"load": CableLoad, "amplitude": factor})`: `load`, `load_rms` (N/m), `duration` (s),
    `reference_motion` (m).

    ## Arguments

    | Parameter | Type | Default | Description |
    |-----------|------|---------|-------------|
    | `cable` | `StayCable` | the laboratory cable | length, tension, mass, place of the damper, damping, sag |
    | `model` | `Model`, path, set's name | Zapateiro's 20 N damper | any identified one: law, NARX, effects |
    | `measured_at` | places x / L | the damper's and five times it | where motion is measured |
    | `bandwidth` | Hz | None: ideal | of the accelerometers |
    | `loads` | `LoadSource` | `WindLoads()` | `WindLoads`, `AmbientLoads`, or one of your own |
    | `reward` | `CableReward`, mapping | `CableReward()` | weights of the parts, exponent |
    | `timestep` | s | 0.000125 | the largest of the engine |
    | `camera` | str | front | `front`, `along`, `damper` |

    At the default step every signal is within 2 % of that of a tenth of it under commands that switch
    (docs/convergence.md).
    """

    kind = Cable
