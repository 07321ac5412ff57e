"""Trainings by an evolution strategy: every candidate under the same loads, all at once as rows of one task."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.control.networks import Network
from mrdamp.control.policy import velocities
from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.model.core import Array
from mrdamp.train.evaluate import episodes, forces
from mrdamp.train.evolution import Cma, Shape, actions
from mrdamp.train.run import StepRun, reading
from mrdamp.train.settings import Options, Settings
from mrdamp.train.worlds import World

#: What the hyperparameters hold besides `Settings`: loads and candidates a generation; the first step size; the
#: score's share for the mean current over its largest; white noise on what candidates see, in the observer's units, so
#: that what only exact measurements allow is not found. A least command of `Settings` stays as it is: the price of the
#: current is more than its gain under most loads, and its gain under the weakest would be lost in the mean.
DEFAULTS: Mapping[str, Any] = {"loads": 12, "population": 12, "sigma": 0.1, "current": 0.05, "noise": 0.0}


class EvolutionRun(StepRun):
    """One training. n_envs is loads times population; a generation counts the control periods of all rows."""

    kept_in = "checkpoint.npz"

    def __init__(self, options: Options, chosen: Settings, out: Path) -> None:
        own = chosen.learner_over(DEFAULTS, "es")
        self.population, self.loads_count = int(own["population"]), int(own["loads"])
        self._current, self._noise = float(own["current"]), float(own["noise"])
        if not 0 <= self._noise < math.inf:
            raise InputError(f"es: hyperparameters: noise is {self._noise}; allowed: a number >= 0")
        self._sigma = float(own["sigma"])
        super().__init__(options, chosen, out, 1)
        if len(self.worlds) > self.loads_count:
            raise InputError(
                f"es: {len(self.worlds)} models for {self.loads_count} loads; allowed: a load each at least"
            )
        self.shape = Shape(self.inputs, chosen.policy_kwargs.get("net_arch", []))
        rng = np.random.default_rng(self.seed)
        start = self.shape.start(rng)
        if chosen.teacher:
            start = self.shape.linear(start, self.taught())
        self.cma = Cma(start, self._sigma, self.population, rng)
        if self.resumed:
            with reading(self.checkpoint):
                self.cma.load(self.checkpoint)
            self._periods = self.reached

    def step(self) -> float:
        scores = self._scores(self.cma.ask())
        self.cma.tell(scores)
        return float(scores.mean())

    def network(self) -> Network:
        return self.shape.network(self.cma.average)

    def save(self) -> None:
        write_atomic(self.checkpoint, self.cma.save)

    def _scores(self, candidates: Array) -> Array:
        """(population,) of candidates (population, numbers), under loads that each generation draws anew."""
        layers = self.shape.layers(candidates)
        rng = self.numbers(self.cma.generation)
        loads = self.world.structure.some(rng, self.loads_count)
        worlds = self.sharing(rng, len(loads))
        found = [self._measures(w, loads[k :: len(worlds)], layers, rng) for k, w in enumerate(worlds)]
        means = {name: np.concatenate([f[name] for f in found], axis=1).mean(axis=1) for name in found[0]}
        return np.array(
            [
                self.world.score({name: float(v[k]) for name, v in means.items()})
                + self._current * float(means["mean_current"][k]) / self.command_max
                for k in range(self.population)
            ]
        )

    def _measures(
        self, world: World, loads: Sequence[Any], layers: Any, rng: np.random.Generator
    ) -> dict[str, Array]:
        """The world's measures (population, loads) of all candidates under the loads."""
        many, least = len(loads), self.least()
        task = world.searching(self.population * many)

        def act(observation: NDArray[np.float32]) -> Array:
            inputs = observation.astype(np.float64)
            if self._noise:
                noise = self._noise * rng.standard_normal((many, observation.shape[1]))
                inputs = inputs + np.tile(noise, (self.population, 1))  # the same for every candidate
            inputs = inputs @ self.matrix.T
            action = actions(layers, inputs.reshape(self.population, many, -1)).ravel()
            if self.levels is None:
                command = np.asarray(0.5 * (action + 1.0) * self.command_max)
            else:
                velocity = velocities(task.observer, observation, self.chosen.ahead)
                command = self.levels.command(action * self.levels.force_max, forces(task, observation), velocity)
            return command if least is None else np.maximum(command, least(task.observer.peak(observation, "force")))

        found, periods = episodes(task, world, list(loads) * self.population, act)
        self._periods += periods
        return {name: v.reshape(self.population, many) for name, v in found.items()}
