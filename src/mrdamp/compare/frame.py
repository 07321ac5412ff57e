"""A frame under ground motions: one run, what is kept of it, what tuning tries; clairvoyant commands."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from mrdamp.compare.beam import least
from mrdamp.compare.bench import ELECTRIC, UNCONTROLLED, Bench, Measure, coil, require_periods
from mrdamp.compare.clairvoyant import Path, Peaks, search
from mrdamp.compare.rollouts import Rollouts
from mrdamp.control import registry
from mrdamp.control.base import OWN, Controller, ZeroOrderHold, sensor_name
from mrdamp.control.passive import Replay
from mrdamp.control.told import knowledge
from mrdamp.envs.frame import Frame, FramePlant
from mrdamp.envs.frame_rows import FrameChain
from mrdamp.envs.training_loads import unseen_motions
from mrdamp.errors import InputError, require_positive
from mrdamp.model import FLOOR_SENSOR_EFFECTS, Model
from mrdamp.model.core import Array
from mrdamp.motions import TIME_SCALE, GroundMotion
from mrdamp.simulation.criteria import Criteria, evaluate
from mrdamp.simulation.floor_sensors import FloorSensors
from mrdamp.simulation.rows import Stepping
from mrdamp.simulation.stepping import SAMPLE_TIME, FrameRun, run_frame

#: J1 to J6 and J12 over the uncontrolled run, J11 over the weight, as in mrdamp.simulation.criteria.
_RATIOS = ("J1", "J2", "J3", "J4", "J5", "J6", "J11", "J12")


@dataclass(frozen=True)
class FrameBench(Bench):
    """A frame with its damper, ready to run. model: of the rig `frame`; compression: how many times as fast motions
    are played; period: of the classical controllers, s; timestep: of the engine, s; engine: `mujoco`, or `chain` for
    runs with the damper (an ideal actuator and the frame alone stay in MuJoCo). told: the model that controllers are
    made for, None: the true one. Raises InputError."""

    model: Model
    command_unit: str = "V"
    compression: float = 5.0
    period: float = 1e-3
    timestep: float = 2.5e-4
    engine: str = "mujoco"
    told: Model | None = None

    measures: ClassVar[tuple[Measure, ...]] = (
        *(Measure(key, key, ratio=True) for key in _RATIOS),
        *ELECTRIC,
        Measure("dissipated_energy", "dissipated (J)"),
    )
    headline: ClassVar[tuple[str, ...]] = ("J1", "J2", "J4", "J5", "mean_command", "switching_rate")
    claimed: ClassVar[tuple[str, ...]] = ("J1", "J2", "mean_command")
    bounds: ClassVar[Mapping[str, Mapping[str, float]]] = {
        "clairvoyant": {"J1": 0.5, "J2": 0.5},
        "clairvoyant-drift": {"J1": 1.0},
        "clairvoyant-acceleration": {"J2": 1.0},
    }

    def __post_init__(self) -> None:
        require_positive("compare", compression=self.compression)
        super().__post_init__()
        true, told = self.model.structure, (self.told or self.model).structure
        if true and told and (true.storeys, true.places) != (told.storeys, told.places):
            raise InputError(
                f"{self.told and self.told.name}: a frame of {told.storeys} storeys with dampers at {told.places}; "
                f"allowed: that of {self.model.name}, {true.storeys} with {true.places}"
            )

    @cached_property
    def site(self) -> registry.Site:
        """What controllers are made for: what they are told, with the range of the command that there is."""
        told = self.told or self.model
        ends = {k: v for k, v in self.model.parameters.items() if k.startswith("command_")}
        return registry.Site.of(replace(told, parameters={**told.parameters, **ends}), self.period)

    @property
    def default(self) -> tuple[str, ...]:
        """Of several dampers without an ideal actuator."""
        return super().default if self.places[1:] else (*super().default, registry.IDEAL)

    @property
    def objective(self) -> Mapping[str, tuple[str, float]]:
        """The mean of peak drift and peak acceleration over the uncontrolled ones."""
        return {"J1": ("drift_ratio", 0.5), "J2": ("acceleration_ratio", 0.5)}

    @property
    def places(self) -> tuple[tuple[int, int], ...]:
        return self.site.frame.places

    @property
    def measured(self) -> list[str]:
        floors, names = range(1, self.site.frame.storeys + 1), ("acceleration", "displacement")
        own = [sensor_name(name, k) for k in range(self.site.dampers) for name in OWN]
        return [*(f"{what}_{j}" for what in names for j in floors), *own]

    def history(self, spec: str, load: GroundMotion, amplitude: float) -> FrameRun:
        """The run itself, sampled at every step of the engine; spec: see `mrdamp.control.registry`."""
        if spec == UNCONTROLLED:
            played = self.played(load, amplitude)
            require_periods(played, SAMPLE_TIME)
            return run_frame(self.model, played, None, timestep=self.timestep, each_step=True)
        return self.driven(self.controller(spec), load, amplitude, ideal=registry.is_ideal(spec))

    def controller(self, spec: str) -> Controller:
        """Of a spec, as it is compared: see `mrdamp.control.told`. Raises InputError."""
        if registry.is_ideal(spec):  # its force is its own command, which no sensor reads
            return registry.make(spec, self.site)
        return super().controller(spec)

    @cached_property
    def structure(self) -> Frame:
        assert self.model.structure is not None
        single = replace(self.model, structure=replace(self.model.structure, others=()))
        return Frame(single, damper_between=self.model.structure.places)

    def played(self, load: GroundMotion, amplitude: float) -> GroundMotion:
        return load.scaled(amplitude).compressed(self.compression)

    def driven(
        self, controller: Controller, load: GroundMotion, amplitude: float, *, ideal: bool = False
    ) -> FrameRun:
        """`history` of a controller. ideal: an actuator stands in the damper's place, the command is its force (N)."""
        played = self.played(load, amplitude)
        every = max(1, math.ceil(controller.period / SAMPLE_TIME - 1e-9))
        finer: Controller = ZeroOrderHold(controller, every) if every > 1 else controller
        require_periods(played, finer.period)
        if not ideal and (self.engine == "chain" or self.places[1:]):
            return run_rows(
                self.model, played, finer, timestep=self.timestep, engine=self.engine, measured=self.measured
            )
        return run_frame(self.model, played, finer, timestep=self.timestep, ideal_force=ideal, each_step=True)

    def criteria(self, spec: str, run: FrameRun) -> Criteria:
        frame, largest = self.model.built, self.site.command_max
        if spec == UNCONTROLLED:
            return evaluate(frame, run.time, run.drift, run.acceleration, command_max=largest)
        return evaluate(frame, run.time, run.drift, run.acceleration, run.force, run.stroke, run.command, largest)

    def run(self, spec: str, load: GroundMotion, amplitude: float) -> dict[str, Any]:
        return self.kept(spec, self.history(spec, load, amplitude))

    def kept(self, spec: str, r: FrameRun) -> dict[str, Any]:
        c = self.criteria(spec, r)
        kept = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(c).items()}
        if spec == UNCONTROLLED or spec.partition(":")[0] == registry.IDEAL:
            return {"criteria": kept, "coil": None}
        mean, square = (
            float(np.trapezoid(v, r.time, axis=0).mean()) / c.duration for v in (np.abs(r.current), r.current**2)
        )
        one = coil(self.command_unit, mean, square, c.duration)
        return {"criteria": kept, "coil": {**one, "coil_energy": len(self.places) * one["coil_energy"]}}

    def values(self, kept: Mapping[str, Any], uncontrolled: Mapping[str, Any]) -> Mapping[str, float]:
        c, coil = _criteria(kept), kept["coil"]
        ratios = c.relative_to(_criteria(uncontrolled))
        electric = dict.fromkeys((m.key for m in ELECTRIC), math.nan)
        if coil is not None:
            electric |= coil
            electric |= {key: getattr(c, key) for key in ("mean_command", "rms_command", "switching_rate")}
        return {**ratios, **electric, "dissipated_energy": c.dissipated_energy}

    def effort(self, kind: str) -> tuple[int, int]:
        """Every amplitude is among the loads; inverse models are slow."""
        return (17, 2_000_000) if kind == "force-tracking" else (8, 12_000_000)

    def tuning_loads(self) -> tuple[GroundMotion, ...]:
        return tuple(m.compressed(self.compression / TIME_SCALE) for m in self.structure.validation())

    def unseen_loads(self) -> tuple[GroundMotion, ...]:
        return unseen_motions()

    def own_identity(self) -> list[Any]:
        return [(self.told or self.model).to_dict()["model"], self.places, self.compression, self.period]

    def about(self) -> str:
        frame = self.site.frame
        places = " and ".join(f"{below}-{above}" for below, above in self.places)
        storeys = "1 storey" if frame.storeys == 1 else f"{frame.storeys} storeys"
        return (
            f"{self.model.name} in a frame of {storeys}, damper between floors {places}, "
            f"motions at {self.compression:g} times their speed, control period {1e3 * self.period:g} ms; "
            f"{knowledge(self.told or self.model)}"
            + (f", of {self.told.name} in place of the true model" if self.told else "")
        )

    def clairvoyant(self, starts: Mapping[str, Sequence[str]], load: GroundMotion, amplitude: float) -> dict[str, Any]:
        """The first bound is searched for from its starts and from passive-off, the others from what the first one
        found and from their starts but the best."""
        free = self.history(UNCONTROLLED, load, amplitude)
        uncontrolled = self.kept(UNCONTROLLED, free)
        period = min(self.period, PERIOD)
        specs = dict.fromkeys([spec for some in starts.values() for spec in some] + [_EXTRA])
        runs = {spec: self.history(spec, load, amplitude) for spec in specs}
        played = self.played(load, amplitude)
        commands = {spec: _held_commands(run, period, played.duration) for spec, run in runs.items()}
        rollouts, peaks = frame_rollouts(self, played, period), Scales(free)
        rollouts.periods = min(rollouts.periods, 1 + max(peaks.last(run, period) for run in runs.values()))
        out: dict[str, Any] = {}
        first: Path | None = None
        for name, weights in self.bounds.items():
            own = starts[name]
            begin = {spec: commands[spec] for spec in (own if first is None else own[1:])}
            begin |= {_EXTRA: commands[_EXTRA]} if first is None else {next(iter(self.bounds)): first.commands}
            paths = search(rollouts, list(begin.items()), peaks.objective(weights))
            first = first or paths[0]
            tail = commands.get(paths[0].name, commands[_EXTRA])
            found = np.concatenate([paths[0].commands, tail[len(paths[0].commands) :]])
            replay = self.driven(Replay(found, period, name), load, amplitude)
            judged = [self.values(self.kept(name, run), uncontrolled) for run in (replay, runs[own[0]])]
            out[name] = {
                "values": least(judged, weights),
                "paths": [{"start": p.name, "values": p.values, "ended": p.ended} for p in paths],
            }
        return out


