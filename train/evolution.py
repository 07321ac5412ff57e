"""Evolution strategy: a small network's weights searched by the criteria that a policy is evaluated by.

Covariance matrix adaptation, after Hansen, The CMA Evolution Strategy: A Tutorial (2016), arXiv:1604.00772, with the
default parameters of its table 1, active update and step-size bound left out. It complements the learners of
stable-baselines3 because peak ratios are figures of an episode: their gradient over single steps is little but noise.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import IO

import numpy as np

from mrdamp.control.networks import Network
from mrdamp.errors import InputError
from mrdamp.model.core import Array

_LINEAR = 0.1  # share of a tanh's input that is as good as straight
_FRESH = 0.15  # share of the newest mean in the average


class Cma:
    """Minimises over n numbers. Attributes: mean (n,), sigma, generation; population, candidates a generation; average
    (n,), of the mean over the last generations, which noise in the scores moves less."""

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
        """Back to what was saved."""
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
