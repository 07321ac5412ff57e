"""Tests that a rig can run: sines or a triangle as the motion, and a command, within its limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from mrdamp.model.core import Array

#: s, length of a test.
SECONDS = 6.0
#: Share of the limits that a test uses.
_USED = 0.9
_SINES = 4  # at most
_FADE = 0.5  # s, in which the motion is faded in
#: s, shortest and longest time that a command stays or takes (with shorter times, a delay is ambiguous by a
#: period); Hz, of a triangle.
_HOLD, _TRIANGLE = (0.25, 2.5), (0.1, 0.6)
_COMMANDS = ("constant", "steps", "levels", "ramp", "sines")


@dataclass(frozen=True)
class Envelope:
    """Limits of the rig, from the records.

    channel: the input, `displacement_m` of a damper or `ground_acceleration_m_s2` of a frame. largest: of its
    values. rate: of its slope (1/s), None without a limit. lowest, highest: Hz. sample_time: s.
    """

    channel: str
    largest: float
    rate: float | None
    lowest: float
    highest: float
    command_low: float
    command_high: float
    sample_time: float


@dataclass(frozen=True)
class Signal:
    """A test's inputs (n,): the motion in the unit of the envelope's channel, and the command."""

    motion: Array
    command: Array


@dataclass(frozen=True)
class Design:
    """Parameters of a test.

    hz, weight, phase: of the sines; a single hz with `triangle`: of a triangle. command: constant, steps
    (between two levels), levels (drawn from `seed`), ramp (up and down between two levels) or sines. low,
    high: levels as shares of the command's range. hold: s, duration of a level or ramp, or a sine's period.
    """

    hz: tuple[float, ...]
    weight: tuple[float, ...]
    phase: tuple[float, ...]
    triangle: bool
    command: str
    low: float
    high: float
    hold: float
    seed: int

    def signal(self, e: Envelope) -> Signal:
        """The inputs, scaled to the rig's limits."""
        t = np.asarray(e.sample_time * np.arange(round(SECONDS / e.sample_time)), dtype=np.float64)
        rows = zip(self.hz, self.weight, self.phase, strict=True)
        waves = [w * np.sin(2 * np.pi * f * t + p) for f, w, p in rows]
        motion = (
            (2 / np.pi) * np.arcsin(waves[0] / self.weight[0]) if self.triangle else np.sum(waves, axis=0)
        )
        motion = motion * np.sin(np.pi / 2 * np.clip(t / _FADE, 0, 1)) ** 2
        if e.rate is None:
            motion = brought_to_rest(motion, e.sample_time)
        scale = e.largest / float(np.abs(motion).max())
        if e.rate is not None:
            scale = min(scale, e.rate / float(np.abs(np.gradient(motion, e.sample_time)).max()))
        share = np.clip(self._share(t), 0.0, 1.0)
        command = e.command_low + (e.command_high - e.command_low) * share
        return Signal(np.asarray(_USED * scale * motion), np.asarray(command))

    def _share(self, t: Array) -> Array:
        low, high = self.low, self.high
        if self.command == "constant":
            return np.full(len(t), high)
        if self.command == "steps":
            return np.where(np.floor(t / self.hold) % 2 < 1, low, high)
        if self.command == "ramp":
            return np.asarray(low + (high - low) * (1 - np.abs((t / self.hold) % 2 - 1)))
        rng = np.random.default_rng(self.seed)
        if self.command == "levels":
            levels = rng.uniform(low, high, int(t[-1] / self.hold) + 1)
            return np.asarray(levels[(t / self.hold).astype(int)])
        f, p = rng.uniform(0.5, 1.5, 3) / self.hold, rng.uniform(0, 2 * np.pi, 3)
        wave = np.mean([np.sin(2 * np.pi * a * t + b) for a, b in zip(f, p, strict=True)], axis=0)
        return np.asarray((low + high) / 2 + (high - low) * wave)

    def text(self, e: Envelope) -> str:
        """Description of the test."""
        kind = "triangle" if self.triangle else "sine" if len(self.hz) == 1 else "sines together"
        what = f"{kind} of {', '.join(f'{f:.2g}' for f in sorted(self.hz))} Hz"
        low, high = (e.command_low + s * (e.command_high - e.command_low) for s in (self.low, self.high))
        return (
            what
            + {
                "constant": f", command {high:.3g}",
                "steps": f", command stepped between {low:.3g} and {high:.3g} every {self.hold:.2g} s",
                "levels": f", command at a new level from {low:.3g} to {high:.3g} every {self.hold:.2g} s",
                "ramp": f", command ramped between {low:.3g} and {high:.3g} in {self.hold:.2g} s",
                "sines": f", command waving between {low:.3g} and {high:.3g} in about {self.hold:.2g} s",
            }[self.command]
        )