def _criteria(kept: Mapping[str, Any]) -> Criteria:
    values: dict[str, Any] = {
        k: np.array(v) if isinstance(v, list) else v for k, v in kept["criteria"].items()
    }
    return Criteria(**values)


def run_rows(
    model: Model,
    motion: GroundMotion,
    controller: Controller,
    *,
    timestep: float,
    engine: str = "chain",
    measured: Sequence[str] | None = None,
) -> FrameRun:
    """A controlled frame with a damper or several on rows, as `run_frame` runs one in MuJoCo.

    Sampled at every step of the engine; timestep: the largest, s. measured: what the controller is given, in a copy of
    its own; None: all measurements of the rows.

    Of m dampers, at the places of the model's structure, force, stroke, command and current are (n, m).
    """
    assert model.structure is not None
    ideal = tuple(e for e in model.effects if e.place is None or e.name not in FLOOR_SENSOR_EFFECTS)
    own = replace(model, effects=ideal, structure=replace(model.structure, others=()))
    # The largest command is for shares that no one asks for here; commands are not cut off at it.
    largest = model.attributes.get("command_max", 1.0)
    plant = FramePlant(
        own, damper_between=model.structure.places, period=controller.period, timestep=timestep, command_max=largest,
        engine=engine,
    )  # fmt: skip
    controller.reset()
    y = plant.reset(motion)
    inner: int = plant.rows.plants.inner
    rows: list[Array] = []
    commands: list[list[float]] = []
    floors, dampers = range(1, model.structure.storeys + 1), range(len(model.structure.places))
    names = [f"{what}_{j}" for what in ("drift", "acceleration") for j in floors]
    names += [sensor_name(what, k) for what in ("true_force", "stroke", "current") for k in dampers]
    plant.rows.follow(names)
    # The run has the true accelerations, the controller what the floors' accelerometers read.
    sensors, accelerations = FloorSensors(model.frame, controller.period, 1), [f"acceleration_{j}" for j in floors]
    while not plant.finished:
        read = sensors.read(np.array([[y[name] for name in accelerations]]), None if rows else [0])[0]
        seen = {**y, **dict(zip(accelerations, read.tolist(), strict=True))}
        command = controller.command(plant.time, {name: seen[name] for name in measured or seen})
        before, y = y, plant.step(command)
        rows.append(plant.rows.within())
        rows[-1][0] = [before[name] for name in names]  # before the command
        commands.append(np.broadcast_to(command, len(dampers)).tolist())
    samples = (len(rows) - 1) * inner + 1
    n, m = len(floors), len(dampers)
    drift, acceleration, *each = np.split(np.concatenate(rows)[:samples], np.cumsum([n, n, m, m]), axis=1)
    each.append(np.repeat(commands, inner, axis=0)[:samples])
    force, stroke, current, given = (part if m > 1 else part[:, 0] for part in each)
    return FrameRun(plant.rows.plants.timestep * np.arange(samples), drift, acceleration, force, stroke, given, current)


