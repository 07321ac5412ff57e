"""The next test: a signal within the rig's limits that would part what these records leave tied or unseen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from mrdamp.core import Array
from mrdamp.diagnosis.fit import Fit
from mrdamp.diagnosis.terms import Hypothesis, Settings, Term

_SECONDS = 8.0
_SEED = 11


@dataclass(frozen=True)
class Envelope:
    """Limits of the rig, as the records span them: stroke amplitude (m), velocity (m/s), command range, step (s)."""

    stroke: float
    velocity: float
    command_low: float
    command_high: float
    sample_time: float


@dataclass(frozen=True)
class Signal:
    """A test: what it is, and its inputs (n,): displacement (m) and command."""

    what: str
    displacement: Array
    command: Array


class Bench(Protocol):
    """A rig on which a signal can be tried: simulated channels (sets, channels, n)."""

    def try_signal(self, settings: Sequence[Settings], signal: Signal) -> Array: ...


def signals(e: Envelope) -> tuple[Signal, ...]:
    """A library of tests within the limits: sines, a slow triangle, a sweep, steps of the command, random ones."""
    t = e.sample_time * np.arange(round(_SECONDS / e.sample_time))
    middle = 0.5 * (e.command_low + e.command_high)
    rng = np.random.default_rng(_SEED)
    out = []

    def sine(hz: float, share: float) -> Array:
        amplitude = min(share * e.stroke, e.velocity / (2 * np.pi * hz))
        return np.asarray(amplitude * np.sin(2 * np.pi * hz * t))

    steps = np.where(np.floor(t / 0.4) % 2 < 1, e.command_low, e.command_high)
    for hz in (0.5, 2.0, 5.0, 10.0):
        out.append(Signal(f"sine of {hz:g} Hz at the middle command", sine(hz, 0.9), np.full(len(t), middle)))
        out.append(Signal(f"sine of {hz:g} Hz, command stepped every 0.4 s", sine(hz, 0.9), steps))
    slow = e.stroke * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * 0.25 * t))
    for name, value in (("smallest", e.command_low), ("largest", e.command_high)):
        out.append(
            Signal(f"slow triangle of 0.25 Hz at the {name} command", 0.9 * slow, np.full(len(t), value))
        )
    ramp = e.command_low + (e.command_high - e.command_low) * np.abs((t / 2) % 2 - 1)
    out.append(Signal("sine of 2 Hz, command ramped up and down in 4 s", sine(2.0, 0.9), ramp))
    phase = 2 * np.pi * (0.5 * t + 0.5 * (14.5 / _SECONDS) * t**2)
    rate = 0.5 + 14.5 * t / _SECONDS
    amplitude = np.minimum(0.9 * e.stroke, e.velocity / (2 * np.pi * rate))
    chirp = amplitude * np.sin(phase)
    out.append(Signal("sweep from 0.5 to 15 Hz at the middle command", chirp, np.full(len(t), middle)))
    freqs = np.linspace(0.3, 6.0, 24)
    phases = rng.uniform(0, 2 * np.pi, len(freqs))
    x = np.sum([np.sin(2 * np.pi * f * t + p) / f for f, p in zip(freqs, phases, strict=True)], axis=0)
    x *= min(0.9 * e.stroke / np.abs(x).max(), e.velocity / np.abs(np.gradient(x, e.sample_time)).max())
    walk = np.cumsum(rng.standard_normal(len(t))) * np.sqrt(e.sample_time / 0.1)
    u = np.clip(middle + 0.3 * (e.command_high - e.command_low) * walk, e.command_low, e.command_high)
    out.append(Signal("random motion of 0.3 to 6 Hz with a random command", x, u))
    return tuple(out)


def separation(bench: Bench, signal: Signal, one: Settings, other: Settings, noise: Array) -> float:
    """RMS difference of what two simulators answer, over the channels' noise (channels,)."""
    runs = bench.try_signal([one, other], signal)
    skip = runs.shape[2] // 20
    difference = (runs[0] - runs[1])[:, skip:]
    return float(np.sqrt(np.mean((difference / np.maximum(noise, 1e-12)[:, None]) ** 2)))


def propose(
    bench: Bench, envelope: Envelope, one: Settings, other: Settings, noise: Array, why: str
) -> tuple[dict[str, Any], Signal]:
    """The signal of the library with the largest separation, and its description for the report."""
    ranked = sorted(
        ((separation(bench, s, one, other, noise), k, s) for k, s in enumerate(signals(envelope))),
        key=lambda item: (-item[0], item[1]),
    )
    value, _, best = ranked[0]
    return {"why": why, "signal": best.what, "separation": value, "file": "next_experiment.csv"}, best


def rival(chosen: Fit, fits: Sequence[Fit]) -> Fit | None:
    """The cheapest fit whose causes are neither a part nor an extension of the chosen one's."""
    own = set(chosen.hypothesis.causes)
    for found in fits:
        causes = set(found.hypothesis.causes)
        if not (causes <= own or own <= causes):
            return found
    return None


def with_term(found: Fit, term: Term, by: float) -> Settings:
    """Settings of a fit with a term at so many times its first start (numbers searched by logarithm stay there)."""
    pairs = list(zip(term.coordinates, term.starts[0], strict=True))
    values = [v if c.log else c.start + by * (v - c.start) for c, v in pairs]
    q = np.array([c.point(v) for (c, _), v in zip(pairs, values, strict=True)])
    return found.settings | Hypothesis((), (term,)).settings(q)


def columns(signal: Signal, sample_time: float) -> Mapping[str, Array]:
    """The signal's CSV."""
    t = np.asarray(sample_time * np.arange(len(signal.displacement)), dtype=np.float64)
    return {"time_s": t, "displacement_m": signal.displacement, "command": signal.command}
