"""A small damper-like recursion whose form is a network's own, as series for training tests."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from excitation import Array
from mrdamp.narx.data import Series
from mrdamp.narx.network import Network


def motion(n: int, dt: float, seed: int) -> tuple[Array, Array, Array]:
    """Random smooth x (m), its exact v (m/s) and a varying command."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * dt
    x, v, i = np.zeros(n), np.zeros(n), np.full(n, 0.8)
    for _ in range(8):
        w, phase = 2 * np.pi * rng.uniform(0.5, 6.0), rng.uniform(0, 2 * np.pi)
        x += 1e-3 * np.sin(w * t + phase)
        v += 1e-3 * w * np.cos(w * t + phase)
        i += 0.08 * np.sin(2 * np.pi * rng.uniform(0.2, 4.0) * t + rng.uniform(0, 2 * np.pi))
    return x, v, i


def recursion(x: Array, v: Array, i: Array, dt: float) -> Array:
    """Force (N) of a yielding element behind a first-order lag, plus viscous and elastic parts; from rest."""
    force, z = np.zeros(len(x)), 0.0
    for k in range(len(x)):
        z += dt / 0.012 * (np.tanh(v[k] / 0.02) * (100.0 + 700.0 * i[k]) - z)
        force[k] = z + 800.0 * v[k] + 2e4 * x[k]
    return force


def made(n: int, seed: int, *, noise: float = 2.0, dt: float = 2e-3, name: str = "") -> Series:
    """A series of that damper with white noise (N) on the force."""
    x, v, i = motion(n, dt, seed)
    rng = np.random.default_rng(1000 + seed)
    force = recursion(x, v, i, dt) + noise * rng.standard_normal(n)
    return Series(name or f"made_{seed}", dt, x, v, i, force)


def small(hidden: tuple[int, ...], seed: int = 0, lags: dict[str, tuple[int, ...]] | None = None) -> Network:
    """A network with random weights and the scaling of these motions."""
    lags = lags or {"x": (0, 2), "v": (0, 1), "i": (1,), "F": (1, 3)}
    inputs = tuple((channel, lag) for channel, values in lags.items() for lag in values)
    rng = np.random.default_rng(seed)
    size = {"x": 0.006, "v": 0.1, "i": 0.5, "F": 900.0}
    widths = [len(inputs), *hidden, 1]
    m = sum(b * (a + 1) for a, b in pairwise(widths))
    return Network(
        2e-3, inputs, np.array([{"i": 0.8}.get(c, 0.0) for c, _ in inputs]),
        np.array([1 / size[c] for c, _ in inputs]), 10.0, 850.0, hidden, rng.normal(0, 0.6, m),
    )  # fmt: skip
