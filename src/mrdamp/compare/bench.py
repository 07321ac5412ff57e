"""What is compared: a structure with its damper and loads, and one run of a controller on it."""

from __future__ import annotations

import hashlib
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from mrdamp import __version__
from mrdamp.control import registry, told
from mrdamp.control.base import Controller, ZeroOrderHold
from mrdamp.envs.plant_env import RowPlant
from mrdamp.envs.structure import Structure
from mrdamp.envs.task import Task, task_of
from mrdamp.envs.training_loads import UNSEEN_AMPLITUDES, read_motions
from mrdamp.errors import InputError, require_one_of, require_period, require_positive
from mrdamp.files import digest
from mrdamp.library import library_path
from mrdamp.model import Model
from mrdamp.model.core import Array

_VERSION = 11  # of what a kept run holds
#: Option of a kind of controller -> what tuning chooses it from, the lower and the upper end.
Ranges = Mapping[str, tuple[float, float]]

#: The spec of a run without the damper.
UNCONTROLLED = "uncontrolled"


class Load(Protocol):
    """A ground motion, or a load on a cable."""

    @property
    def name(self) -> str: ...


@dataclass(frozen=True)
class Measure:
    """key: in files; title: in tables, with its unit; ratio: over the uncontrolled run, its worst case is shown."""

    key: str
    title: str
    ratio: bool = False


#: What names a run in tables, before its measures.
RUN = ("controller", "seed", "load", "amplitude")

#: What ratios are over on a structure with a damper more or less.
WITHOUT = "the structure without a damper"

#: Controllers that are tuned on a frame or a cable: name -> registered controller.
TUNED = {"best-constant": "constant"} | {
    f"{kind}-tuned": kind
    for kind in ("clipped-optimal", "modulated-optimal", "force-tracking", "lyapunov", "max-dissipation", "skyhook")
}
#: Those compared by default.
DEFAULT = ("passive-off", "passive-on", "best-constant", "clipped-optimal", *list(TUNED)[1:])


def score(bench: Bench, values: Mapping[str, float]) -> float:
    """What tuning makes small, from the measures of a run."""
    return sum(weight * values[key] for key, (_, weight) in bench.objective.items())


#: Of the command and the coil, on any bench; NaN for an ideal actuator.
ELECTRIC: tuple[Measure, ...] = (
    Measure("mean_command", "mean command ({unit})"),
    Measure("rms_command", "RMS command ({unit})"),
    Measure("mean_current", "mean current (A)"),
    Measure("rms_current", "RMS current (A)"),
    Measure("coil_energy", "coil energy (J)"),
    Measure("switching_rate", "switching (1/s)"),
)


def coil(command_unit: str, mean: float, mean_square: float, duration: float) -> dict[str, float]:
    """mean_current and rms_current, A, and coil_energy, J in 5 ohm, from the current in units of the command.

    A command in V is that of the current driver of Spencer, Dyke, Sain and Carlson 1997
    (doi 10.1061/(ASCE)0733-9399(1997)123:3(230)), 1 A at 3 V, and one in A is the current itself.
    """
    amperes = 1 / 3 if command_unit == "V" else 1.0
    square = amperes**2 * mean_square
    return {"mean_current": amperes * mean, "rms_current": math.sqrt(square), "coil_energy": 5.0 * square * duration}


_MOST = 10_000_000  # periods of a run: results of more may not fit into memory


def require_periods(load: Any, period: float) -> None:
    """InputError unless a load, with a name and a duration (s), lasts 1 to `_MOST` control periods (s)."""
    if not 1 <= load.duration / period * (1 + 1e-9) <= _MOST:
        raise InputError(
            f"{load.name}: {load.duration:g} s in control periods of {period:g} s; allowed: 1 to {_MOST} periods"
        )


def content(of: Any) -> bytes:
    """All that a load, a model or a structure is made of."""
    if isinstance(of, np.ndarray):
        return of.tobytes()
    if isinstance(of, Model):
        of = of.to_dict(), of.structure and of.structure.places
    if is_dataclass(of):
        return b"".join(f.name.encode() + content(getattr(of, f.name)) for f in fields(of))
    return repr(of).encode()


