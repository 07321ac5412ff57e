"""A NARX network as data: inputs, scaling and weights; its passes, its free run and the plugin's text.

Weights are one vector theta (M,): layer by layer the matrix (rows, cols) row by row, then the bias (rows,). The
arithmetic is in scaled units: tanh layers and a linear output, with exact derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from mrdamp.errors import InputError
from mrdamp.model import core
from mrdamp.model.core import Array

Shape = tuple[int, int]


def shapes(inputs: int, hidden: Sequence[int]) -> list[Shape]:
    """(rows, cols) of every layer, the output's last."""
    widths = [inputs, *hidden, 1]
    return [(rows, cols) for cols, rows in pairwise(widths)]


def count(inputs: int, hidden: Sequence[int]) -> int:
    return sum(rows * (cols + 1) for rows, cols in shapes(inputs, hidden))


def unpack(theta: Array, inputs: int, hidden: Sequence[int]) -> list[tuple[Array, Array]]:
    """Views of theta: (weight (rows, cols), bias (rows,)) per layer."""
    out, k = [], 0
    for rows, cols in shapes(inputs, hidden):
        bias = k + rows * cols
        out.append((theta[k:bias].reshape(rows, cols), theta[bias : bias + rows]))
        k = bias + rows
    return out


def pack(layers: Sequence[tuple[Array, Array]]) -> Array:
    """The vector that `unpack` takes apart."""
    return np.concatenate([part for weight, bias in layers for part in (weight.ravel(), bias)])


def output(layers: Sequence[tuple[Array, Array]], a: Array) -> Array:
    """Scaled output (N,) of scaled inputs (N, inputs)."""
    for weight, bias in layers[:-1]:
        a = np.tanh(a @ weight.T + bias)
    weight, bias = layers[-1]
    return np.asarray(a @ weight[0] + bias[0])


def derivatives(
    layers: Sequence[tuple[Array, Array]], a: Array, columns: Sequence[int] = ()
) -> tuple[Array, Array, Array]:
    """Output y (N,), dy/dtheta (N, M) and dy/da (N, len(columns)), exact, by backpropagation for all samples at once.

    layers: as from `unpack`. a: scaled inputs (N, inputs). columns: inputs whose derivatives are wanted too.
    """
    n = len(a)
    values = [a]
    for weight, bias in layers[:-1]:
        values.append(np.tanh(values[-1] @ weight.T + bias))
    last, bias = layers[-1]
    y = values[-1] @ last[0] + bias[0]
    jacobian = np.empty((n, sum(w.size + b.size for w, b in layers)))
    end = jacobian.shape[1]
    delta = np.ones((n, 1))  # dy / d(what goes into the layer's tanh)
    for k in range(len(layers) - 1, -1, -1):
        weight, bias = layers[k]
        rows, cols = weight.shape
        start = end - rows * (cols + 1)
        jacobian[:, end - rows : end] = delta
        target = jacobian[:, start : end - rows].reshape(n, rows, cols, copy=False)
        np.multiply(delta[:, :, None], values[k][:, None, :], out=target)
        if k:
            delta = (delta @ weight) * (1.0 - values[k] ** 2)
        end = start
    chosen = np.asarray(list(columns), dtype=int)
    return y, jacobian, delta @ layers[0][0][:, chosen]


def nguyen_widrow(inputs: int, hidden: Sequence[int], rng: np.random.Generator) -> Array:
    """Starting weights (M,) that spread the units' active ranges over inputs in [-1, 1].

    Nguyen and Widrow, IJCNN 1990, doi 10.1109/IJCNN.1990.137819; the output starts small.
    """
    parts: list[tuple[Array, Array]] = []
    for rows, cols in shapes(inputs, hidden)[:-1]:
        size = 0.7 * rows ** (1.0 / cols)
        weight = rng.uniform(-1.0, 1.0, (rows, cols))
        weight *= size / np.linalg.norm(weight, axis=1, keepdims=True)
        parts.append((weight, size * np.linspace(-1.0, 1.0, rows) * np.sign(weight[:, 0]) if rows > 1
                      else np.zeros(1)))  # fmt: skip
    width = hidden[-1] if hidden else inputs
    parts.append((rng.uniform(-0.5, 0.5, (1, width)) / np.sqrt(width), np.zeros(1)))
    return pack(parts)


Input = tuple[str, int]

CHANNELS = ("x", "v", "i", "F")
MAX_LAG, MAX_UNITS = 32, 256


