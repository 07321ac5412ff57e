"""Small networks with NumPy alone: layers, and a long short-term memory before them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrdamp.errors import InputError
from mrdamp.model.core import Array

#: What a memory holds between two calls: output and cell, (n, hidden) each.
State = tuple[Array, Array]

ACTIVATIONS: Mapping[str, Callable[[Array], Array]] = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0.0),
    "elu": lambda x: np.where(x > 0, x, np.expm1(np.minimum(x, 0.0))),
    "identity": lambda x: x,
}


@dataclass(frozen=True, eq=False)
class Network:
    """Layers W (out, in) and b (out,), an activation after all but the last; squash: tanh after the last."""

    layers: tuple[tuple[Array, Array], ...]
    activation: str = "tanh"
    squash: bool = False

    def __post_init__(self) -> None:
        if self.activation not in ACTIVATIONS:
            raise InputError(f"network: activation is {self.activation!r}; allowed: {', '.join(ACTIVATIONS)}")
        if not self.layers:
            raise InputError("network: there is no layer")
        width = None
        for k, (weight, bias) in enumerate(self.layers):
            if weight.ndim != 2 or bias.shape != weight.shape[:1] or width not in (None, weight.shape[1]):
                raise InputError(f"network: layer {k + 1} has weights {weight.shape} and biases {bias.shape}")
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise InputError(f"network: layer {k + 1} has a number that is not finite")
            width = weight.shape[0]

    @property
    def inputs(self) -> int:
        return int(self.layers[0][0].shape[1])

    def __call__(self, x: Array) -> Array:
        """(..., out) in [-1, 1] from (..., in)."""
        activate = ACTIVATIONS[self.activation]
        for weight, bias in self.layers[:-1]:
            x = activate(x @ weight.T + bias)
        weight, bias = self.layers[-1]
        out = x @ weight.T + bias
        return np.asarray(np.tanh(out) if self.squash else np.clip(out, -1.0, 1.0))


@dataclass(frozen=True, eq=False)
class Memory:
    """A long short-term memory of H cells: gates i, f, g, o in this order, as PyTorch's `LSTM` has them.

    given: (4 H, in) and kept: (4 H, H) weights, bias: (4 H,).
    """

    given: Array
    kept: Array
    bias: Array

    def __post_init__(self) -> None:
        four, cells = self.kept.shape if self.kept.ndim == 2 else (0, 0)
        if not cells or four != 4 * cells or self.given.shape[0] != four or self.bias.shape != (four,):
            raise InputError(
                f"memory: weights {self.given.shape}, {self.kept.shape}, biases {self.bias.shape} do not fit together"
            )
        if not all(np.isfinite(part).all() for part in (self.given, self.kept, self.bias)):
            raise InputError("memory: it has a number that is not finite")

    @property
    def cells(self) -> int:
        return int(self.kept.shape[1])

    @property
    def inputs(self) -> int:
        return int(self.given.shape[1])

    def start(self, n: int) -> State:
        """Of n rows that have no past."""
        return np.zeros((n, self.cells)), np.zeros((n, self.cells))

    def __call__(self, x: Array, state: State) -> State:
        """The state after inputs (n, in); its first part is the output."""
        out, cell = state
        i, f, g, o = np.split(x @ self.given.T + out @ self.kept.T + self.bias, 4, axis=1)
        cell = _sigmoid(f) * cell + _sigmoid(i) * np.tanh(g)
        return _sigmoid(o) * np.tanh(cell), cell

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"given": rows(self.given), "kept": rows(self.kept), "bias": rows(self.bias[None])[0]}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Memory:
        """From `to_dict`. Raises InputError, KeyError."""
        return cls(matrix(data["given"]), matrix(data["kept"]), matrix([data["bias"]])[0])


def _sigmoid(x: Array) -> Array:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * x)))


def rows(values: Array) -> list[list[float]]:
    """For JSON, with eight digits: more than single precision holds."""
    return [[float(f"{v:.8g}") for v in row] for row in values.tolist()]


def matrix(given: Sequence[Sequence[float]]) -> Array:
    """(rows, columns). Raises InputError where rows are of different lengths or hold no numbers."""
    try:
        found = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("policy: a matrix is not rows of numbers of one length") from None
    if found.ndim != 2 or not found.size or not np.isfinite(found).all():
        raise InputError("policy: a matrix is not rows of finite numbers")
    return found
