"""Sources of an episode's load: ground motions, ambient and wind loads of a cable, roads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
from scipy import signal

from mrdamp.errors import InputError, require_kind, require_one_of, require_positive
from mrdamp.model.core import Array
from mrdamp.motions import TIME_SCALE, GroundMotion, kanai_tajimi, read_motion
from mrdamp.simulation.roads import CLASSES, Road, bump, iso8608, read_road

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
    return whole(source.draw(rng), f"{type(source).__name__}: draw gives")


def whole(load: Any, said: str) -> Any:
    """A load of one's own. Raises InputError where it lacks what a load has."""
    needed = ("name", "duration", "sample_time", "scaled")
    missing = [name for name in needed if not hasattr(load, name)]
    if missing:
        allowed = f"a load with {', '.join(needed)}"
        raise InputError(f"{said} a {type(load).__name__} without {missing[0]}; allowed: {allowed}")
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


AIR = 1.25  # kg/m3
_SLOW = 12  # lines below 1 / duration
_WITHIN = 8  # points of a line's cell


@dataclass(frozen=True, eq=False)
class CableLoad:
    """Force per length across a cable.

    name; sample_time: s; places: (p,) x / L, rising; force: (n, p) N/m, straight between places and between samples.
    Raises InputError.
    """

    name: str
    sample_time: float
    places: Array
    force: Array

    def __post_init__(self) -> None:
        places = np.array(self.places, dtype=np.float64)
        force = np.array(self.force, dtype=np.float64)
        if not 0 < self.sample_time < math.inf:
            raise InputError(f"{self.name}: sample time is {self.sample_time}; allowed: > 0 s")
        rising = places.ndim == 1 and len(places) > 0 and (np.diff(places) > 0).all()
        if not (rising and places[0] >= 0 and places[-1] <= 1):
            raise InputError(f"{self.name}: places must rise from 0 to 1 at most")
        if force.ndim != 2 or force.shape[1] != len(places) or len(force) < 3 or not np.isfinite(force).all():
            raise InputError(
                f"{self.name}: force has shape {force.shape}; allowed: finite (n, {len(places)}), n >= 3"
            )
        for name, values in (("places", places), ("force", force)):
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    @property
    def duration(self) -> float:
        """From the first to the last sample, s."""
        return (len(self.force) - 1) * self.sample_time

    @property
    def rms(self) -> float:
        """N/m, over time and places."""
        return float(np.sqrt(np.mean(self.force**2)))

    def scaled(self, factor: float) -> CableLoad:
        """Every force times `factor`."""
        return CableLoad(self.name, self.sample_time, self.places, self.force * factor)


@runtime_checkable
class LoadSource(Protocol):
    """Draws the load of an episode."""

    def draw(self, rng: np.random.Generator, length: float) -> CableLoad:
        """A load on a cable of `length` m; the same generator state gives the same one."""


@dataclass(frozen=True)
class AmbientLoads:
    """White noise below a frequency: ambient load of a bridge by traffic and wind.

    rms: range of the force, N/m, drawn evenly in its logarithm. shape: `uniform`, the same all along the cable, or
    `independent` at 11 places. bandwidth: Hz, of a fourth-order Butterworth low-pass. duration: s.
    """

    rms: Range = (0.3, 3.0)
    shape: str = "independent"
    bandwidth: float = 15.0
    duration: float = 20.0

    def __post_init__(self) -> None:
        check_ranges("ambient loads", {"rms": self.rms})
        _check_length("ambient loads", self.duration)
        require_one_of("ambient loads", ("uniform", "independent"), shape=self.shape)
        if not 0 < self.bandwidth < math.inf:
            raise InputError(f"ambient loads: bandwidth is {self.bandwidth}; allowed: > 0 Hz")

    def draw(self, rng: np.random.Generator, length: float) -> CableLoad:
        step = 1 / (8 * self.bandwidth)
        places = np.array([0.5]) if self.shape == "uniform" else np.linspace(0.0, 1.0, 11)
        rms = uniform(rng, self.rms)
        noise = rng.standard_normal((math.ceil(self.duration / step) + 1, len(places)))
        filtered = signal.sosfilt(signal.butter(4, self.bandwidth, fs=1 / step, output="sos"), noise, axis=0)
        # The filter lets a quarter of the noise through: its bandwidth over half the sampling rate.
        return CableLoad("ambient", step, places, np.asarray(filtered) * 2 * rms)


