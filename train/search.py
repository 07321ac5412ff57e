"""Trainings by an evolution strategy: a small network's weights searched by the criteria that a policy is evaluated by.

Every candidate runs under the same loads, all at once as rows of one task. It complements the learners of
stable-baselines3 because peak ratios are figures of an episode: their gradient over single steps is little but noise.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.control.policy import Network
from mrdamp.envs.task import episodes
from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.model.core import Array
from mrdamp.train.run import StepRun, reading
from mrdamp.train.settings import Options, Settings
from mrdamp.train.worlds import World, forces

_LINEAR = 0.1  # share of a tanh's input that is as good as straight
_FRESH = 0.15  # share of the newest mean in the average


class Cma:
    """Covariance matrix adaptation: minimises over n numbers.

    After Hansen, The CMA Evolution Strategy: A Tutorial (2016), arXiv:1604.00772, with the default parameters of its
    table 1, active update and step-size bound left out. Attributes: mean (n,), sigma, generation; population,
    candidates a generation; average (n,), of the mean over the last generations, which noise in the scores moves
    less."""

    _KEPT = ("mean", "average", "sigma", "generation", "covariance", "path_c", "path_sigma")

    def __init__(self, mean: Array, sigma: float, population: int, rng: np.random.Generator) -> None:
        if population < 4 or not 0 < sigma < math.inf:
            raise InputError(f"evolution: population {population}, sigma {sigma}; allowed: 4 or more, > 0")
        n, parents = len(mean), population // 2
        self.mean, self.sigma, self.generation = mean.copy(), sigma, 0
        self.average = mean.copy()
        self.population, self._rng = population, rng
        weights = math.log((population + 1) / 2) - np.log(np.arange(1, parents + 1))
        self._weights = weights / weights.sum()
        mass = 1 / float((self._weights**2).sum())
        self._mass = mass
        self._c_c = (4 + mass / n) / (n + 4 + 2 * mass / n)
        self._c_sigma = (mass + 2) / (n + mass + 5)
        self._c_1 = 2 / ((n + 1.3) ** 2 + mass)
        self._c_mu = min(1 - self._c_1, 2 * (mass - 2 + 1 / mass) / ((n + 2) ** 2 + mass))
        self._damping = 1 + 2 * max(0.0, math.sqrt((mass - 1) / (n + 1)) - 1) + self._c_sigma
        self._length = math.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n))  # of a normal vector, expected
        self.covariance, self.path_c, self.path_sigma = np.eye(n), np.zeros(n), np.zeros(n)

    def ask(self) -> Array:
        """(population, n) candidates."""
        values, self._axes = np.linalg.eigh(self.covariance)
        self._spread = np.sqrt(np.maximum(values, 1e-20))
        self._steps = (
            self._rng.standard_normal((self.population, len(self.mean))) * self._spread @ self._axes.T
        )
        return np.asarray(self.mean + self.sigma * self._steps)

    def tell(self, scores: Array) -> None:
        """Scores (population,) of the candidates; smaller is better."""
        best = self._steps[np.argsort(scores)[: len(self._weights)]]
        step = self._weights @ best
        self.mean = self.mean + self.sigma * step
        self.average = self.average + _FRESH * (self.mean - self.average)
        whitened = self._axes @ ((self._axes.T @ step) / self._spread)
        c, mass = self._c_sigma, self._mass
        self.path_sigma = (1 - c) * self.path_sigma + math.sqrt(c * (2 - c) * mass) * whitened
        self.generation += 1
        length = float(np.linalg.norm(self.path_sigma))
        n = len(self.mean)
        early = 1.4 + 2 / (n + 1)
        steady = length / math.sqrt(1 - (1 - c) ** (2 * self.generation)) < early * self._length
        c = self._c_c
        self.path_c = (1 - c) * self.path_c + steady * math.sqrt(c * (2 - c) * mass) * step
        missed = self._c_1 * (not steady) * c * (2 - c)
        self.covariance = (
            (1 - self._c_1 - self._c_mu + missed) * self.covariance
            + self._c_1 * np.outer(self.path_c, self.path_c)
            + self._c_mu * (best.T * self._weights) @ best
        )
        self.sigma *= math.exp(self._c_sigma / self._damping * (length / self._length - 1))

    def save(self, file: Path | IO[bytes]) -> None:
        """Everything that the next generation depends on, as .npz."""
        state = np.array(repr(self._rng.bit_generator.state))
        np.savez(file, state=state, **{name: getattr(self, name) for name in self._KEPT})

    def load(self, path: Path) -> None:
        import ast

        with np.load(io.BytesIO(path.read_bytes())) as kept:  # of a damaged file NumPy would leave it open
            self._rng.bit_generator.state = ast.literal_eval(str(kept["state"]))
            for name in self._KEPT:
                value = kept[name]
                setattr(self, name, value if value.ndim else value.item())


class Shape:
    """A network's layers as one row of numbers: inputs, hidden tanh layers, one output."""

    def __init__(self, inputs: int, hidden: Sequence[int]) -> None:
        widths = [inputs, *hidden, 1]
        self._sizes = list(zip(widths[1:], widths[:-1], strict=True))
        self.size = sum(out * (into + 1) for out, into in self._sizes)

    def start(self, rng: np.random.Generator) -> Array:
        """(size,): hidden layers drawn, the last one zero: no action."""
        parts = [rng.standard_normal((out, into)) / math.sqrt(into) for out, into in self._sizes[:-1]]
        rows = [np.concatenate([w, np.zeros((len(w), 1))], axis=1).ravel() for w in parts]
        return np.concatenate([*rows, np.zeros(self._sizes[-1][1] + 1)])

    def linear(self, numbers: Array, weights: Array) -> Array:
        """(size,) with an output of weights (inputs,) times the inputs, nearly so through a hidden unit a layer."""
        layers = [(w.copy(), b.copy()) for w, b in self.layers(numbers)]
        small = _LINEAR if len(layers) > 1 else 1.0
        for k, (weight, bias) in enumerate(layers):
            weight[0], bias[0] = 0.0, 0.0
            weight[0, : len(weights) if k == 0 else 1] = small * weights if k == 0 else 1.0
        layers[-1][0][0] /= small
        return np.concatenate([np.column_stack([w, b]).ravel() for w, b in layers])

    def layers(self, numbers: Array) -> list[tuple[Array, Array]]:
        """Weights (..., out, in) and biases (..., out) of numbers (..., size)."""
        found, at = [], 0
        for out, into in self._sizes:
            block = numbers[..., at : at + out * (into + 1)].reshape(*numbers.shape[:-1], out, into + 1)
            found.append((block[..., :-1], block[..., -1]))
            at += out * (into + 1)
        return found

    def network(self, numbers: Array) -> Network:
        return Network(tuple(self.layers(numbers)), "tanh")


