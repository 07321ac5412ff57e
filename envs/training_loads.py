"""What policies are trained and validated under, and what controllers are tuned and judged under.

Nothing measured is in the first two: measured motions are for judging. No motion is for tuning and for judging.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.envs.loads import (
    AmbientLoads,
    Bumps,
    IsoRoads,
    LoadSource,
    MixedMotions,
    MotionSource,
    RecordedMotions,
    RoadSource,
    SyntheticMotions,
    WindLoads,
)
from mrdamp.errors import InputError
from mrdamp.files import SUFFIXES, files_in
from mrdamp.motions import TIME_SCALE, GroundMotion, embedded_motion, kanai_tajimi, read_motion
from mrdamp.simulation.roads import CLASSES, Road

#: The seed of whatever validation draws; training starts from the policy's own seed, a spawned sequence.
VALIDATION_SEED = 902
#: Of motions that are reported alone: no training draws them, and no checkpoint or setting is chosen on them.
REPORT_SEED = 9_000_301
AMPLITUDES = (0.1, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5)
#: rad/s, of full-size ground from soft to firm; each band has an equal share, so that motions slower than the frame are
#: not rare.
_GROUNDS = ((3.0, 8.0), (8.0, 16.0), (16.0, 40.0))
_PEAK = 2.5  # m/s2, of a validation motion at amplitude 1, that of the measured ones on average


@dataclass(frozen=True)
class Pulses:
    """Motions of a source, some with a velocity pulse as near a fault.

    The pulse is one of Gabor's, peak cos(2 pi (t - t0) / T + phase) exp(-2 ((t - t0) / T)^2), its period T drawn from
    `period` (s, full-size), its peak from `size` times the motion's; the sum keeps the motion's peak. share: of the
    motions that have one. compression: as the source's.
    """

    source: MotionSource
    share: float = 0.3
    period: tuple[float, float] = (0.3, 1.5)
    size: tuple[float, float] = (0.4, 1.2)
    compression: float = TIME_SCALE

    def draw(self, rng: np.random.Generator) -> GroundMotion:
        motion = self.source.draw(rng)
        if rng.random() >= self.share:
            return motion
        period = rng.uniform(*self.period) / self.compression
        middle = rng.uniform(0.1, 0.4) * motion.duration
        since = (motion.time - middle) / period
        wave = np.exp(-2 * since**2) * np.cos(2 * np.pi * (since + rng.random()))
        values = motion.acceleration + motion.pga * rng.uniform(*self.size) * wave
        return replace(motion, acceleration=values * motion.pga / np.abs(values).max(), name=f"{motion.name}_pulse")


def _kinds(duration: float, plateau: float, pga: tuple[float, float]) -> list[Pulses]:
    return [
        Pulses(
            SyntheticMotions(
                pga=pga, ground_frequency=ground, ground_damping=(0.2, 0.8), plateau=(1.0, plateau),
                rise=(1.0, 4.0), decay=(0.25, 1.0), duration=duration,
            )
        )
        for ground in _GROUNDS
    ]  # fmt: skip


def training_motions(pga: tuple[float, float] = (0.25, 6.0)) -> MotionSource:
    """Synthetic ground of every kind, short to long, and the embedded motion: peaks pga in m/s2, evenly in the log."""
    embedded = RecordedMotions(
        [embedded_motion()], compression=TIME_SCALE, amplitude=(0.1, 1.5), mirror=True, speed=(0.8, 1.25)
    )
    return MixedMotions([*_synthetic(pga), embedded], (0.3, 0.3, 0.3, 0.1))


def _synthetic(pga: tuple[float, float]) -> list[MotionSource]:
    lengths = ((10.0, 4.0), (20.0, 8.0), (30.0, 12.0))
    return [MixedMotions(_kinds(duration, plateau, pga)) for duration, plateau in lengths]


def validation_motions(count: int = 12, amplitudes: Sequence[float] = AMPLITUDES) -> list[GroundMotion]:
    """count motions at each amplitude, of the kinds that training draws from but drawn apart."""
    return _at_amplitudes(training_motions((1.0, 1.0)), VALIDATION_SEED, count, amplitudes)


def reported_motions(count: int = 12) -> list[GroundMotion]:
    """count synthetic motions at every one of AMPLITUDES, for tables: apart from training and validation."""
    return _at_amplitudes(MixedMotions(_synthetic((1.0, 1.0))), REPORT_SEED, count, AMPLITUDES)


def by_motion(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(seeds, motions, amplitudes) of values (seeds, loads) under `reported_motions`, for a comparison."""
    return values.reshape(len(values), -1, len(AMPLITUDES))


def _at_amplitudes(
    source: MotionSource, seed: int, count: int, amplitudes: Sequence[float]
) -> list[GroundMotion]:
    rng = np.random.default_rng([seed, 1])
    drawn = [source.draw(rng) for _ in range(count)]
    return [motion.scaled(a * _PEAK / motion.pga) for motion in drawn for a in amplitudes]


