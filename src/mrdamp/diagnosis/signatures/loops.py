"""Signatures of force-displacement loops: what an engineer sees without a law, in records and simulations alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mrdamp.model.core import Array
from mrdamp.records.motion import stroke_since_reversal

#: A turn counts once the motion has come back by this share of its range; a stroke counts from this share of it on.
_BACK, _FULL = 0.02, 0.5
#: A force is small below this share of its plateau. A measured clearance rattles by a tenth of it; with a fifth its
#: travel is the same to 3 per cent in nine of ten tests from .25 to 1 Hz.
_SMALL = 0.2


@dataclass(frozen=True)
class Strokes:
    """Full strokes (half cycles from turn to turn) of records; not a record's first and last piece, which begin or end
    between turns.

    samples (m,): numbers of the strokes' samples in the concatenated records; first (strokes,): where each stroke
    begins in them. x (m,): motion (m). record (strokes,): number of the record; rising (strokes,): True if x increases.
    """

    records: int
    samples: NDArray[np.intp]
    first: NDArray[np.intp]
    x: Array
    record: NDArray[np.intp]
    rising: NDArray[np.bool_]

    @property
    def lengths(self) -> NDArray[np.intp]:
        """Number of samples of each stroke (strokes,)."""
        return np.diff([*self.first, len(self.samples)])

    @classmethod
    def of(cls, motions: Sequence[Array]) -> Strokes:
        """Strokes of motions (n,) m."""
        at = np.cumsum([0, *(len(x) for x in motions)])
        found = [(number, low, high) for number, x in enumerate(motions) for low, high in _strokes(x)]
        parts = [motions[number][low:high] for number, low, high in found]
        samples = [at[number] + np.arange(low, high) for number, low, high in found]
        return cls(
            len(motions),
            np.concatenate([np.zeros(0, np.intp), *samples]),
            np.cumsum([0, *(len(x) for x in parts)], dtype=np.intp)[:-1],
            np.concatenate([np.zeros(0), *parts]),
            np.array([number for number, *_ in found], dtype=np.intp),
            np.array([x[-1] > x[0] for x in parts], dtype=bool),
        )

    def levels(self, f: Array) -> tuple[Array, Array]:
        """Median force (N) of rising and of falling strokes of each record (records,), NaN where it has none. f (n,):
        force in the concatenated records."""
        force, of = f[self.samples], np.repeat(self.record, self.lengths)
        rising = np.repeat(self.rising, self.lengths)
        out = np.full((2, self.records), np.nan)
        for number in set(self.record):
            for row, some in zip(out, (rising, ~rising), strict=True):
                own = force[(of == number) & some]
                if own.size:
                    row[number] = np.median(own)
        return out[0], out[1]

    def stalls(self, f: Array) -> Array:
        """Travel (strokes,) m after a turn while the force is small: a clearance, or trapped gas. NaN if the record has
        strokes of one direction only. f as in `levels`."""
        if not len(self.first):
            return np.zeros(0)
        up, down = self.levels(f)
        middle = (0.5 * (up + down))[self.record]
        size = np.where(self.rising, 0.5, -0.5) * (up - down)[self.record]
        with np.errstate(divide="ignore", invalid="ignore"):  # a constant force is nowhere small
            ahead = (f[self.samples] - np.repeat(middle, self.lengths)) / np.repeat(size, self.lengths)
        travel = np.abs(self.x - np.repeat(self.x[self.first], self.lengths))
        begun, ended = (
            np.minimum.reduceat(np.where(ahead > level, travel, np.inf), self.first) for level in (-_SMALL, _SMALL)
        )
        return np.where(np.isnan(middle), np.nan, np.minimum(ended, self.sizes) - np.minimum(begun, self.sizes))

    @property
    def sizes(self) -> Array:
        """Length (strokes,) m of each stroke."""
        return np.asarray(np.maximum.reduceat(self.x, self.first) - np.minimum.reduceat(self.x, self.first))

    def by_record(self, values: Array) -> list[Array]:
        """Finite values (strokes,) of each record that has any."""
        kept = np.isfinite(values)
        return [values[kept & (self.record == k)] for k in np.unique(self.record[kept])]


def _strokes(x: Array) -> list[tuple[int, int]]:
    """First sample and end of each full stroke of a motion (n,)."""
    since = stroke_since_reversal(x, _BACK * float(np.ptp(x)))
    begun = x - since  # the turn that each sample's stroke began at
    edges = np.flatnonzero(np.abs(np.diff(begun)) > 1e-12 * max(float(np.ptp(x)), 1e-30)) + 1
    turns = [_turn(x, low, high) for low, high in pairwise([0, *edges])]
    full = _FULL * float(np.ptp(x))
    return [(low, high + 1) for low, high in pairwise(turns) if high > low + 3 and abs(x[high] - x[low]) >= full]


def _turn(x: Array, low: int, high: int) -> int:
    """Sample of the turn that ends the stroke between two detections."""
    part = x[low:high]
    rising = part[-1] > part[0] or np.argmax(part) > np.argmin(part)
    return low + int(np.argmax(part) if rising else np.argmin(part))


@dataclass(frozen=True)
class Signature:
    """A signature of the measured force, and of the nominal and the corrected simulator's: medians over records."""

    name: str
    unit: str
    measured: float
    nominal: float
    corrected: float


def compared(motions: Sequence[Array], forces: Mapping[str, Sequence[Array]]) -> tuple[Signature, ...]:
    """Signatures of records. motions: (n,) m each; forces: `measured`, `nominal`, `corrected`, (n,) N each."""
    strokes = Strokes.of(motions)
    rows: dict[tuple[str, str], dict[str, float]] = {}
    for kind, some in forces.items():
        f = np.concatenate(some)
        up, down = strokes.levels(f)
        travels = np.array([np.median(t) for t in strokes.by_record(1e3 * strokes.stalls(f))])
        for name, values in (
            (("travel at small force after a turn", "mm"), travels),
            (("middle between both directions", "N"), 0.5 * (up + down)),
            (("median force of a stroke", "N"), 0.5 * (up - down)),
        ):
            finite = values[np.isfinite(values)]
            if finite.size:
                rows.setdefault(name, {})[kind] = float(np.median(finite))
    kinds = ("measured", "nominal", "corrected")
    return tuple(Signature(*name, *(row[k] for k in kinds)) for name, row in rows.items() if len(row) == len(kinds))