def actions(layers: Sequence[tuple[Array, Array]], observation: Array) -> Array:
    """(candidates, loads) in [-1, 1] from seen (candidates, loads, in), each candidate by its own layers."""
    for k, (weight, bias) in enumerate(layers):
        observation = observation @ weight.swapaxes(-1, -2) + bias[:, None, :]
        if k < len(layers) - 1:
            observation = np.tanh(observation)
    return np.clip(observation[..., 0], -1.0, 1.0)


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
        self.shape = Shape(self.inputs, chosen.hidden("es"))
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
        many, policy = len(loads), self.policy()
        task = world.searching(self.population * many)

        def act(observation: NDArray[np.float32]) -> Array:
            inputs = observation.astype(np.float64)
            if self._noise:
                noise = self._noise * rng.standard_normal((many, observation.shape[1]))
                inputs = inputs + np.tile(noise, (self.population, 1))  # the same for every candidate
            inputs = inputs @ self.matrix.T
            action = actions(layers, inputs.reshape(self.population, many, -1)).ravel()
            return policy.driven(action, observation, forces(task, observation))

        found = episodes(task, world.measures, list(loads) * self.population, act)
        self._periods += int(task.rows.steps.sum())
        return {name: v.reshape(self.population, many) for name, v in found.items()}
