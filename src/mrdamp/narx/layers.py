"""The network's arithmetic in scaled units: tanh layers and a linear output, with exact derivatives.

Weights are one vector theta (M,): layer by layer the matrix (rows, cols) row by row, then the bias (rows,).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from mrdamp.model.core import Array

Shape = tuple[int, int]


def shapes(inputs: int, hidden: Sequence[int]) -> list[Shape]:
    """(rows, cols) of every layer, the output's last."""
    widths = [inputs, *hidden, 1]
    return [(rows, cols) for cols, rows in pairwise(widths)]


def count(inputs: int, hidden: Sequence[int]) -> int:
    """Number of weights and biases M."""
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
    """Output with its exact derivatives, by backpropagation for all samples at once.

    Args:
        layers: as from `unpack`.
        a: scaled inputs (N, inputs).
        columns: inputs whose derivatives are wanted too.

    Returns:
        y (N,), dy/dtheta (N, M), dy/da of the columns (N, len(columns)).
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
