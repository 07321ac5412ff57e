"""Sources of an episode's ground motion: filtered noise or files, over a range of amplitudes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np

from mrdamp.errors import InputError, require_kind, require_one_of
from mrdamp.motions import TIME_SCALE, GroundMotion, kanai_tajimi, read_motion

Range = tuple[float, float]


@runtime_checkable
class MotionSource(Protocol):
    """Draws the ground motion of an episode."""

    def draw(self, rng: np.random.Generator) -> GroundMotion:
        """A motion, already scaled and compressed in time; the same generator state gives the same one."""


@dataclass(frozen=True)
class SyntheticMotions:
    """Filtered white noise under an envelope (`mrdamp.motions.kanai_tajimi`), with soil and strength drawn.

    Ranges are (low, high); the peak is drawn evenly in its logarithm, the others evenly. pga: m/s2. spectrum:
    `clough-penzien`, or `kanai-tajimi` without the second filter. ground_frequency: rad/s, of the full-size ground;
    ground_damping; duration: s, rise, plateau: s, decay: 1/s, all before compression. compression: factor by which
    the motion is compressed in time (5 for the frame of Dyke et al. 1996, 1 for a full-size one).
    """

    pga: Range = (0.5, 8.0)
    spectrum: Literal["clough-penzien", "kanai-tajimi"] = "clough-penzien"
    ground_frequency: Range = (7.0, 25.0)
    ground_damping: Range = (0.3, 0.8)
    rise: Range = (1.0, 4.0)
    plateau: Range = (3.0, 10.0)
    decay: Range = (0.25, 0.8)
    duration: float = 25.0
    compression: float = TIME_SCALE

    def __post_init__(self) -> None:
        names = ("pga", "ground_frequency", "ground_damping", "rise", "plateau", "decay")
        check_ranges("synthetic motions", {name: getattr(self, name) for name in names})
        require_one_of("synthetic motions", ("clough-penzien", "kanai-tajimi"), spectrum=self.spectrum)

    def draw(self, rng: np.random.Generator) -> GroundMotion:
        seed = int(rng.integers(2**31))
        ground = rng.uniform(*self.ground_frequency)
        pga, damping = uniform(rng, self.pga), rng.uniform(*self.ground_damping)
        rise, plateau, decay = (rng.uniform(*span) for span in (self.rise, self.plateau, self.decay))
        # The second filter a decade below the first; far below anything that moves, it is no filter.
        second = 0.1 * ground if self.spectrum == "clough-penzien" else 1e-3
        motion = kanai_tajimi(
            seed, duration=self.duration, sample_time=0.01, pga=pga, ground_frequency=ground, ground_damping=damping,
            filter_frequency=second, rise=rise, plateau=plateau, decay=decay,
        )  # fmt: skip
        return motion.compressed(self.compression)


@dataclass(frozen=True, eq=False)
class RecordedMotions:
    """Measured ground motions, one drawn for each episode, over a range of amplitudes.

    motions: files (CSV or PEER .AT2, see `mrdamp.motions.read_motion`) or motions. amplitude: range of the factor
    on each one, or of the peak in m/s2 where `to_peak`; drawn evenly in its logarithm. speed: range of a further
    factor on the speed, evenly drawn, which shifts the motion's frequencies. mirror: change the sign of every second
    one on average. compression: as in `played`.
    """

    motions: Sequence[GroundMotion | Path | str]
    amplitude: Range = (1.0, 1.0)
    to_peak: bool = False
    speed: Range = (1.0, 1.0)
    mirror: bool = False
    compression: float | None = None
    _read: tuple[GroundMotion, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_ranges("recorded motions", {"amplitude": self.amplitude, "speed": self.speed})
        require_kind("a list of files or motions", (list, tuple), motions=self.motions)
        read = tuple(played(m, self.compression) for m in self.motions)
        if not read:
            raise InputError("recorded motions: there is none; give at least one file")
        object.__setattr__(self, "_read", read)

    def draw(self, rng: np.random.Generator) -> GroundMotion:
        motion = self._read[int(rng.integers(len(self._read)))]
        factor = uniform(rng, self.amplitude) / (motion.pga if self.to_peak else 1.0)
        sign = -1.0 if self.mirror and rng.random() < 0.5 else 1.0
        return motion.scaled(sign * factor).compressed(rng.uniform(*self.speed))


@dataclass(frozen=True)
class MixedMotions:
    """Several sources, one drawn for each episode; weights: how often, evenly by default."""

    sources: Sequence[MotionSource]
    weights: Sequence[float] = ()

    def __post_init__(self) -> None:
        if not self.sources or len(self.weights) not in (0, len(self.sources)):
            raise InputError(f"mixed motions: {len(self.sources)} sources, {len(self.weights)} weights")
        if self.weights and not (min(self.weights) >= 0 and sum(self.weights) > 0):
            raise InputError(f"mixed motions: weights are {self.weights}; allowed: >= 0, one of them > 0")

    def draw(self, rng: np.random.Generator) -> GroundMotion:
        share = np.array(self.weights or [1.0] * len(self.sources))
        return self.sources[int(rng.choice(len(self.sources), p=share / share.sum()))].draw(rng)


def drawn(source: Any, rng: np.random.Generator) -> Any:
    """A load of a source of one's own. Raises InputError where it lacks what a load has."""
    load, needed = source.draw(rng), ("name", "duration", "sample_time", "scaled")
    missing = [name for name in needed if not hasattr(load, name)]
    if missing:
        own = type(source).__name__
        raise InputError(f"{own}: draw gives a {type(load).__name__} without {missing[0]}; allowed: a load with "
                         f"{', '.join(needed)}")
    return load


def played(given: GroundMotion | Path | str, compression: float | None = None) -> GroundMotion:
    """A motion on the frame's clock: a file's is played `TIME_SCALE` times as fast, a motion as it is.

    compression: in place of that; 1 for a frame of full size. The one rule for environments, `mrdamp compare` and
    training; `speed` of the motion says what was done. Raises InputError.
    """
    require_kind("a GroundMotion, or its file", (GroundMotion, str, Path), motion=given)
    if isinstance(given, GroundMotion):
        return given if compression is None else given.compressed(compression)
    return read_motion(given).compressed(TIME_SCALE if compression is None else compression)


def cut(motion: GroundMotion, duration: float | None) -> GroundMotion:
    """The motion's first `duration` seconds (of its own clock, after compression), or all of it."""
    if duration is None or motion.duration <= duration:
        return motion
    return replace(motion, acceleration=motion.acceleration[: max(3, round(duration / motion.sample_time) + 1)])


def uniform(rng: np.random.Generator, span: Range) -> float:
    """A number from the range, drawn evenly in its logarithm."""
    return math.exp(rng.uniform(math.log(span[0]), math.log(span[1])))


def check_ranges(what: str, ranges: dict[str, Range]) -> None:
    """InputError unless every range is (low, high), 0 < low <= high."""
    for name, span in ranges.items():
        if len(span) != 2 or not 0 < span[0] <= span[1] < math.inf:
            raise InputError(f"{what}: {name} is {span}; allowed: (low, high) with 0 < low <= high")
