"""What all real frames of a study share: the nominal simulator, the ground motions, scores, tuning."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from mrdamp import sets
from mrdamp.compare.motions import tuning_motions, unseen_motions
from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.told import told
from mrdamp.errors import InputError
from mrdamp.gap.learned import Learning, Progress
from mrdamp.gap.real import RealFrame
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.motions import TIME_SCALE, GroundMotion
from mrdamp.parallel import mapped
from mrdamp.simulation.criteria import Criteria, evaluate
from mrdamp.simulation.stepping import FrameRun, run_frame
from mrdamp.structures import ShearFrame, dyke1996

Plant = Model | RealFrame

_BLIND = 0.15  # half width of the ranges of who has no diagnosis


def nominal_frame() -> Model:
    """The nominal simulator: the frame and the damper of Dyke et al. (1996), no effect."""
    found = sets.load("dyke1996_3kN")
    return Model(found.law, dict(found.parameters), rig="frame", structure=dyke1996(), name="frame")


class Scenario:
    """A controller's workplace. controller: a kind or a spec; count: unseen motions; draws: simulators of a randomised
    tuning; trainings: folder where what is learned is kept."""

    def __init__(
        self,
        nominal: Model,
        controller: str,
        count: int,
        draws: int,
        seed: int,
        jobs: int = 1,
        *,
        trainings: Path = Path("trainings"),
    ) -> None:
        self.nominal, self.controller, self.draws, self.seed, self.jobs = (
            nominal,
            controller,
            draws,
            seed,
            jobs,
        )
        self.learning = Learning.of(controller, seed, trainings)
        self.loads = [m.compressed(TIME_SCALE) for m in unseen_motions()[:count]]
        self.training = [m.compressed(TIME_SCALE) for m in tuning_motions()]
        # By name: a process that tunes has copies of the motions.
        self._reference = {m.name: self.criteria(nominal, None, m) for m in (*self.loads, *self.training)}

    @property
    def robust(self) -> bool:
        """Whether a policy is learned over several simulators: the evolution strategy alone does."""
        return self.learning is not None and self.learning.algorithm == "es"

    def site(self, model: Model) -> registry.Site:
        return registry.Site.of(model)

    def of(self, run: FrameRun) -> Criteria:
        assert self.nominal.structure is not None
        largest = self.nominal.attributes["command_max"]
        return evaluate(
            self.nominal.structure,
            run.time,
            run.drift,
            run.acceleration,
            run.force,
            run.stroke,
            run.command,
            largest,
        )

    def criteria(self, plant: Plant, controller: Controller | None, load: GroundMotion) -> Criteria:
        """Of a run in MuJoCo, or on a real frame (with a controller)."""
        if isinstance(plant, Model):
            return self.of(run_frame(plant, load, controller))
        assert controller is not None
        return self.of(plant.run(load, controller)[0])

    def score(self, criteria: Sequence[Criteria], loads: Sequence[GroundMotion] | None = None) -> float:
        values = []
        for c, load in zip(criteria, self.loads if loads is None else loads, strict=True):
            free = self._reference[load.name]
            drift = c.peak_drift.max() / free.peak_drift.max()
            values.append((drift + c.peak_acceleration.max() / free.peak_acceleration.max()) / 2)
        return float(np.mean(values))

    def tune(
        self, plants: Sequence[Plant], site: registry.Site, progress: Progress | None = None
    ) -> Controller:
        """The controller made for a site that is best on average over simulators, or real frames, and tuning
        motions; one that is learned: over the simulators."""
        if self.learning:
            simulators = [plant for plant in plants if isinstance(plant, Model)]
            return self.learning.train(simulators, site, progress)
        if not is_tuned(self.controller):
            return told(partial(registry.make, self.controller), site)
        specs = candidates(self.controller, site)
        tasks = [(self, p, spec, site) for spec in specs for p in plants]
        found = np.reshape(list(mapped(_tuning_score, tasks, self.jobs)), (len(specs), len(plants)))
        return told(partial(registry.make, specs[int(np.argmin(found.mean(axis=1)))]), site)

    def blind(self) -> list[Model]:
        """The nominal simulator with masses, stiffnesses and size of the damper drawn about the nominal values."""
        rng = np.random.default_rng([self.seed, 1])
        return [self._scaled(rng) for _ in range(self.draws)]

    def _scaled(self, rng: np.random.Generator) -> Model:
        s = self.nominal.structure
        assert s is not None

        def around(values: Array) -> Array:
            return values * rng.uniform(1 - _BLIND, 1 + _BLIND, np.shape(values))

        frame = ShearFrame(around(s.mass), around(s.stiffness), around(s.damping), s.damper_between)
        size = float(rng.uniform(1 - _BLIND, 1 + _BLIND))
        scaled = {
            k: v * size if k.startswith(("alpha_", "c0", "c1", "f0", "k1", "fy")) else v
            for k, v in self.nominal.parameters.items()
        }
        return replace(self.nominal, structure=frame, parameters=scaled)


def candidates(kind: str, site: registry.Site) -> tuple[str, ...]:
    """Specs of a kind that a study tries: runs on a real frame are few. Raises InputError for one without options."""
    frame, largest = site.frame, site.command_max
    mass, first = float(frame.mass.sum()), 2 * math.pi * float(frame.frequencies[0])
    weights, noise = [k / mass**2 for k in (1e-3, 1e-1)], [50.0, 2000.0]
    balances = [30.0, 100.0, 300.0, 1000.0]
    optimal = {"balance": balances, "r": weights, "noise_ratio": noise}
    choices: Mapping[str, Mapping[str, Sequence[float]]] = {
        "constant": {"value": [largest * k / 20 for k in (0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 18, 20)]},
        "clipped-optimal": {**optimal, "balance": [1.0, 10.0, *balances, 3000.0], "level": [0.6, 1.0]},
        "modulated-optimal": {
            **optimal,
            "r": weights[1:],
            "force_max": [site.force_max * k for k in (0.1, 0.2, 0.5)],
        },
        "force-tracking": {**optimal, "balance": [10.0, *balances]},
        "lyapunov": {"balance": [0.0, 1.0, 10.0, 100.0, 1000.0], "noise_ratio": noise},
        "skyhook": {
            "damping": [first * mass * k for k in (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)],
            "leak": [2 * math.pi / first * k for k in (1.0, 2.0)],
        },
    }
    if kind not in choices:
        raise InputError(f"tuning: nothing to tune in {kind}; allowed: {', '.join(choices)}")
    chosen = choices[kind]
    points = [dict(zip(chosen, point, strict=True)) for point in itertools.product(*chosen.values())]
    return tuple(registry.spec(kind, point) for point in points)[:: 1 if kind == "constant" else 3]


def is_tuned(controller: str) -> bool:
    """A kind by its name alone is tuned; one with options, or a policy's file, is left as it is."""
    return ":" not in controller


def _tuning_score(scenario: Scenario, plant: Plant, spec: str, site: registry.Site) -> float:
    controller = told(partial(registry.make, spec), site)
    return scenario.score(
        [scenario.criteria(plant, controller, load) for load in scenario.training], scenario.training
    )
