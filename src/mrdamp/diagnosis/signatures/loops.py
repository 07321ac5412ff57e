"""Signatures of force-displacement loops: what an engineer sees without a law, in records and simulations alike.

Each takes a motion x (n,) in m and a force f (n,) in N, and returns NaN where the motion has no two full strokes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mrdamp.model.core import Array
from mrdamp.records.motion import stroke_since_reversal

#: A turn counts once the motion has come back by this share of its range; a stroke counts from this share of it on.
_BACK, _FULL = 0.02, 0.5
#: Half width of the middle of a stroke, as a share of it.
_MIDDLE = 0.1
#: A force is small below this share of the plateau.
_SMALL = 0.1


@dataclass(frozen=True)
class Stroke:
    """A half cycle: motion and force (n,) from turn to turn."""

    x: Array
    f: Array

    @property
    def middle(self) -> float:
        """Mean force (N) in the middle of the stroke."""
        half = 0.5 * (self.x.min() + self.x.max())
        near = np.abs(self.x - half) <= _MIDDLE * float(np.ptp(self.x))
        return float(np.mean(self.f[near]))


def strokes(x: Array, f: Array) -> Iterator[Stroke]:
    """The full strokes of a record; not its first and last piece, which begin or end between turns."""
    since = stroke_since_reversal(x, _BACK * float(np.ptp(x)))
    starts = x - since  # the turn that each sample's stroke began at
    edges = np.flatnonzero(np.abs(np.diff(starts)) > 1e-12 * max(float(np.ptp(x)), 1e-30)) + 1
    turns = [_turn(x, low, high) for low, high in pairwise([0, *edges])]
    for low, high in pairwise(turns):
        if high > low + 3 and abs(x[high] - x[low]) >= _FULL * float(np.ptp(x)):
            yield Stroke(x[low : high + 1], f[low : high + 1])


def _turn(x: Array, low: int, high: int) -> int:
    """Sample of the turn that ends the stroke between two detections."""
    part = x[low:high]
    rising = part[-1] > part[0] or np.argmax(part) > np.argmin(part)
    return low + int(np.argmax(part) if rising else np.argmin(part))


def midline(x: Array, f: Array) -> float:
    """Mean of the mid-stroke forces of both directions (N): a preload, or the bias of a sensor."""
    levels = _levels(x, f)
    return float("nan") if levels is None else 0.5 * (levels[0] + levels[1])


def plateau(x: Array, f: Array) -> float:
    """Half the difference of the mid-stroke forces of both directions (N)."""
    levels = _levels(x, f)
    return float("nan") if levels is None else 0.5 * (levels[0] - levels[1])


def stall(x: Array, f: Array) -> float:
    """Travel after a turn (m) for which the force stays below a tenth of its plateau, median over the strokes: a
    clearance, or trapped gas."""
    levels = _levels(x, f)
    if levels is None:
        return float("nan")
    middle, size = 0.5 * (levels[0] + levels[1]), 0.5 * abs(levels[0] - levels[1])
    travels = []
    for s in strokes(x, f):
        small = np.abs(s.f - middle) < _SMALL * size
        # The force crosses the middle line on its way from one side to the other.
        travels.append(float(np.ptp(s.x[small])) if small.any() else 0.0)
    return float(np.median(travels))


def _levels(x: Array, f: Array) -> tuple[float, float] | None:
    """Mid-stroke force (N) of rising and of falling strokes, means over the strokes."""
    found = list(strokes(x, f))
    up = [s.middle for s in found if s.x[-1] > s.x[0]]
    down = [s.middle for s in found if s.x[-1] < s.x[0]]
    return (float(np.mean(up)), float(np.mean(down))) if up and down else None


@dataclass(frozen=True)
class Signature:
    """A signature of the measured force, and of the nominal and the corrected simulator's: medians over records."""

    name: str
    unit: str
    measured: float
    nominal: float
    corrected: float


#: Name, unit, factor to it, and function of the signatures that are told.
SHOWN: tuple[tuple[str, str, float, Callable[[Array, Array], float]], ...] = (
    ("travel at small force after a turn", "mm", 1e3, stall),
    ("middle between both directions", "N", 1.0, midline),
    ("mid-stroke force", "N", 1.0, plateau),
)


def compared(motions: Sequence[Array], forces: Mapping[str, Sequence[Array]]) -> tuple[Signature, ...]:
    """Signatures of records. motions: (n,) m each; forces: `measured`, `nominal`, `corrected`, (n,) N each."""
    out = []
    for name, unit, factor, of in SHOWN:
        values = {}
        for kind, some in forces.items():
            each = np.array([of(x, f) for x, f in zip(motions, some, strict=True)])
            values[kind] = factor * float(np.nanmedian(each)) if np.isfinite(each).any() else float("nan")
        if all(np.isfinite(v) for v in values.values()):
            out.append(Signature(name, unit, values["measured"], values["nominal"], values["corrected"]))
    return tuple(out)