class Bench(ABC):
    """A structure on which any controller can be run under any load, a dataclass. A run is pure: its result is the same
    anywhere.

    Fields: command_unit, A or V; period: of the classical controllers, s; timestep: of the
    engine, s, at most; engine: `mujoco` or `chain`.

    measures: of a run. headline: keys of the measures that a short table shows. claimed: keys of those by which a
    learned controller is set against the others. tuned: controllers that are tuned, by name -> their kind. default:
    controllers of the default table. unseen_amplitudes: of the loads of the evaluation. reference: denominator of the
    ratios, in words.
    bounds: name -> weights by key of measure, which a clairvoyant command minimises; empty without such a search. base:
    spec of the constant command that gains count from. tuning_step: of the engine while controllers are tuned, s,
    at least.
    """

    command_unit: str
    period: float
    timestep: float
    engine: str
    measures: ClassVar[tuple[Measure, ...]]
    headline: ClassVar[tuple[str, ...]]
    claimed: ClassVar[tuple[str, ...]]
    unseen_amplitudes: ClassVar[tuple[float, ...]] = UNSEEN_AMPLITUDES
    reference: ClassVar[str] = WITHOUT
    bounds: ClassVar[Mapping[str, Mapping[str, float]]] = {}
    base: ClassVar[str] = "passive-on"
    #: Runs may be kept for the next call.
    continues: ClassVar[bool] = True
    tuning_step: ClassVar[float] = 0.0

    def __post_init__(self) -> None:
        require_period("compare", self.period)
        require_positive("compare", timestep=self.timestep)
        require_one_of("", self.structure.engines, engine=self.engine)

    @property
    @abstractmethod
    def structure(self) -> Structure:
        """With its damper."""

    @cached_property
    def site(self) -> Any:
        """What controllers are made for, an `AnySite`."""
        return self.structure.site(self.command_max, self.period)

    @abstractmethod
    def run(self, spec: str, load: Any, amplitude: float) -> dict[str, Any]:
        """What is kept of a run, for JSON; spec: UNCONTROLLED or a controller's."""

    @abstractmethod
    def values(self, kept: Mapping[str, Any], uncontrolled: Mapping[str, Any]) -> Mapping[str, float]:
        """Every measure by key, from what is kept of a run and of the uncontrolled one; NaN where it has no value."""

    @abstractmethod
    def effort(self, kind: str) -> tuple[int, int]:
        """A search runs every so many-th of the tuning loads, its last choice all or a quarter of them; and how many
        control periods a search may take."""

    def clairvoyant(self, starts: Mapping[str, Sequence[str]], load: Any, amplitude: float) -> dict[str, Any]:
        """Searches for `bounds`, where there are any: on the chain, then in the bench's own engine.

        starts: bound -> specs of controllers, the best first; the best one takes the place of a found run that is
        worse. The answer, for JSON: bound -> `values`, as of a run, and `paths`, one a start: its name (`start`), what
        was made small after every step of the search (`values`), and why it `ended`.
        """
        return {}

    @abstractmethod
    def unseen_loads(self) -> Sequence[Any]:
        """Loads of the evaluation, that no controller is tuned or trained on."""

    def read(self, files: Sequence[Path], speed: float) -> Sequence[Any]:
        """Loads of files. speed: m/s, on roads. Raises InputError."""
        if self.structure.option != "motion":
            raise InputError(f"a {self.environment} has no ground motion; leave --motions out")
        return read_motions(files)

    @abstractmethod
    def own_identity(self) -> list[Any]:
        """What tuned settings belong to, besides their loads, for JSON."""

    @abstractmethod
    def about(self) -> str:
        """The structure in words."""

    @property
    def environment(self) -> str:
        return self.structure.name

    @property
    def measured(self) -> Sequence[str]:
        """What controllers are given, by name: what a rig measures, and no true force behind a sensor."""
        return [name for name in self.structure.names if name not in ("true_force", "current")]

    @property
    def tuned(self) -> Mapping[str, str]:
        return TUNED

    @property
    def default(self) -> tuple[str, ...]:
        return tuple(name for name in DEFAULT if name not in TUNED or name in self.tuned)

    @property
    def objective(self) -> Mapping[str, tuple[str, float]]:
        """What tuning makes small, as what policies are trained for: measure -> its name in the `info` of a task, and
        its weight."""
        weights = self.structure.criteria(**self.structure.scored)
        whole = sum(weights.values())
        keys = [m.key for m in self.measures]
        named = {name: name if name in keys else name.removesuffix("_ratio") for name in weights}
        return {named[name]: (name, weight / whole) for name, weight in weights.items()}

    @property
    def command_max(self) -> float:
        """A or V. Raises InputError where the model has none."""
        return registry.largest_command(self.structure.models[0])

    def check(self, spec: str) -> None:
        """Asks a controller once for a command, at rest, so that what is wrong with it is found before a run. Raises
        InputError."""
        registry.parse(spec, self.site.options)
        controller = self.controller(spec)
        try:
            controller.reset()
            controller.command(0.0, dict.fromkeys(self.measured, 0.0))
        except InputError as error:
            said = str(error)
            raise InputError(said if said.startswith("controller ") else f"controller {spec}: {said}") from None

    def controller(self, spec: str) -> Controller:
        """Of a spec, as it is compared: see `mrdamp.control.told`. Raises InputError."""
        return told.make(spec, self.site, partial(task_of, self.structure, 1))

    def task(self, n: int) -> Task:
        """n of the structures on the chain, as controllers are tuned on them."""
        step = max(self.timestep, self.structure.searched, self.tuning_step)
        return Task(self.structure, n, period=self.period, timestep=step, engine="chain", reward=None)

    def ranges(self, kind: str) -> Ranges:
        """Of every option of a kind. Raises InputError where there is none."""
        if kind not in self.tuned.values():
            raise InputError(f"tuning: nothing to tune in {kind}; allowed: {', '.join(self.tuned.values())}")
        known = {"value": (0.0, self.site.command_max), **self.site.ranges()}
        return {name: known.get(f"{kind}.{name}") or known[name] for name in self.site.options[kind]}

    def tuning_loads(self) -> Sequence[Any]:
        return self.structure.validation()

    def key(self, spec: str, load: Any, amplitude: float) -> str:
        return hashlib.sha256(
            self._content + f"{spec} {amplitude!r}".encode() + content(load) + told.files_of(spec)
        ).hexdigest()[:32]

    @cached_property
    def _content(self) -> bytes:
        library = hashlib.sha256(Path(library_path()).read_bytes()).digest()
        return f"{_VERSION} {__version__} {type(self).__name__}".encode() + content(self) + library

    def forces(self, load: Any) -> Array:
        """`Structure.forces`. Raises InputError."""
        return np.asarray(self.structure.forces(load))

    def likeness(self, load: Any, *, rest: bool = True) -> str:
        """Of a load's forces over their peak, and their sample time: that of loads which differ by a factor is the
        same. rest: False leaves out what comes before the first and after the last force that is not zero."""
        forces = self.forces(load)
        peak = forces.flat[np.abs(forces).argmax()] or 1.0
        step = load.duration / max(len(forces) - 1, 1)
        acting = np.flatnonzero(np.any(forces != 0.0, axis=tuple(range(1, forces.ndim))))
        if len(acting) and not rest:
            forces = forces[acting[0] : acting[-1] + 1]
        shape = np.round(forces / peak, 6) + 0.0
        return digest([f"{step:.3g}", shape.tobytes().hex()])

    def identity(self) -> str:
        """What tuned settings belong to, as a hash."""
        return digest([*self.own_identity(), [self._sizes(load) for load in self.tuning_loads()]])

    def _sizes(self, load: Any) -> list[Any]:
        """Of a load, in digits that do not depend on the processor."""
        forces = self.forces(load)
        sizes = load.duration, np.abs(forces).max(), np.sqrt(np.mean(forces * forces))
        return [load.name, forces.shape, *(f"{x:.6g}" for x in sizes)]


