"""Channels that see the same thing, compared with each other: no law is needed for that.

The damper's own force sensor against the load cell tells of the sensor's effects, the measured current against the
command of the driver's. Both go through the chain's own stages: a law that passes its displacement on as its force
takes the load cell's reading through the force sensor, and the chain's coil current is compared with the measured one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from mrdamp.diagnosis.channels.smoothing import noise_level
from mrdamp.diagnosis.constants import (
    CHANNELS_AGREE,
    DIRECT_LEFT,
    DIRECT_RESOLUTION,
    INDEPENDENT,
    NUMBER_PRICE,
    PARTS_LEFT,
    SAME_UNIT,
)
from mrdamp.diagnosis.hypotheses.terms import Settings, Term
from mrdamp.model import core
from mrdamp.model.core import Array
from mrdamp.records import Record

#: A law without any force of its own, and a spring of 1 N/m: what goes in as a displacement comes out as the force.
PASSES = {"c0a": 0.0, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.1, "gas_spring_k": 1.0}
#: Samples that a comparison looks at, of all records together; s at a record's start that do not count.
_SAMPLES, _SKIP = 40_000, 0.2

#: Simulated second channel (n,) of a record under settings.
Simulate = Callable[[Record, Settings], Array]


@dataclass(frozen=True)
class Compared:
    """Two channels of all records.

    before, after: RMS difference over the RMS of the second channel, with the nominal simulator's own settings and with
    the best effect; noise: what white noise of both channels makes of it. cause: the effect that makes one channel the
    other, None where none does. nats: log evidence of it against no effect. settings: as it was fitted.
    """

    channels: tuple[str, str]
    before: float
    after: float
    noise: float
    cause: str | None = None
    term: Term | None = None
    settings: Settings | None = None
    nats: float = 0.0

    @property
    def unexplained(self) -> bool:
        """True where the two differ beyond their noise and neither an effect nor other numbers explain it."""
        before, after = (max(x**2 - self.noise**2, 0.0) for x in (self.before, self.after))
        return self.cause is None and before > self.noise**2 and after > PARTS_LEFT * before

    def to_dict(self) -> dict[str, Any]:
        """For `diagnosis.json`."""
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
    """Every pair of channels that all records of a damper have. base: the nominal simulator's settings."""
    shared = set.intersection(*(set(r.channels) for r in records))
    out = []
    if {"force_N", "reference_force_N"} <= shared:
        own = {k: v for k, v in base.items() if k.startswith("sensor_")}
        of_sensor = [t for t in terms if t.stage == "sensor" and t.effect.startswith("sensor_")]
        out.append(_best(records, ("reference_force_N", "force_N"), of_sensor, _through_sensor(own)))
    if "current_A" in shared and _same_unit(records):
        own = {k: v for k, v in base.items() if k.startswith(("driver_", "command_"))}
        of_driver = [t for t in terms if t.stage == "driver"]
        out.append(_best(records, ("command", "current_A"), of_driver, _through_driver(own)))
    return tuple(out)


def sensor_agrees(found: Sequence[Compared]) -> bool:
    """True where the force sensor reads what the load cell does, but for noise."""
    return any(
        c.channels[1] == "force_N" and c.before <= CHANNELS_AGREE * np.hypot(c.noise, 1e-2 * DIRECT_RESOLUTION)
        for c in found
    )


def sensor_unexplained(found: Sequence[Compared]) -> bool:
    """True where the force sensor and the load cell differ by what no effect of the sensor explains."""
    return any(c.channels[1] == "force_N" and c.cause is None for c in found) and not sensor_agrees(found)


def _same_unit(records: Sequence[Record]) -> bool:
    command, current = (
        np.concatenate([r.channel(name) for r in records]) for name in ("command", "current_A")
    )
    size = float(np.sqrt(np.mean(command**2)))
    return size > 0 and SAME_UNIT[0] < float(np.sqrt(np.mean(current**2))) / size < SAME_UNIT[1]


def _through_sensor(own: Settings) -> Simulate:
    def simulate(record: Record, settings: Settings) -> Array:
        reading = np.asarray(record.channel("reference_force_N"))
        vector = core.vector("bingham", PASSES | own | settings)
        still = np.zeros(record.n)
        run = core.run_many("bingham", vector, record.sample_time, reading, still, v=still, a=still)
        return np.asarray(run[0, 0])

    return simulate


def _through_driver(own: Settings) -> Simulate:
    def simulate(record: Record, settings: Settings) -> Array:
        vector = core.vector("bingham", PASSES | own | settings)
        still = np.zeros(record.n)
        command = np.asarray(record.channel("command"))
        run = core.run_many(
            "bingham", vector, record.sample_time, still, command, v=still, a=still, columns=("current",)
        )
        return np.asarray(run[0, 0])

    return simulate


def _best(
    records: Sequence[Record], channels: tuple[str, str], terms: Sequence[Term], simulate: Simulate
) -> Compared:
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

    return best_cause(channels, terms, residual, noise, level=noise, resolution=1e-2 * DIRECT_RESOLUTION)


def best_cause(
    channels: tuple[str, str],
    terms: Sequence[Term],
    residual: Callable[[Settings], Array],
    noise: float,
    *,
    level: float = 1.0,
    resolution: float = 0.0,
    left: float = DIRECT_LEFT,
) -> Compared:
    """The cause that makes one channel the other but for noise, if one does.

    residual: difference (samples,) under settings, in any unit; level: of its noise in that unit; noise: over the RMS
    of the second channel; resolution: share of that channel below which nothing is told; left: of the
    difference's square beyond the noise, the share that a cause may leave.
    """
    unit = noise / level if level > 0 else 1.0  # shares of the second channel
    before = float(np.mean(residual({}) ** 2)) * unit**2
    floor = (DIRECT_RESOLUTION * noise) ** 2 + resolution**2
    best = Compared(channels, float(np.sqrt(before)), float(np.sqrt(before)), noise)
    if before <= 2 * noise**2 + floor:
        return best  # the two agree
    for term in sorted(terms, key=lambda t: len(t.coordinates)):
        if best.after**2 <= noise**2 + floor:
            break  # nothing is left for another effect
        for start in term.starts:
            settings, mean_square = _fitted(term, start, residual)
            after = mean_square * unit**2
            nats = 0.5 * INDEPENDENT * float(np.log((before + floor) / (after + floor)))
            nats -= NUMBER_PRICE * len(term.coordinates)
            if max(after - noise**2, 0.0) < left * (before - noise**2) and nats > best.nats:
                best = Compared(
                    channels, best.before, float(np.sqrt(after)), noise, term.cause, term, settings, nats
                )
    return best


def _fitted(
    term: Term, start: Sequence[float], residual: Callable[[Settings], Array]
) -> tuple[Settings, float]:
    """The term's settings with the least mean square, from one of its starts."""
    coordinates = term.coordinates

    def settings(q: Array) -> Settings:
        own = {c.name: c.value(float(v)) for c, v in zip(coordinates, q, strict=True)}
        return {**term.fixed, **own}

    ends = np.array([sorted(c.bounds) for c in coordinates])
    q0 = np.clip([c.point(v) for c, v in zip(coordinates, start, strict=True)], ends[:, 0], ends[:, 1])
    found = least_squares(
        lambda q: residual(settings(q)), q0, bounds=(ends[:, 0], ends[:, 1]), diff_step=1e-3, max_nfev=15
    )
    return settings(found.x), float(2 * found.cost / len(found.fun))
