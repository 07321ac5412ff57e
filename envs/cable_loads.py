"""Loads of a stay cable: ambient noise and the buffeting of turbulent wind."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from scipy import signal

from mrdamp.envs.loads import Range, check_ranges, uniform
from mrdamp.errors import InputError, require_one_of, require_positive
from mrdamp.model.core import Array

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
