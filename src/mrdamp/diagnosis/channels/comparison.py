"""Comparison of channels that measure the same quantity; no law is needed.

The damper's force sensor is compared with the load cell to find sensor effects, the measured current with the
command to find driver effects. Both comparisons use the stages of the chain itself. The load cell's signal is
passed through the sensor stage behind a law whose force equals its displacement. The current is compared with
the chain's coil current.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from mrdamp.diagnosis.constants import (
    DIRECT_LEFT,
    DIRECT_RESOLUTION,
    INDEPENDENT,
    NUMBER,
    SAME_UNIT,
)
from mrdamp.diagnosis.hypotheses.outside import PLAIN
from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Settings, Term
from mrdamp.model import core
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.smoothing import noise_level

#: A law without force, and a spring of 1 N/m: the force equals the imposed displacement.
PASSES = {"c0a": 0.0, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.1, "gas_spring_k": 1.0}
#: Number of samples in a comparison, over all records; s at a record's start that are excluded.
_SAMPLES, _SKIP = 40_000, 0.2

#: Simulated second channel (n,) of a record for given settings.
Simulate = Callable[[Record, Settings], Array]


@dataclass(frozen=True)
class Compared:
    """Result of the comparison of two channels over all records.

    before, after: RMS difference over the RMS of the second channel, with the nominal settings and with the
    best effect. noise: the same ratio for white noise of both channels. cause: effect that explains the
    difference, perhaps one outside the catalogue, or None. nats: log evidence of the cause against no effect.
    settings: fitted settings of the cause. agree: the difference is within the noise. If two causes explain it
    together, each has its own entry with its settings beside the other one.
    """

    channels: tuple[str, str]
    before: float
    after: float
    noise: float
    cause: str | None = None
    term: Term | None = None
    settings: Settings | None = None
    nats: float = 0.0
    agree: bool = False

    @property
    def outside(self) -> bool:
        """True if the cause is not in the catalogue."""
        return self.cause in PLAIN

    @property
    def unexplained(self) -> bool:
        """True if the difference exceeds the noise and neither an effect nor other parameters explain it."""
        if self.outside:
            return True
        before, after = (max(x**2 - self.noise**2, 0.0) for x in (self.before, self.after))
        return self.cause is None and not self.agree and after > DIRECT_LEFT * before

    def to_dict(self) -> dict[str, Any]:
        """Entry of `diagnosis.json`."""
        return {
            "channels": list(self.channels),
            "difference": self.before,
            "left": self.after,
            "noise": self.noise,
            "effect": self.cause,
            "unexplained": self.unexplained,
            "parameters": {} if self.settings is None else dict(self.settings),
        }


def compared(records: Sequence[Record], terms: Sequence[Term], base: Settings) -> tuple[Compared, ...]:
    """Comparisons of every pair of channels that all records of a damper have; two entries for a pair whose
    difference two effects explain together. base: settings of the nominal simulator."""
    shared = set.intersection(*(set(r.channels) for r in records))
    out = []
    if {"force_N", "reference_force_N"} <= shared:
        sensor = {k: v for k, v in base.items() if k.startswith("sensor_")}

        def read(r: Record, settings: Settings) -> Array:
            return through_chain(np.asarray(r.channel("reference_force_N")), r.sample_time, sensor | settings)

        of_sensor = [t for t in terms if t.stage == "sensor" and t.effect.startswith("sensor_")]
        out += _explained(records, ("reference_force_N", "force_N"), of_sensor, read)
    if "current_A" in shared and _same_unit(records):
        driver = {k: v for k, v in base.items() if k.startswith(("driver_", "command_"))}

        def driven(r: Record, settings: Settings) -> Array:
            return through_chain(np.zeros(r.n), r.sample_time, driver | settings, np.asarray(r.command), "current")

        of_driver = [t for t in terms if t.stage == "driver"]
        out += _explained(records, ("command", "current_A"), of_driver, driven)
    return tuple(out)


def sensor_unexplained(found: Sequence[Compared]) -> bool:
    """True if the force sensor and the load cell differ and no effect of the sensor explains the difference."""
    return any(c.channels[1] == "force_N" and c.unexplained for c in found)


def _same_unit(records: Sequence[Record]) -> bool:
    command, current = (
        np.concatenate([r.channel(name) for r in records]) for name in ("command", "current_A")
    )
    size = float(np.sqrt(np.mean(command**2)))
    return size > 0 and SAME_UNIT[0] < float(np.sqrt(np.mean(current**2))) / size < SAME_UNIT[1]


def through_chain(
    reading: Array, sample_time: float, settings: Settings, command: Array | float = 0.0, column: str = "force"
) -> Array:
    """(n,) column of the chain for a reading (n,) that passes it without a damper, under a command."""
    still = np.zeros(len(reading))
    attributes = PASSES | settings
    return core.run("bingham", attributes, sample_time, reading, still, still, command, columns=(column,))[column]


def _explained(
    records: Sequence[Record], channels: tuple[str, str], terms: Sequence[Term], simulate: Simulate
) -> list[Compared]:
    _first, second = channels
    stride = max(1, round(sum(r.n for r in records) / _SAMPLES))
    kept = [slice(min(round(_SKIP / r.sample_time), r.n // 4), r.n, stride) for r in records]
    measured = [np.asarray(r.channel(second))[s] for r, s in zip(records, kept, strict=True)]
    size = float(np.sqrt(np.mean(np.concatenate(measured) ** 2))) or 1.0
    levels = [np.median([noise_level(np.asarray(r.channel(name))) for r in records]) for name in channels]
    noise = float(np.hypot(*levels)) / size

    def residual(settings: Settings) -> Array:
        parts = [simulate(r, settings)[s] - m for r, s, m in zip(records, kept, measured, strict=True)]
        return np.nan_to_num(np.concatenate(parts) / size, nan=1e3, posinf=1e3, neginf=-1e3)

    resolution = 1e-2 * DIRECT_RESOLUTION
    best = best_cause(channels, terms, residual, noise, level=noise, resolution=resolution)
    return (_pair(best, terms, residual, resolution) if best.unexplained else None) or [best]


def _pair(
    best: Compared, terms: Sequence[Term], residual: Callable[[Settings], Array], resolution: float
) -> list[Compared] | None:
    """The two effects, each in its simplest form, that explain a difference together; each with half of the
    evidence. None if no two leave less than DIRECT_LEFT of it. residual: difference over the RMS of the second channel.
    """
    simplest: dict[str, Term] = {}
    for term in sorted(terms, key=lambda t: (len(t.coordinates), t.name)):
        simplest.setdefault(term.effect, term)
    beyond, floor = best.before**2 - best.noise**2, (DIRECT_RESOLUTION * best.noise) ** 2 + resolution**2
    found: tuple[float, list[Compared]] = (DIRECT_LEFT * beyond, [])
    for one, other in combinations(simplest.values(), 2):
        together = Hypothesis((), (one, other))
        settings, after = _fitted(together, together.start(), residual)
        nats = _nats(together, best.before**2 + floor, after + floor)
        left = max(after - best.noise**2, 0.0)
        if left < found[0] and nats > 0:
            rows = []
            for term in (one, other):
                own = {**term.fixed, **{c.name: settings[c.name] for c in term.coordinates}}
                rows.append(
                    replace(best, after=float(np.sqrt(after)), cause=term.cause, term=term, settings=own, nats=nats / 2)
                )
            found = left, rows
    return found[1] or None


def best_cause(
    channels: tuple[str, str],
    terms: Sequence[Term],
    residual: Callable[[Settings], Array],
    noise: float,
    *,
    level: float = 1.0,
    resolution: float = 0.0,
) -> Compared:
    """The cause that explains the difference of two channels within the noise, if there is one.

    residual: difference (samples,) for given settings, in any unit. level: its noise in that unit. noise:
    relative to the RMS of the second channel. resolution: share of that channel below which no cause is
    reported.
    """
    unit = noise / level if level > 0 else 1.0  # ratio to the second channel's RMS
    before = float(np.mean(residual({}) ** 2)) * unit**2
    floor = (DIRECT_RESOLUTION * noise) ** 2 + resolution**2
    best = Compared(channels, float(np.sqrt(before)), float(np.sqrt(before)), noise)
    if before <= 2 * noise**2 + floor:
        return replace(best, agree=True)
    for term in sorted(terms, key=lambda t: len(t.coordinates)):
        if best.after**2 <= noise**2 + floor:
            break  # nothing is left for another effect
        hypothesis = Hypothesis((), (term,))
        for k in range(len(term.starts)):
            settings, mean_square = _fitted(hypothesis, hypothesis.start((k,)), residual)
            after = mean_square * unit**2
            nats = _nats(hypothesis, before + floor, after + floor)
            if max(after - noise**2, 0.0) < DIRECT_LEFT * (before - noise**2) and nats > best.nats:
                best = Compared(
                    channels, best.before, float(np.sqrt(after)), noise, term.cause, term, settings, nats
                )
    return best


def _fitted(
    hypothesis: Hypothesis, start: Array, residual: Callable[[Settings], Array]
) -> tuple[Settings, float]:
    """Settings of causes with the least mean square, from a start."""
    bounds = hypothesis.bounds()
    found = least_squares(
        lambda q: residual(hypothesis.settings(q)), np.clip(start, *bounds), bounds=bounds, diff_step=1e-3, max_nfev=15
    )
    return hypothesis.settings(found.x), float(2 * found.cost / len(found.fun))


def _nats(hypothesis: Hypothesis, before: float, after: float) -> float:
    """Log evidence of causes that take a mean square from `before` to `after`."""
    return 0.5 * INDEPENDENT * float(np.log(before / after)) - NUMBER * len(hypothesis.coordinates)