#: s. Every run is as long as with control periods of this, so that no controller is judged by motion that another's run
#: is too short for; a period that is no multiple of it is stepped in parts of at most _PART.
WINDOW = 5e-3
_PART = 1e-3


@dataclass(frozen=True)
class PlantRun:
    """Samples every `period` (s): results of the rows for each period (n, columns), at its end command and current (A
    or V), (n,) each. peak_force: N, over all steps of the engine."""

    period: float
    of_period: Array
    command: Array
    current: Array
    peak_force: float

    @property
    def duration(self) -> float:
        """s."""
        return self.period * len(self.command)

    def electric(self, unit: str, command_max: float) -> dict[str, Any]:
        way = float(np.abs(np.diff(self.command)).sum())
        return {
            "mean_command": float(np.abs(self.command).mean()),
            "rms_command": float(np.sqrt(np.mean(self.command**2))),
            "switching_rate": way / command_max / self.duration,
            **coil(unit, float(np.abs(self.current).mean()), float(np.mean(self.current**2)), self.duration),
        }


@dataclass(frozen=True, kw_only=True)
class PlantBench(Bench):
    """Base of benches whose runs are those of a `RowPlant`."""

    command_unit: str = "V"
    period: float = 5e-3
    timestep: float = 5e-4
    engine: str = "mujoco"

    def run(self, spec: str, load: Any, amplitude: float) -> dict[str, Any]:
        if spec == UNCONTROLLED:
            return self.uncontrolled(load.scaled(amplitude))
        return self.driven(self.controller(spec), load, amplitude)

    @abstractmethod
    def uncontrolled(self, load: Any) -> dict[str, Any]:
        """What is kept of the run that ratios are over."""

    @abstractmethod
    def kept(self, run: PlantRun) -> dict[str, Any]:
        """What is kept of a controller's run, besides `PlantRun.electric`."""

    def driven(self, controller: Controller, load: Any, amplitude: float) -> dict[str, Any]:
        """What is kept of a controller's run. Raises InputError."""
        scaled, every = load.scaled(amplitude), round(controller.period / WINDOW)
        if every < 1 or abs(every * WINDOW - controller.period) > 1e-9 * WINDOW:
            every = math.ceil(controller.period / _PART - 1e-9)
        period = controller.period / every
        for each in (controller.period, period):
            require_periods(scaled, each)
        plant = RowPlant(self.structure, period=period, timestep=self.timestep, engine=self.engine)
        sampled, measured = ZeroOrderHold(controller, every), self.measured
        plant.rows.window = WINDOW
        sampled.reset()
        y, rows, said, peak_force = plant.reset(scaled), [], [], 0.0
        plant.rows.follow(["true_force"])
        while not plant.finished:
            # In a copy of its own.
            command = sampled.command(plant.time, {name: y[name] for name in measured})
            y = plant.step(command)
            rows.append((command, y["current"]))
            said.append(tuple(plant.of_period))
            peak_force = max(peak_force, float(np.abs(plant.rows.within()).max()))
        command, current = np.array(rows).T
        run = PlantRun(period, np.array(said), command, current, peak_force)
        return {**self.kept(run), **run.electric(self.command_unit, self.site.command_max)}
