"""A frame under ground motions: one run, what is kept of it, and what tuning tries."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mrdamp import __version__
from mrdamp.compare import own
from mrdamp.compare.bench import DEFAULT, ELECTRIC, TUNED, UNCONTROLLED, WITHOUT, Coil, Measure, digest
from mrdamp.compare.motions import TUNING_AMPLITUDES, UNSEEN_AMPLITUDES, tuning_motions, unseen_motions
from mrdamp.compare.on_chain import run_chain
from mrdamp.compare.plant_run import at_rest, require_period, require_periods
from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.told import knowledge
from mrdamp.control.zero_order_hold import ZeroOrderHold
from mrdamp.envs.chain_rows import FRAMES, of_engine
from mrdamp.envs.frame_task import FrameTask
from mrdamp.errors import InputError, require_positive
from mrdamp.library import library_path
from mrdamp.model import Model
from mrdamp.motions import GroundMotion
from mrdamp.simulation.criteria import Criteria, evaluate
from mrdamp.simulation.stepping import FrameRun, run_frame

#: Of what is kept of a run: a controller with a longer period is held in between, so that no peak is missed.
SAMPLE_TIME = 1e-3
_VERSION = 4  # of what a kept run holds
#: J1 to J6 and J12 over the uncontrolled run, J11 over the weight, as in mrdamp.simulation.criteria.
_RATIOS = ("J1", "J2", "J3", "J4", "J5", "J6", "J11", "J12")


@dataclass(frozen=True)
class FrameBench:
    """A frame with its damper, ready to run. model: of the rig `frame`; compression: how many times as fast motions
    are played; period: of the classical controllers, s; timestep: of the engine, s; engine: `mujoco`, or `chain` for
    runs with the damper (an ideal actuator and the frame alone stay in MuJoCo). Raises InputError."""

    model: Model
    command_unit: str = "V"
    compression: float = 5.0
    period: float = 1e-3
    timestep: float = 2.5e-4
    engine: str = "mujoco"

    environment: ClassVar[str] = "frame"
    measures: ClassVar[tuple[Measure, ...]] = (
        *(Measure(key, key, ratio=True) for key in _RATIOS),
        *ELECTRIC,
        Measure("dissipated_energy", "dissipated (J)"),
    )
    headline: ClassVar[tuple[str, ...]] = ("J1", "J2", "J4", "J5", "mean_command", "switching_rate")
    claimed: ClassVar[tuple[str, ...]] = ("J1", "J2", "mean_command")
    tuned: ClassVar[Mapping[str, str]] = {**TUNED, "ideal-active-tuned": registry.IDEAL}
    default: ClassVar[tuple[str, ...]] = (*DEFAULT, "ideal-active-tuned")
    tuning_amplitudes: ClassVar[tuple[float, ...]] = TUNING_AMPLITUDES
    unseen_amplitudes: ClassVar[tuple[float, ...]] = UNSEEN_AMPLITUDES
    reference: ClassVar[str] = WITHOUT
    base: ClassVar[str] = "passive-on"
    bounds: ClassVar[Mapping[str, Mapping[str, float]]] = {
        "clairvoyant": {"J1": 0.5, "J2": 0.5},
        "clairvoyant-drift": {"J1": 1.0},
        "clairvoyant-acceleration": {"J2": 1.0},
    }

    def __post_init__(self) -> None:
        require_period("compare", self.period)
        require_positive("compare", compression=self.compression, timestep=self.timestep)
        of_engine(FRAMES, self.engine)

    @cached_property
    def site(self) -> registry.Site:
        """What controllers are made for."""
        return registry.Site.of(self.model, self.period)

    @property
    def kinds(self) -> tuple[str, ...]:
        return tuple(registry.ENTRIES)

    def check(self, spec: str) -> None:
        registry.parse(spec)
        floors = range(1, self.site.frame.storeys + 1)
        names = [f"{what}_{j}" for what in ("acceleration", "displacement") for j in floors]
        at_rest(self.controller(spec), [*names, "stroke", "stroke_velocity", "force"])

    def history(self, spec: str, load: GroundMotion, amplitude: float) -> FrameRun:
        """The run itself, sampled at SAMPLE_TIME or a little less; spec: see `mrdamp.control.registry`."""
        if spec == UNCONTROLLED:
            played = self.played(load, amplitude)
            require_periods(played, SAMPLE_TIME)
            return run_frame(self.model, played, None, period=SAMPLE_TIME, timestep=self.timestep)
        return self.driven(self.controller(spec), load, amplitude, ideal=registry.is_ideal(spec))

    def controller(self, spec: str) -> Controller:
        """Of a spec, as it is compared: see `mrdamp.control.told`. Raises InputError."""
        if registry.is_ideal(spec):  # its force is its own command, which no sensor reads
            return registry.make(spec, self.site)
        return own.make(spec, self.site, registry.make, partial(FrameTask, model=self.model))

    def played(self, load: GroundMotion, amplitude: float) -> GroundMotion:
        """The motion as the frame feels it."""
        return load.scaled(amplitude).compressed(self.compression)

    def driven(
        self, controller: Controller, load: GroundMotion, amplitude: float, *, ideal: bool = False
    ) -> FrameRun:
        """`history` of a controller. ideal: an actuator stands in the damper's place, the command is its force (N)."""
        played = self.played(load, amplitude)
        every = max(1, math.ceil(controller.period / SAMPLE_TIME - 1e-9))
        finer: Controller = ZeroOrderHold(controller, every) if every > 1 else controller
        require_periods(played, finer.period)
        if self.engine == "chain" and not ideal:
            return run_chain(self.model, played, finer, timestep=self.timestep)
        return run_frame(self.model, played, finer, timestep=self.timestep, ideal_force=ideal)

    def criteria(self, spec: str, run: FrameRun) -> Criteria:
        """Of a run."""
        stroke = None if spec == UNCONTROLLED else run.stroke
        frame, largest = self.site.frame, self.site.command_max
        return evaluate(frame, run.time, run.drift, run.acceleration, run.force, stroke, run.command, largest)

    def run(self, spec: str, load: GroundMotion, amplitude: float) -> dict[str, Any]:
        return self.kept(spec, self.history(spec, load, amplitude))

    def kept(self, spec: str, r: FrameRun) -> dict[str, Any]:
        """What is kept of a run."""
        c = self.criteria(spec, r)
        kept = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(c).items()}
        if spec == UNCONTROLLED or spec.partition(":")[0] == registry.IDEAL:
            return {"criteria": kept, "coil": None}
        mean, square = (
            float(np.trapezoid(v, r.time)) / c.duration for v in (np.abs(r.current), r.current**2)
        )
        return {"criteria": kept, "coil": Coil.of(self.command_unit).use(mean, square, c.duration)}

    def values(self, kept: Mapping[str, Any], uncontrolled: Mapping[str, Any]) -> Mapping[str, float]:
        c, coil = _criteria(kept), kept["coil"]
        ratios = vars(c.relative_to(_criteria(uncontrolled)))
        electric = dict.fromkeys((m.key for m in ELECTRIC), math.nan)
        if coil is not None:
            electric |= coil
            electric |= {key: getattr(c, key) for key in ("mean_command", "rms_command", "switching_rate")}
        return {
            **{key: ratios[key.lower()] for key in _RATIOS},
            **electric,
            "dissipated_energy": c.dissipated_energy,
        }

    def grid(self, kind: str) -> tuple[str, ...]:
        """Forces are weighed in units of the structure's mass."""
        frame, largest = self.site.frame, self.site.command_max
        mass, first = float(frame.mass.sum()), 2 * math.pi * float(frame.frequencies[0])
        weights = [k / mass**2 for k in (1e-3, 1e-1)]
        balances = [30.0, 100.0, 300.0, 1000.0]
        noise = [50.0, 2000.0]  # Dyke's, and that of the learned controllers
        twentieths = (0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 18, 20)
        choices: Mapping[str, Mapping[str, Sequence[float]]] = {
            "constant": {"value": [largest * k / 20 for k in twentieths]},
            "clipped-optimal": {
                "balance": [1.0, 10.0, *balances, 3000.0],
                "r": weights,
                "noise_ratio": noise,
                "level": [0.6, 1.0],
            },
            "modulated-optimal": {
                "balance": balances,
                "r": weights[1:],
                "noise_ratio": noise,
                "force_max": [self.site.force_max() * k for k in (0.1, 0.2, 0.5)],
            },
            "force-tracking": {"balance": [10.0, *balances], "r": weights, "noise_ratio": noise},
            "lyapunov": {"balance": [0.0, 1.0, 10.0, 100.0, 1000.0], "noise_ratio": noise},
            "skyhook": {
                "damping": [first * mass * k for k in (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)],
                "leak": [2 * math.pi / first * k for k in (1.0, 2.0)],
            },
            registry.IDEAL: {"balance": [3.0, 10.0, *balances, 3000.0], "r": weights, "noise_ratio": noise},
        }
        return specs(kind, choices)

    def score(self, values: Mapping[str, float]) -> float:
        """The mean of J1 and J2: peak drift and peak acceleration over the uncontrolled ones."""
        return (values["J1"] + values["J2"]) / 2

    def tuning_loads(self) -> tuple[GroundMotion, ...]:
        return tuning_motions()

    def unseen_loads(self) -> tuple[GroundMotion, ...]:
        return unseen_motions()

    def key(self, spec: str, load: GroundMotion, amplitude: float) -> str:
        digest = hashlib.sha256(self._own)
        digest.update(f"{spec} {amplitude!r} {load.sample_time!r}".encode())
        digest.update(load.acceleration.tobytes())
        digest.update(own.files_of(spec))
        return digest.hexdigest()[:32]

    def identity(self) -> str:
        loads = [load.name for load in self.tuning_loads()]
        own = [self.model.to_dict()["model"], self.compression, self.period, loads, self.tuning_amplitudes]
        return digest(own)

    def about(self) -> str:
        frame = self.site.frame
        below, above = frame.damper_between
        return (
            f"{self.model.name} in a frame of {frame.storeys} storeys, damper between floors {below} and {above}, "
            f"motions at {self.compression:g} times their speed, control period {1e3 * self.period:g} ms; "
            f"{knowledge(self.model)}"
        )

    @cached_property
    def _own(self) -> bytes:
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "model"}
        digest = hashlib.sha256(json.dumps([_VERSION, __version__, own, self.model.to_dict()]).encode())
        digest.update(Path(library_path()).read_bytes())
        return digest.digest()


def specs(kind: str, choices: Mapping[str, Mapping[str, Sequence[float]]]) -> tuple[str, ...]:
    """Every point of a kind's options. Raises InputError for a kind that has none."""
    if kind not in choices:
        raise InputError(f"tuning: nothing to tune in {kind}; allowed: {', '.join(choices)}")
    chosen = choices[kind]
    points = itertools.product(*chosen.values())
    return tuple(registry.spec(kind, dict(zip(chosen, point, strict=True))) for point in points)


def _criteria(kept: Mapping[str, Any]) -> Criteria:
    values: dict[str, Any] = {
        k: np.array(v) if isinstance(v, list) else v for k, v in kept["criteria"].items()
    }
    return Criteria(**values)