#: s, of the clairvoyant command at most.
PERIOD = 1e-3
#: s, of the chain. What a search makes small is within 0.3 % of what it is at a quarter of this step.
_STEP = 1e-3
#: Of the largest sample under the starts, what a search still looks at; what comes behind the last such sample keeps
#: the start's command.
_STILL = 0.4
_EXTRA = "passive-off"  # a start besides the given ones: far from all of them


class Scales:
    """What the channels (drifts, accelerations) are taken over: the uncontrolled peaks, as J1 and J2."""

    def __init__(self, free: FrameRun) -> None:
        self.storeys = free.drift.shape[1]
        largest = np.abs(free.drift).max(), np.abs(free.acceleration).max()
        self.scale = np.repeat(largest, self.storeys)

    def objective(self, weights: Mapping[str, float]) -> Peaks:
        of = np.array([weights.get(key, 0.0) for key in ("J1", "J2")])
        return Peaks(of, self.scale, np.repeat([0, 1], self.storeys))

    def last(self, run: FrameRun, period: float) -> int:
        """The period after which no sample is large."""
        size = np.abs(np.hstack([run.drift, run.acceleration])) / self.scale
        for group in (slice(0, self.storeys), slice(self.storeys, None)):
            size[:, group] /= size[:, group].max()
        return int(np.ceil(run.time[np.flatnonzero(size.max(axis=1) >= _STILL)[-1]] / period))


def frame_rollouts(bench: FrameBench, played: GroundMotion, period: float) -> Rollouts:
    """On the chain, with the drifts and accelerations as channels."""
    ideal = tuple(e for e in bench.model.effects if e.place is None or e.name not in FLOOR_SENSOR_EFFECTS)
    model, largest = replace(bench.model, effects=ideal), np.array([bench.site.command_max])

    def make(n: int) -> FrameChain:
        return FrameChain(Frame(model), Stepping(period, min(period, _STEP), largest, n))

    names = make(1).names
    floors = range(1, bench.site.frame.storeys + 1)
    columns = [names.index(f"{what}_{j}") for what in ("drift", "acceleration") for j in floors]
    return Rollouts(make, played, columns, 0.0, float(largest[0]))


def _held_commands(run: FrameRun, period: float, duration: float) -> Array:
    """A run's commands (n,) at a period (s), held as they were."""
    time = period * np.arange(int(np.floor(duration / period + 1e-9)) + 1)
    at = np.searchsorted(run.time, time + 1e-9, side="right") - 1
    return np.asarray(run.command[at])
