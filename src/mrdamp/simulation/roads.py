"""Roads under a wheel at a speed: of the classes of ISO 8608, bumps, and measured ones from files."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import irfft, next_fast_len
from scipy.interpolate import CubicSpline

from mrdamp.errors import InputError, require_one_of, require_positive
from mrdamp.files import decode, read_bytes
from mrdamp.model.core import Array
from mrdamp.records import csv_file

#: Displacement spectral density at 0.1 cycles/m, m3: geometric means of the classes, ISO 8608:2016, table C.1.
CLASSES = {"A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6}
#: Cycles/m: the reference, and the band of that table.
_N0, _LOW, _HIGH = 0.1, 0.011, 2.83
#: m between heights: seventeen of them in the shortest wave.
SPACING = 0.02
_LINES = 4  # lowest frequency of the band over the distance of the lines, at least
_COLUMNS = ("position_m", "height_m")


@dataclass(frozen=True, eq=False)
class Road:
    """Heights under the wheel. name; spacing: m; height: (n,) m, a cubic spline in between; speed: m/s.

    The spline keeps the wheel's vertical velocity without jumps, which no time step would resolve. The road starts at
    height 0: what it starts at is taken off. Raises InputError.
    """

    name: str
    spacing: float
    height: Array
    speed: float

    def __post_init__(self) -> None:
        height = np.array(self.height, dtype=np.float64)
        require_positive(self.name, spacing=self.spacing, speed=self.speed)
        if height.ndim != 1 or len(height) < 3 or not np.isfinite(height).all():
            raise InputError(f"{self.name}: heights have shape {height.shape}; allowed: finite (n,), n >= 3")
        height = height - height[0]
        height.setflags(write=False)
        object.__setattr__(self, "height", height)

    def at_speed(self, speed: float) -> Road:
        """The same road at another speed, m/s, which its name says."""
        said = f"_{3.6 * speed:.0f}_km_h"
        name, found = re.subn(r"_\d+_km_h", said, self.name)
        return replace(self, name=name if found else self.name + said, speed=speed)

    @property
    def duration(self) -> float:
        """From the first to the last height, s."""
        return (len(self.height) - 1) * self.spacing / self.speed

    def at(self, time: ArrayLike) -> Array:
        """(...) m under the wheel at times (...) s; the last height continues after the end."""
        place = self.speed * np.asarray(time, dtype=np.float64) / self.spacing
        return np.asarray(self._spline(np.clip(place, 0, len(self.height) - 1)))

    @cached_property
    def _spline(self) -> CubicSpline:
        return CubicSpline(np.arange(len(self.height)), self.height, bc_type="natural")

    def scaled(self, factor: float) -> Road:
        """Heights times a factor. Raises InputError."""
        if not 0 < factor < math.inf:
            raise InputError(f"{self.name}: amplitude is {factor}; allowed: > 0")
        return self if factor == 1 else replace(self, height=factor * self.height)


def iso8608(road_class: str, speed: float, duration: float, seed: int, lead: float = 0.5) -> Road:
    """A random road with the spectrum of a class A to D, G(n) = G(0.1) (n / 0.1)^-2 from 0.011 to 2.83 cycles/m.

    A stretch of a sum of waves with random phases whose lines hold the whole of that band, however short the road is:
    over many roads heights have its variance, 0.01 G(0.1) (1 / 0.011 - 1 / 2.83) m2. speed: m/s; duration and lead,
    over which it rises from flat ground: s. Raises InputError.
    """
    require_one_of("", CLASSES, **{"road class": road_class})
    if not 0 < speed < math.inf or not 0 < duration < 1e5 or not 0 <= lead < duration:
        raise InputError(
            f"road: speed {speed}, duration {duration}, lead {lead}; allowed: > 0, > 0, 0 to the duration"
        )
    count = max(math.ceil(speed * duration / SPACING) + 1, 16)
    whole = next_fast_len(max(count, math.ceil(_LINES / (_LOW * SPACING))), real=True)
    step = 1 / (whole * SPACING)
    n = step * np.arange(1, whole // 2 + 1)
    # The part of the band that each line stands for: n^-2 integrated.
    low, high = np.clip(n - 0.5 * step, _LOW, _HIGH), np.clip(n + 0.5 * step, _LOW, _HIGH)
    variance = CLASSES[road_class] * _N0**2 * (1 / low - 1 / high)
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(n))
    lines = np.append(0.0, 0.5 * whole * np.sqrt(2 * variance) * np.exp(1j * phase))
    height = irfft(lines, whole)[:count]
    place = SPACING * np.arange(count)
    if lead > 0:
        height = height * 0.5 * (1 - np.cos(np.pi * np.minimum(place / (speed * lead), 1.0)))
    return Road(f"{road_class}_{3.6 * speed:.0f}_km_h_{seed}", SPACING, height, speed)


def bump(height: float, length: float, speed: float, duration: float = 4.0, lead: float = 0.5) -> Road:
    """One bump, 0.5 height (1 - cos(2 pi x / length)) on flat ground, `lead` seconds ahead of the wheel.

    height: m, below 0 a hollow; length: m; speed: m/s; duration: s. Raises InputError.
    """
    if not (
        0 < abs(height) < math.inf and 0 < length < math.inf and 0 < speed < math.inf and 0 <= lead < duration
    ):
        raise InputError(f"bump: height {height}, length {length}, speed {speed}; allowed: not 0, > 0, > 0")
    spacing = min(SPACING, length / 50)
    place = spacing * np.arange(max(math.ceil(speed * duration / spacing) + 1, 16)) - speed * lead
    shape = np.where(
        (place > 0) & (place < length), 0.5 * height * (1 - np.cos(2 * np.pi * place / length)), 0.0
    )
    return Road(f"bump_{1e3 * height:g}_mm_{length:g}_m_{3.6 * speed:.0f}_km_h", spacing, shape, speed)


def read_road(path: Path | str, speed: float) -> Road:
    """A road file, CSV with the columns position_m (rising) and height_m, driven at a speed (m/s). Raises
    InputError."""
    path = Path(path)
    lines = decode(path.name, read_bytes(path)).rstrip().split("\n")
    header = [name.strip() for name in lines[0].split(",")]
    missing = [name for name in _COLUMNS if name not in header]
    if missing:
        raise InputError(f"{path}: missing column {missing[0]}; a road has the columns {', '.join(_COLUMNS)}")
    place, height = csv_file.numbers(
        path.name, header, lines[1:], [header.index(name) for name in _COLUMNS]
    ).T
    if len(place) < 3 or not (np.diff(place) > 0).all():
        raise InputError(
            f"{path}: {len(place)} positions; allowed: three or more, and each above the one before"
        )
    spacing = float(min(np.diff(place).min(), (place[-1] - place[0]) / 3))
    spacing = max(spacing, (place[-1] - place[0]) / 1e6)
    even = np.arange(place[0], place[-1] + 0.5 * spacing, spacing)
    return Road(path.stem, spacing, np.interp(even, place, height), speed)
