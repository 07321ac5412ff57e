"""Residuals of a rig's records for many settings at once, normalised by record and channel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Settings
from mrdamp.diagnosis.problem.rig import Rig, simulated_together
from mrdamp.errors import InputError
from mrdamp.model.core import Array

#: s, excluded at the start of a record: the unknown initial state decays. At most a quarter of the record.
_SKIP = 0.1
#: Samples excluded at the end of a record, where a converter's filter distorts the motion.
_END = 8
#: Number of residual samples of a rig, over all channels and records: in a search, and for what is told. Every eighth
#: sample of a frame at 1 kHz gives a gap after jumps of the command of 19.4 % for 17.6.
_SAMPLES, _WHOLE = 20_000, 200_000
#: Step of the finite differences, in units of search.
_STEP = 0.02
#: Error assigned to a diverged run, as a multiple of the record's size.
_DIVERGED = 1e3


def compared(n: int, sample_time: float, stride: int = 1) -> slice:
    """Samples of a record of n that are compared: without its start and its end. sample_time: s."""
    return slice(min(round(_SKIP / sample_time), n // 4), n - _END, stride)


def squared_gap(simulated: Array, measured: Array, sample_time: float, size: Array | None = None) -> float:
    """Mean square of an error over that of the measurement, or of `size`; (n,) each, without a record's start and end.
    sample_time: s."""
    keep = compared(len(measured), sample_time)
    whole = measured if size is None else size
    return float(np.mean((simulated - measured)[keep] ** 2)) / (float(np.mean(whole[keep] ** 2)) or 1.0)


@dataclass(frozen=True)
class Block:
    """Position of a record's channel in the residuals.

    size: divisor of its error (channel unit). trust: weight, 0 to 1.
    """

    record: int
    channel: int
    span: slice
    size: float
    trust: float = 1.0


def pooled(gaps: Array) -> float:
    """Gap of all blocks together; records and channels have equal weight."""
    return float(np.sqrt(np.mean(gaps**2)))


class Problem:
    """Residuals of some records of a rig; a block's sum of squares is its squared gap times its share.

    A gap is the RMS error over the RMS of the measurement. share: blocks of a record with two channels count
    half each, so that a sum over all blocks is a sum over records. trust: by (record, channel), factor on a
    block's residuals; a block of noise would otherwise dominate.
    """

    def __init__(
        self,
        rig: Rig,
        records: Sequence[int] | None = None,
        *,
        stride: int = 1,
        coarse: bool = False,
        trust: Mapping[tuple[int, int], float] | None = None,
    ) -> None:
        self.rig, self.stride, self.coarse = rig, stride, coarse
        self.trust = dict(trust or {})
        self.records = tuple(range(len(rig.records)) if records is None else records)
        self.runs = 0  # records simulated so far
        self.blocks: list[Block] = []
        self._measured: dict[int, Array] = {}
        at = 0
        for k in self.records:
            measured = self._measured[k] = rig.measured(k)[:, self.taken(k)]
            for channel, values in enumerate(measured):
                size = float(np.sqrt(np.mean(values**2))) or 1.0
                trusted = self.trust.get((k, channel), 1.0)
                self.blocks.append(Block(k, channel, slice(at, at + len(values)), size, trusted))
                at += len(values)
        self.samples = at
        self.weights = np.empty(at)
        for b in self.blocks:
            n = b.span.stop - b.span.start
            self.weights[b.span] = b.trust / (b.size * np.sqrt(n * len(rig.channels)))

    @classmethod
    def thinned(
        cls, rig: Rig, *, coarse: bool = False, trust: Mapping[tuple[int, int], float] | None = None
    ) -> Problem:
        """Residuals of all records of a rig, of every so many samples that there are _SAMPLES in all; _WHOLE with the
        full step."""
        stride = max(1, round(sum(r.n for r in rig.records) * len(rig.channels) / (_SAMPLES if coarse else _WHOLE)))
        return cls(rig, stride=stride, coarse=coarse, trust=trust)

    def like(self, rig: Rig | None = None, **changed: Any) -> Problem:
        """The same residuals of another rig, or with some arguments of a problem changed."""
        own = {"records": self.records, "stride": self.stride, "coarse": self.coarse, "trust": self.trust}
        return Problem(rig or self.rig, **{**own, **changed})

    def rougher(self, hypothesis: Hypothesis) -> Problem:
        """The same residuals from cheaper runs for the descent: with a search's step instead of the full one,
        or with a longer step if this hypothesis is slow. The problem itself if there are none."""
        rig = self.rig.rougher(hypothesis.terms)
        if rig is None and self.coarse:
            return self
        out = copy(self)
        out.rig, out.coarse = rig or self.rig, True
        return out

    def outputs(self, settings: Sequence[Settings]) -> Array:
        """Simulated channels of all records, concatenated (sets, samples), in the channels' units."""
        out = np.empty((len(settings), self.samples))
        at = 0
        for k, whole in zip(self.records, self._all_simulated(settings), strict=True):
            run = whole[:, :, self.taken(k)]
            width = run.shape[1] * run.shape[2]
            out[:, at : at + width] = run.reshape(len(settings), width)
            at += width
        return out

    def _all_simulated(self, settings: Sequence[Settings]) -> list[Array]:
        self.runs += len(settings) * len(self.records)
        try:
            return simulated_together(self.rig, settings, self.records, coarse=self.coarse)
        except InputError:  # which of them is found one by one
            return [self._simulated(settings, k) for k in self.records]

    def _simulated(self, settings: Sequence[Settings], record: int) -> Array:
        """Runs (sets, channels, n); NaN for settings outside the chain's limits (an unbounded hysteresis)."""
        try:
            return self.rig.simulate(settings, record, coarse=self.coarse)
        except InputError:
            refused = np.full((len(self.rig.channels), self.rig.records[record].n), np.nan)
            if len(settings) == 1:
                return refused[None]
            return np.concatenate([self._simulated([one], record) for one in settings])

    def taken(self, record: int) -> slice:
        """Samples of a record that are in the residuals."""
        one = self.rig.records[record]
        return compared(one.n, one.sample_time, self.stride)

    def measured(self) -> Array:
        """Measured channels of all records, concatenated (samples,)."""
        return np.concatenate([self._measured[k].ravel() for k in self.records])

    def of_settings(self, settings: Sequence[Settings]) -> Array:
        """Weighted residuals (sets, samples), simulated less measured."""
        out = (self.outputs(settings) - self.measured()) * self.weights
        limit = _DIVERGED / np.sqrt(self.samples)
        return np.asarray(np.clip(np.nan_to_num(out, nan=limit, posinf=limit, neginf=-limit), -limit, limit))

    def nominal(self) -> Array:
        """Weighted residuals (samples,) of the nominal simulator."""
        return np.asarray(self.of_settings([{}])[0])

    def residuals(self, hypothesis: Hypothesis, points: Array) -> Array:
        """Weighted residuals (points, samples) for points (points, coordinates)."""
        return self.of_settings([hypothesis.settings(q) for q in np.atleast_2d(points)])

    def jacobian(
        self, hypothesis: Hypothesis, q: Array, residual: Array, columns: Sequence[int] | None = None
    ) -> Array:
        """Forward differences within the bounds (samples, columns), all in one call. columns: which
        coordinates."""
        chosen = list(range(len(q)) if columns is None else columns)
        low, high = hypothesis.bounds()
        points = np.repeat(q[None], len(chosen), axis=0)
        steps = np.empty(len(chosen))
        for row, k in enumerate(chosen):
            steps[row] = _STEP if q[k] + _STEP <= high[k] else -_STEP
            if steps[row] < 0 and q[k] - _STEP < low[k]:  # a range narrower than the step
                steps[row] = (high[k] - q[k]) or (low[k] - q[k]) or _STEP
            points[row, k] += steps[row]
        if not chosen:
            return np.zeros((self.samples, 0))
        return np.asarray(((self.residuals(hypothesis, points) - residual) / steps[:, None]).T)

    def gaps(self, residual: Array) -> Array:
        """Gap (blocks,) of weighted residuals (samples,)."""
        channels = len(self.rig.channels)
        return np.array([np.sqrt(channels * np.sum(residual[b.span] ** 2)) / b.trust for b in self.blocks])

    def cost(self, gaps: Array) -> float:
        """Sum of squares of the weighted residuals that corresponds to gaps (blocks,)."""
        return float(np.sum(self.costs(gaps)))

    def costs(self, gaps: Array) -> Array:
        """The same of each record (records,)."""
        trust = np.array([b.trust for b in self.blocks])
        squares = (trust * gaps) ** 2 / len(self.rig.channels)
        return np.array([np.sum(squares[[b.record == k for b in self.blocks]]) for k in self.records])