def some_motions(
    rng: np.random.Generator, count: int, duration: float = 20.0, spread: float = 0.0
) -> list[GroundMotion]:
    """count synthetic motions of `duration` s full-size, for searches that run every candidate under all of them:
    AMPLITUDES in turn on soft ground, then on the next. spread: durations are drawn up to this share longer or shorter.
    """

    def one(k: int) -> GroundMotion:
        lasts = duration * rng.uniform(1 - spread, 1 + spread) if spread else duration
        kinds = _kinds(lasts, 0.4 * lasts, (1.0, 1.0))
        return kinds[k // len(AMPLITUDES) % len(kinds)].draw(rng)

    drawn = [one(k) for k in range(count)]
    factors = np.resize(AMPLITUDES, count) * _PEAK
    return [motion.scaled(factor / motion.pga) for motion, factor in zip(drawn, factors, strict=True)]


@dataclass(frozen=True)
class _Lasting(ABC):
    """Loads of several sources, one of them for each episode. duration: s."""

    duration: float = 20.0

    @property
    @abstractmethod
    def sources(self) -> tuple[Any, ...]:
        """Of loads of the duration."""

    def some(self, rng: np.random.Generator, count: int, *about: Any, spread: float = 0.0) -> list[Any]:
        """count loads, of each source in turn; about: of `draw`; spread: as of `some_motions`."""
        found = []
        for k in range(count):
            lasts = self.duration * float(rng.uniform(1.0 - spread, 1.0 + spread)) if spread else self.duration
            sources = replace(self, duration=lasts).sources
            found.append(sources[k % len(sources)].draw(rng, *about))
        return found

    def draw(self, rng: np.random.Generator, *about: Any) -> Any:
        """about: what a load is drawn for, as the length of a cable, m."""
        return self.sources[int(rng.integers(len(self.sources)))].draw(rng, *about)


@dataclass(frozen=True)
class CableLoads(_Lasting):
    """Wind and ambient loads."""

    @property
    def sources(self) -> tuple[LoadSource, ...]:
        d = self.duration
        return WindLoads(duration=d), AmbientLoads(duration=d), AmbientLoads(shape="uniform", duration=d)


@dataclass(frozen=True)
class TrainingRoads(_Lasting):
    """Roads of ISO 8608 of each class, and bumps, which have a duration of their own."""

    duration: float = 10.0

    @property
    def sources(self) -> tuple[RoadSource, ...]:
        return (*(IsoRoads((c,), (8.0, 32.0), self.duration) for c in CLASSES), Bumps())


def validation_roads(count: int = 40) -> list[Road]:
    """count roads, drawn apart from those of training."""
    return TrainingRoads().some(np.random.default_rng([VALIDATION_SEED, 3]), count)


PEAK = 3.4  # m/s2, of every synthetic motion at amplitude 1
UNSEEN_AMPLITUDES = (0.4, 1.0, 1.6)
#: Of a recorded motion: the mean over the peak at most, and the peak, m/s2. The largest on record is about 40.
_MEAN, _LARGEST = 0.5, 50.0


@dataclass(frozen=True)
class Soil:
    """Clough-Penzien ground: frequency, rad/s, and damping ratio; the second filter is a tenth of the frequency."""

    name: str
    frequency: float
    damping: float


SOILS = (Soil("firm", 15.6, 0.6), Soil("medium", 10.0, 0.4), Soil("soft", 5.0, 0.3))
#: Seeds from nine million on are for judging alone; the embedded motion is one that policies are trained on.
_UNSEEN = ((9_000_001, 0), (9_000_002, 1), (9_000_003, 1), (9_000_004, 2), (9_000_005, 0), (9_000_006, 0))
_TUNING = ((101, 0), (102, 1), (103, 2))


def unseen_motions() -> tuple[GroundMotion, ...]:
    """Six motions on three soils, peak 3.4 m/s2, at full size's speed."""
    return tuple(synthetic(seed, SOILS[k]) for seed, k in _UNSEEN)


def tuning_motions() -> tuple[GroundMotion, ...]:
    """Three motions, one a soil, with seeds that no unseen motion has."""
    return tuple(synthetic(seed, SOILS[k]) for seed, k in _TUNING)


def synthetic(seed: int, soil: Soil) -> GroundMotion:
    """25 s of filtered noise on a soil, peak 3.4 m/s2 (`mrdamp.motions.kanai_tajimi`)."""
    motion = kanai_tajimi(
        seed, pga=PEAK, ground_frequency=soil.frequency, ground_damping=soil.damping,
        filter_frequency=0.1 * soil.frequency,
    )  # fmt: skip
    return replace(motion, name=f"{soil.name}_{seed}")


def read_motions(paths: Sequence[Path | str]) -> tuple[GroundMotion, ...]:
    """Motions of files, or of every .csv, .csv.gz and .AT2 in a folder; names are made different.

    Raises InputError where there is none, or one of zeros.
    """
    motions: list[GroundMotion] = []
    for file in (f for path in paths for f in files_in(Path(path), (*SUFFIXES, ".at2"))):
        motion = read_motion(file)
        if not motion.acceleration.any():
            raise InputError(f"{file}: the motion is zero throughout; there is nothing to control")
        taken = sum(m.name.split("#")[0] == motion.name for m in motions)
        motions.append(replace(motion, name=f"{motion.name}#{taken + 1}") if taken else motion)
    return tuple(motions)


def doubtful(motion: GroundMotion) -> list[str]:
    """What is likely a mistake of a recorded motion: a line each."""
    mean, peak = float(np.mean(motion.acceleration)), motion.pga
    found = []
    if abs(mean) > _MEAN * peak:
        found.append(f"{motion.name}: its mean is {mean:.3g} m/s2, its peak {peak:.3g}; take an offset out")
    if peak > _LARGEST:
        found.append(f"{motion.name}: its peak is {peak:.3g} m/s2; usual are up to {_LARGEST:g}: motions are in m/s2")
    return found
