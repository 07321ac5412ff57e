"""Motions and commands with exact derivatives, for references and for the records made of them.

Displacement in m, time in s, command in the unit of the damper (A or V).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

Array = npt.NDArray[np.float64]
Function = Callable[[float], float]


@dataclass(frozen=True)
class Motion:
    """Prescribed displacement with its exact velocity (m/s) and acceleration (m/s2)."""

    x: Function
    v: Function
    a: Function

    def sample(self, t: Array) -> tuple[Array, Array, Array]:
        """``x, v, a`` at the times ``t``, each (n,)."""
        x, v, a = (np.array([f(float(time)) for time in t]) for f in (self.x, self.v, self.a))
        return x, v, a

    def turns(self, end: float) -> list[float]:
        """Times in (0, end) at which the velocity changes sign."""
        grid = np.linspace(0.0, end, int(end * 2000) + 2)
        v = [self.v(float(t)) for t in grid]
        found = []
        for k in range(len(grid) - 1):
            if v[k] * v[k + 1] < 0.0:
                found.append(float(brentq(self.v, grid[k], grid[k + 1], xtol=1e-14)))
            elif v[k] == 0.0 and k > 0 and v[k - 1] * v[k + 1] < 0.0:
                found.append(float(grid[k]))
        return found

    def shifted(self, d: float) -> Motion:
        """Seen ``d`` seconds later in the record; before its start it moves at the velocity that it begins with."""
        x0, v0 = self.x(0.0), self.v(0.0)

        def moved(f: Function, before: Function) -> Function:
            return lambda t: f(t + d) if t + d >= 0.0 else before(t + d)

        return Motion(
            moved(self.x, lambda t: x0 + v0 * t), moved(self.v, lambda t: v0), moved(self.a, lambda t: 0.0)
        )


def sine(amplitude: float, frequency: float, *, phase: float = 0.0, offset: float = 0.0) -> Motion:
    """``offset + amplitude sin(2 pi frequency t + phase)``; it starts at full speed for ``phase = 0``."""
    w = 2.0 * math.pi * frequency
    return Motion(
        lambda t: offset + amplitude * math.sin(w * t + phase),
        lambda t: amplitude * w * math.cos(w * t + phase),
        lambda t: -amplitude * w * w * math.sin(w * t + phase),
    )


def triangle(amplitude: float, frequency: float, *, sharpness: float = 0.99) -> Motion:
    """Triangle with round corners: ``2 amplitude / pi asin(sharpness sin(w t))``, nearly constant speed."""
    w, s, scale = 2.0 * math.pi * frequency, sharpness, 2.0 * amplitude / math.pi

    def root(t: float) -> float:
        return math.sqrt(1.0 - (s * math.sin(w * t)) ** 2)

    return Motion(
        lambda t: scale * math.asin(s * math.sin(w * t)),
        lambda t: scale * s * w * math.cos(w * t) / root(t),
        lambda t: -scale * s * w * w * math.sin(w * t) * (1.0 - s * s) / root(t) ** 3,
    )


def multisine(rms: float, low: float, high: float, *, seed: int, terms: int = 12) -> Motion:
    """Random band-limited motion: sines at random frequencies in ``low .. high`` Hz, random phases. Amplitudes fall
    as 1/f, so that the velocity is spread evenly over the band; the motion starts at x = 0."""
    rng = np.random.default_rng(seed)
    edges = np.linspace(low, high, terms + 1)
    f = rng.uniform(edges[:-1], edges[1:])
    share = 1.0 / f
    amplitude = rms * math.sqrt(2.0) * share / np.linalg.norm(share)
    parts = [
        (float(a), 2.0 * math.pi * float(k), float(p))
        for a, k, p in zip(amplitude, f, rng.uniform(0.0, 2.0 * math.pi, terms), strict=True)
    ]
    start = sum(a * math.sin(p) for a, _, p in parts)
    sin, cos = math.sin, math.cos
    return Motion(
        lambda t: sum([a * sin(w * t + p) for a, w, p in parts]) - start,
        lambda t: sum([a * w * cos(w * t + p) for a, w, p in parts]),
        lambda t: -sum([a * w * w * sin(w * t + p) for a, w, p in parts]),
    )


@dataclass(frozen=True)
class Command:
    """Command in pieces: ``pieces[k]`` and its slope hold on ``(breaks[k-1], breaks[k]]``. ``held``: constant pieces,
    so that a record of it is read with the command held between the samples."""

    breaks: tuple[float, ...]
    pieces: tuple[Function, ...]
    slopes: tuple[Function, ...]
    held: bool

    def piece(self, t: float) -> int:
        """Index of the piece at ``t``; at a break the one that ends there."""
        return int(np.searchsorted(np.array(self.breaks), t - 1e-12))

    def sample(self, t: Array) -> Array:
        """What a record holds at its samples (n,): at a break the piece that begins there."""
        index = np.searchsorted(np.array(self.breaks), t + 1e-12)
        return np.array([self.pieces[k](float(time)) for k, time in zip(index, t, strict=True)])


def constant(level: float) -> Command:
    return Command((), (lambda t: level,), (lambda t: 0.0,), held=True)


def wave(low: float, high: float, frequency: float) -> Command:
    """Slow sine between two levels, starting in the middle."""
    middle, half, w = (low + high) / 2.0, (high - low) / 2.0, 2.0 * math.pi * frequency
    return Command(
        (),
        (lambda t: middle + half * math.sin(w * t),),
        (lambda t: half * w * math.cos(w * t),),
        held=False,
    )


def steps(levels: Sequence[float], every: float) -> Command:
    """Levels one after the other, each held for ``every`` seconds."""

    def hold(level: float) -> Function:
        return lambda t: level

    breaks = tuple(every * (k + 1) for k in range(len(levels) - 1))
    return Command(breaks, tuple(hold(c) for c in levels), tuple(hold(0.0) for _ in levels), held=True)


def random_steps(low: float, high: float, every: float, count: int, *, seed: int) -> Command:
    """Random levels in ``low .. high``."""
    return steps([float(c) for c in np.random.default_rng(seed).uniform(low, high, count)], every)
