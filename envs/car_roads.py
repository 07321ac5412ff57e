"""Sources of an episode's road: classes of ISO 8608, bumps, or files, over ranges of speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from mrdamp.envs.loads import Range, check_ranges
from mrdamp.errors import InputError
from mrdamp.simulation.roads import CLASSES, Road, bump, iso8608, read_road


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