@dataclass(frozen=True, eq=False)
class Network:
    """F(t) = force_scale * net((input - offset) * scale) + force_offset, tanh layers and a linear output.

    Chen, Ni and Or (2015), Eqs. (5), (9), (11).

    sample_time: s. inputs: (channel, lag in samples); channels x (m), v (m/s), i (command), F (N, lag at least 1).
    offset, scale: (inputs,), in the unit of the input and its reciprocal. force_offset, force_scale: N. hidden: units
    per hidden layer, none to two layers. theta: (M,) weights, layer by layer as `unpack` takes them. Raises InputError.
    """

    sample_time: float
    inputs: tuple[Input, ...]
    offset: Array
    scale: Array
    force_offset: float
    force_scale: float
    hidden: tuple[int, ...]
    theta: Array

    def __post_init__(self) -> None:
        check_inputs(self.inputs)
        check_hidden(self.hidden)
        n = len(self.inputs)
        for name, size in (("offset", n), ("scale", n), ("theta", count(n, self.hidden))):
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.shape != (size,) or not np.isfinite(array).all():
                raise InputError(f"network: {name} has shape {array.shape}; allowed: ({size},), finite")
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @cached_property
    def layers(self) -> list[tuple[Array, Array]]:
        """(weight, bias) per layer."""
        return unpack(self.theta, len(self.inputs), self.hidden)

    @property
    def max_lag(self) -> int:
        """Samples."""
        return max(lag for _, lag in self.inputs)

    @property
    def feedback(self) -> tuple[int, ...]:
        """Positions of the force among the inputs."""
        return tuple(k for k, (channel, _) in enumerate(self.inputs) if channel == "F")

    @property
    def topology(self) -> str:
        """As the papers write it, such as 15-20-1."""
        return "-".join(str(k) for k in (len(self.inputs), *self.hidden, 1))

    @property
    def nonzero(self) -> int:
        return int(np.count_nonzero(self.theta))

    def with_theta(self, theta: Array) -> Network:
        """The same network with other weights (M,)."""
        return replace(self, theta=theta)

    def scaled(self, values: Array) -> Array:
        """Inputs (N, inputs) in physical units, scaled."""
        return np.asarray((values - self.offset) * self.scale)

    def forward(self, values: Array) -> Array:
        """Force (N,) in newton of N inputs (N, inputs) in physical units."""
        return output(self.layers, self.scaled(values)) * self.force_scale + self.force_offset

    def to_text(self) -> str:
        """The plugin's weights file, every digit kept."""
        lines = [
            "mrdamp-narx 1",
            f"sample_time {float(self.sample_time)!r}",
            f"inputs {len(self.inputs)} " + " ".join(f"{channel}:{lag}" for channel, lag in self.inputs),
            "offset " + _numbers(self.offset),
            "scale " + _numbers(self.scale),
            f"force {float(self.force_offset)!r} {float(self.force_scale)!r}",
            " ".join(["hidden", str(len(self.hidden)), *map(str, self.hidden)]),
        ]
        for weight, bias in self.layers:
            lines += ["weight " + _numbers(weight.ravel()), "bias " + _numbers(bias)]
        return "\n".join([*lines, "end", ""])

    @classmethod
    def from_text(cls, text: str) -> Network:
        """Reads a weights file; InputError as from the plugin's own reader."""
        core.Narx(text)  # checks it word by word
        words = iter(text.split())

        def numbers(count: int) -> Array:
            next(words)
            return np.array([float(next(words)) for _ in range(count)])

        next(words)
        next(words)
        (sample_time,) = numbers(1)
        (n,) = numbers(1).astype(int)
        inputs = tuple((word.split(":")[0], int(word.split(":")[1])) for word in (next(words) for _ in range(n)))
        offset, scale, force = numbers(n), numbers(n), numbers(2)
        (layers,) = numbers(1).astype(int)
        hidden = tuple(int(next(words)) for _ in range(layers))
        theta = np.concatenate([numbers(size) for rows, cols in shapes(n, hidden) for size in (rows * cols, rows)])
        return cls(float(sample_time), inputs, offset, scale, float(force[0]), float(force[1]), hidden, theta)


def check_inputs(inputs: Sequence[Input]) -> None:
    """Raises InputError for an unknown channel, a lag out of range, an input twice or none at all."""
    if not inputs or len(set(inputs)) != len(inputs):
        raise InputError(f"network inputs: {list(inputs)}; allowed: at least one, none twice")
    for channel, lag in inputs:
        if channel not in CHANNELS or not (channel == "F") <= lag <= MAX_LAG:
            raise InputError(
                f"network input {channel}:{lag}; allowed: x, v, i with lag 0 to {MAX_LAG}, F with lag 1 to {MAX_LAG}"
            )


def check_hidden(hidden: Sequence[int]) -> None:
    """Raises InputError for more than two hidden layers, or a layer without units or with too many."""
    if len(hidden) > 2 or any(not 1 <= units <= MAX_UNITS for units in hidden):
        raise InputError(
            f"hidden units {list(hidden)}; allowed: none to two layers of 1 to {MAX_UNITS} units"
        )


def _numbers(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)