@dataclass(frozen=True)
class WindLoads:
    """Buffeting of turbulent wind, by spectral representation.

    The fluctuation u of the wind along the cable has von Karman's spectrum and Davenport's coherence,

        n S(n) / s^2 = 4 f / (1 + 70.8 f^2)^(5/6), f = n L_u / U;    coherence^(1/2) = exp(-C n dx / U),

    and the drag's fluctuation is rho Cd D U u per length. u has the deviation s over many loads, less what is above the
    bandwidth; in a short one most of it is a steady part. Sources: von Karman, Proc. Natl. Acad. Sci. 34 (1948)
    530-539, doi 10.1073/pnas.34.11.530; Davenport, Q. J. R. Meteorol. Soc. 87 (1961) 194-211, doi
    10.1002/qj.49708737208; Shinozuka and Deodatis, Appl. Mech. Rev. 44 (1991) 191-204, doi 10.1115/1.3119501.

    speed: range of the mean U, m/s. intensity: range of s / U. diameter: D, m. drag: Cd. length_scale: L_u, m.
    decay: C. places: how many along the cable. duration: s. bandwidth: Hz, the highest frequency.
    """

    speed: Range = (6.0, 25.0)
    intensity: Range = (0.1, 0.25)
    diameter: float = 0.03
    drag: float = 1.2
    length_scale: float = 50.0
    decay: float = 10.0
    places: int = 11
    duration: float = 20.0
    bandwidth: float = 15.0

    def __post_init__(self) -> None:
        check_ranges("wind loads", {"speed": self.speed, "intensity": self.intensity})
        _check_length("wind loads", self.duration)
        sizes = ("diameter", "drag", "length_scale", "bandwidth")
        require_positive("wind loads", **{name: getattr(self, name) for name in sizes})
        if self.decay < 0 or self.places < 1:
            raise InputError(
                f"wind loads: decay {self.decay}, {self.places} places; allowed: >= 0, 1 or more"
            )

    def draw(self, rng: np.random.Generator, length: float) -> CableLoad:
        speed, intensity = rng.uniform(*self.speed), rng.uniform(*self.intensity)
        step = 1 / (4 * self.bandwidth)
        count = math.ceil(self.duration / step) + 1
        rate = 1 / (count * step)
        # Lines of an FFT, and slow ones below its first, down to where the spectrum is flat; each stands for a cell.
        edges = np.append(0.0, np.geomspace(min(0.01 * speed / self.length_scale, 0.05 * rate), 0.5 * rate, _SLOW))
        edges = np.append(edges, rate * (np.arange(1, math.ceil(self.bandwidth / rate)) + 0.5))
        width = np.diff(edges)
        inside = edges[:-1, None] + width[:, None] * (np.arange(_WITHIN) + 0.5) / _WITHIN
        slow = edges[:_SLOW] + 0.5 * width[:_SLOW]
        n = np.append(slow, rate * np.arange(1, len(width) - _SLOW + 1))
        scaled = inside * self.length_scale / speed
        deviation = 4 * (speed * intensity) ** 2 * self.length_scale / speed
        spectrum = np.mean(deviation / (1 + 70.8 * scaled**2) ** (5 / 6), axis=1)
        places = np.linspace(0.0, 1.0, self.places) if self.places > 1 else np.array([0.5])
        apart = length * np.abs(places[:, None] - places[None, :])
        coherence = np.exp(-self.decay * n[:, None, None] * apart / speed)
        # Regularisation: at low frequencies all places are fully coherent, and the matrix is singular.
        root = np.linalg.cholesky(coherence + 1e-9 * np.eye(len(places)))
        noise = rng.standard_normal((2, len(n), len(places)))
        amplitude = np.sqrt(spectrum * width)[:, None] * (noise[0] + 1j * noise[1])
        waves = (root @ amplitude[:, :, None])[:, :, 0]
        lines = np.zeros((count // 2 + 1, len(places)), dtype=np.complex128)
        lines[1 : len(n) - _SLOW + 1] = 0.5 * count * waves[_SLOW:]
        turns = np.exp(2j * np.pi * step * np.outer(np.arange(count), slow))
        wind = np.fft.irfft(lines, count, axis=0) + (turns @ waves[:_SLOW]).real
        force = AIR * self.drag * self.diameter * speed * wind
        return CableLoad(f"wind_{speed:.1f}_m_s", step, places, force)


def _check_length(what: str, duration: float) -> None:
    if not 0 < duration < 1e5:
        raise InputError(f"{what}: duration is {duration}; allowed: above 0 to 1e5 s")


@runtime_checkable
class RoadSource(Protocol):
    """Draws the road of an episode."""

    def draw(self, rng: np.random.Generator) -> Road:
        """A road with its speed; the same generator state gives the same one."""


@dataclass(frozen=True)
class IsoRoads:
    """Roads of ISO 8608. classes: each as likely; speed: range, m/s, drawn evenly; duration: s."""

    classes: Sequence[str] = tuple(CLASSES)
    speed: Range = (10.0, 30.0)
    duration: float = 10.0

    def __post_init__(self) -> None:
        unknown = [c for c in self.classes if c not in CLASSES]
        if unknown or not self.classes:
            raise InputError(
                f"roads: class {unknown[0] if unknown else None!r}; allowed: {', '.join(CLASSES)}"
            )
        check_ranges("roads", {"speed": self.speed})
        if not 1 <= self.duration < 1e4:
            raise InputError(f"roads: duration is {self.duration}; allowed: 1 s or more")

    def draw(self, rng: np.random.Generator) -> Road:
        chosen = self.classes[int(rng.integers(len(self.classes)))]
        return iso8608(chosen, rng.uniform(*self.speed), self.duration, int(rng.integers(2**31)))


@dataclass(frozen=True)
class Bumps:
    """Single bumps. height, length: ranges, m; speed: range, m/s; each drawn evenly. duration: s."""

    height: Range = (0.03, 0.1)
    length: Range = (0.5, 5.0)
    speed: Range = (3.0, 15.0)
    duration: float = 4.0

    def __post_init__(self) -> None:
        check_ranges("bumps", {"height": self.height, "length": self.length, "speed": self.speed})

    def draw(self, rng: np.random.Generator) -> Road:
        return bump(
            rng.uniform(*self.height), rng.uniform(*self.length), rng.uniform(*self.speed), self.duration
        )


@dataclass(frozen=True, eq=False)
class RecordedRoads:
    """Measured roads (`read_road`), one drawn for each episode. speed: range, m/s; amplitude: range of a factor."""

    files: Sequence[Path | str]
    speed: Range = (10.0, 30.0)
    amplitude: Range = (1.0, 1.0)
    _read: tuple[Road, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_ranges("recorded roads", {"speed": self.speed, "amplitude": self.amplitude})
        if not self.files:
            raise InputError("recorded roads: there is none; give at least one file")
        object.__setattr__(self, "_read", tuple(read_road(file, self.speed[0]) for file in self.files))

    def draw(self, rng: np.random.Generator) -> Road:
        road = self._read[int(rng.integers(len(self._read)))]
        return replace(road, speed=rng.uniform(*self.speed)).scaled(rng.uniform(*self.amplitude))
