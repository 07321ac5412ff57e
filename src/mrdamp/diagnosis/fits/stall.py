"""The travel at small force after a turn as evidence: measured and of simulations, side by side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.signatures.loops import Strokes
from mrdamp.model.core import Array

#: Share of a record's stroke below which a travel is not resolved.
_RESOLVED = 0.01
#: The mean over so few records is shrunk to one half.
_FEW = 2


@dataclass(frozen=True)
class Stalls:
    """Measured travels (m) of a problem's records: their median and its squared uncertainty, the median absolute
    deviation of the strokes and the resolution (records,)."""

    strokes: Strokes
    force: Array
    weights: Array
    median: Array
    square: Array

    @classmethod
    def of(cls, problem: Problem) -> Stalls:
        """Travels of a damper's records; a frame has none, whose forces are not those of a prescribed motion."""
        moves = "displacement (m)"
        conditions = [problem.rig.conditions(b.record) for b in problem.blocks]
        motions = [
            c[moves][problem.taken(b.record)] if moves in c else np.zeros(b.span.stop - b.span.start)
            for b, c in zip(problem.blocks, conditions, strict=True)
        ]
        strokes, force = Strokes.of(motions), problem.measured()
        travels = strokes.by_record(strokes.stalls(force))
        sizes = strokes.by_record(strokes.sizes + 0 * strokes.stalls(force))
        median = np.array([np.median(t) for t in travels])
        square = [
            np.median(np.abs(t - m)) ** 2 + (_RESOLVED * np.median(s)) ** 2
            for t, m, s in zip(travels, median, sizes, strict=True)
        ]
        return cls(strokes, force, problem.weights, median, np.array(square))

    def off(self, residual: Array) -> Array:
        """Travel (records,) m by which a simulation with weighted residuals (samples,) stalls longer than measured."""
        travels = self.strokes.by_record(self.strokes.stalls(self.force + residual / self.weights))
        return np.array([np.median(t) for t in travels]) - self.median

    def left(self, residual: Array, reference: Array) -> float:
        """Geometric mean over records of the squared error of a residual (samples,) over that of a reference."""
        return self._mean(np.log((self.off(residual) ** 2 + self.square) / (self.off(reference) ** 2 + self.square)))

    def missed(self, residual: Array) -> tuple[float, float]:
        """Travel (m) that a simulation with weighted residuals (samples,) lacks, and what one without this error would
        leave of its squares (`left`)."""
        off = self.off(residual)
        return -float(np.median(off)) if off.size else 0.0, self._mean(np.log(self.square / (off**2 + self.square)))

    @staticmethod
    def _mean(logs: Array) -> float:
        return float(np.exp(np.sum(logs) / (len(logs) + _FEW)))
