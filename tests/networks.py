"""NARX networks for tests: their weights as text, and their free run in NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from excitation import Array

CHANNELS = "xviF"


@dataclass(frozen=True)
class Network:
    """`inputs`: (channel, lag in samples); layers: (weights (rows, cols), bias (rows,)), the last linear."""

    sample_time: float
    inputs: tuple[tuple[str, int], ...]
    offset: Array
    scale: Array
    force_offset: float
    force_scale: float
    layers: tuple[tuple[Array, Array], ...]

    def forward(self, values: Array) -> float:
        """One pass: inputs in physical units (inputs,) -> force, N."""
        a = (values - self.offset) * self.scale
        for weight, bias in self.layers[:-1]:
            a = np.tanh(weight @ a + bias)
        weight, bias = self.layers[-1]
        return float((weight @ a + bias)[0]) * self.force_scale + self.force_offset

    def free_run(self, x: Array, v: Array, i: Array) -> Array:
        """Force (n,) over its own past. Before the record: x and i as at its start, no v, no force."""
        force = np.zeros(len(x))
        for k in range(len(x)):
            before = {"x": x[0], "v": 0.0, "i": i[0], "F": 0.0}
            now = {"x": x, "v": v, "i": i, "F": force}
            values = [float(now[c][k - lag] if k >= lag else before[c]) for c, lag in self.inputs]
            force[k] = self.forward(np.array(values))
        return force

    def text(self) -> str:
        lines = [
            "mrdamp-narx 1",
            f"sample_time {self.sample_time!r}",
            f"inputs {len(self.inputs)} " + " ".join(f"{channel}:{lag}" for channel, lag in self.inputs),
            "offset " + numbers(self.offset),
            "scale " + numbers(self.scale),
            f"force {self.force_offset!r} {self.force_scale!r}",
            f"hidden {len(self.layers) - 1} " + " ".join(str(len(bias)) for _, bias in self.layers[:-1]),
        ]
        for weight, bias in self.layers:
            lines += [f"weight {numbers(weight.ravel())}", f"bias {numbers(bias)}"]
        return "\n".join([*lines, "end", ""])


def twin(net: Any) -> Network:
    return Network(
        net.sample_time, net.inputs, net.offset, net.scale, net.force_offset, net.force_scale, tuple(net.layers)
    )


def numbers(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def random_network(
    seed: int, hidden: Sequence[int], *, sample_time: float = 2e-3, memory: float = 0.6
) -> Network:
    """Tanh layers with a smooth answer to a motion of millimetres and fractions of m/s; about 300 N. `memory` (0 to
    1) bounds the weight of its own past force, so that the free run is stable."""
    rng = np.random.default_rng(seed)
    lags = {"x": (0, 1, 3), "v": (0, 1, 4), "i": (0, 2), "F": (1, 2, 5)}
    inputs = tuple((channel, lag) for channel in CHANNELS for lag in lags[channel])
    size = {"x": 1 / 0.006, "v": 1 / 0.15, "i": 1 / 1.0, "F": 1 / 300.0}
    scale = np.array([size[channel] for channel, _ in inputs])
    offset = np.array([{"x": 0.0005, "i": 0.6}.get(channel, 0.0) for channel, _ in inputs])
    layers: list[tuple[Array, Array]] = []
    width = len(inputs)
    for rows in hidden:
        weight = rng.uniform(-1.0, 1.0, (rows, width))
        weight *= 1.5 / np.sum(np.abs(weight), axis=1, keepdims=True)
        layers.append((weight, rng.uniform(-0.3, 0.3, rows)))
        width = rows
    last = rng.uniform(-1.0, 1.0, (1, width))
    if not layers:
        last[0, -3:] *= memory / np.sum(np.abs(last[0, -3:]))
    else:
        last *= memory / np.sum(np.abs(last)) / 1.5 ** len(hidden)
        past = [k for k, (channel, _) in enumerate(inputs) if channel == "F"]
        layers[0][0][:, [k for k in range(len(inputs)) if k not in past]] *= 3.0
    layers.append((last, rng.uniform(-0.05, 0.05, 1)))
    return Network(sample_time, inputs, offset, scale, 12.0, 300.0, tuple(layers))