def brought_to_rest(acceleration: Array, dt: float) -> Array:
    """An acceleration (n,) that fades out, and after which a table stands still where it began. dt: s."""
    t = dt * np.arange(len(acceleration))
    fade = np.sin(np.pi / 2 * np.clip((t[-1] - t) / _FADE, 0, 1)) ** 2
    slow = np.sin(np.pi * t / t[-1]) ** 2
    parts = np.array([acceleration * fade, slow, slow * (t / t[-1] - 0.5)])
    speed = cumulative_trapezoid(parts, dx=dt, initial=0)
    ends = np.array([speed[:, -1], cumulative_trapezoid(speed, dx=dt)[:, -1]])
    return np.asarray(parts[0] - np.linalg.solve(ends[:, 1:], ends[:, 0]) @ parts[1:])


def drawn(rng: np.random.Generator, e: Envelope) -> Design:
    """A random test: one to four sines or a triangle, any kind of command."""
    triangle = e.rate is not None and rng.random() < 0.15
    count = 1 if triangle else int(rng.integers(1, _SINES + 1))
    ends = _TRIANGLE if triangle else (e.lowest, e.highest)
    hz = np.exp(rng.uniform(np.log(ends[0]), np.log(ends[1]), count))
    weight = (1.0 / hz if e.rate is not None else np.ones(count)) * rng.uniform(0.5, 1.5, count)
    low, high = np.sort(rng.uniform(0, 1, 2)) if rng.random() < 0.5 else (0.0, 1.0)
    return Design(
        tuple(hz.tolist()),
        tuple(weight.tolist()),
        tuple(rng.uniform(0, 2 * np.pi, count).tolist()),
        triangle,
        str(rng.choice(_COMMANDS)),
        float(low),
        float(high),
        float(np.exp(rng.uniform(np.log(_HOLD[0]), np.log(_HOLD[1])))),
        int(rng.integers(2**31)),
    )


def neighbour(rng: np.random.Generator, one: Design, other: Design, e: Envelope) -> Design:
    """A test near another: its motion or its command from a second test, then changed frequencies, levels and
    times."""
    pick = rng.random()
    if pick < 0.3:
        one = replace(one, hz=other.hz, weight=other.weight, phase=other.phase, triangle=other.triangle)
    elif pick < 0.6:
        one = replace(
            one, command=other.command, low=other.low, high=other.high, hold=other.hold, seed=other.seed
        )
    ends = _TRIANGLE if one.triangle else (e.lowest, e.highest)
    hz = np.clip(np.array(one.hz) * np.exp(0.25 * rng.standard_normal(len(one.hz))), *ends)
    weight = np.array(one.weight) * np.exp(0.3 * rng.standard_normal(len(one.hz)))
    levels = np.sort(np.clip([one.low, one.high] + 0.15 * rng.standard_normal(2), 0.0, 1.0))
    hold = float(np.clip(one.hold * np.exp(0.4 * rng.standard_normal()), *_HOLD))
    low, high = levels.tolist()
    return replace(one, hz=tuple(hz.tolist()), weight=tuple(weight.tolist()), low=low, high=high, hold=hold)


def columns(signal: Signal, e: Envelope) -> Mapping[str, Array]:
    """Columns of the signal's CSV file, with the contract's names."""
    t = np.asarray(e.sample_time * np.arange(len(signal.motion)), dtype=np.float64)
    return {"time_s": t, e.channel: signal.motion, "command": signal.command}
