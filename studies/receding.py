"""Commands planned again and again for a motion that is known a little ahead: what a forecast of it is worth.

Receding-horizon optimisation through the rows. Every few periods a plan is made from the true present by the search of
`mrdamp.compare.clairvoyant`, over the motion that is known and a while at rest behind it, and its beginning is
applied. Without any known motion this is a causal controller of the full state; with the whole motion known it is the
clairvoyant one, with fewer steps of the search.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mrdamp.compare.clairvoyant import Effort, Peaks, search
from mrdamp.compare.rollouts import Rollouts
from mrdamp.model.core import Array
from mrdamp.simulation.rows import RowMoment


class Ongoing(Rollouts):
    """Rollouts that may begin in the present of a row."""

    _moment: RowMoment | None = None

    def go_on(self, moment: RowMoment, measured: Array, periods: int) -> None:
        """Runs begin in the present of a row and under its load from now on.

        measured: (measurements,) of the row there; periods: how many to run.
        """
        self._moment, self._state, self._measured = moment, moment.state.copy(), measured.copy()
        self.periods = periods
        for rows in self._rows.values():
            self._place(rows)

    def rows(self, n: int) -> Any:
        fresh = n not in self._rows
        rows = super().rows(n)
        if fresh and self._moment is not None:
            self._place(rows)
        return rows

    def _place(self, rows: Any) -> None:
        for row in range(rows.plants.n):
            rows.restore(row, (self._moment, None))


@dataclass(frozen=True)
class Receding:
    """known: s of the motion ahead; behind: s at rest that a plan looks on behind it, a little more than the frame's
    longest period; blocks: of a plan that are applied before the next; effort: of a plan, whose first `holds` is the
    length of a block."""

    known: float
    behind: float = 0.2
    blocks: int = 1
    effort: Effort = field(default_factory=lambda: Effort(holds=(8,), horizon=300, most=2))

    def commands(
        self,
        rollouts: Rollouts,
        objective: Peaks,
        period: float,
        progress: Callable[[float], None] | None = None,
    ) -> Array:
        """(periods,) for the whole of the rollouts' load. period: of control, s."""
        plant = rollouts.make(1)
        plant.start(0, rollouts.load)
        hold, whole = self.effort.holds[0], rollouts.periods
        every = self.blocks * hold
        given = np.zeros(whole)
        measured, plan = plant.plants.measured[0].copy(), np.zeros(0)
        ahead = Ongoing(rollouts.make, rollouts.load, rollouts.columns, rollouts.low, rollouts.high)
        for begin in range(0, whole, every):
            moment = plant.plants.save(0)
            window = hold * math.ceil((self.known + self.behind) / period / hold)
            ahead.go_on(until(moment, period * begin + self.known), measured, window)
            start = np.concatenate([plan[every:], np.zeros(window)])[:window]
            plan = search(ahead, [("plan", start)], objective, self.effort)[0].commands
            for k in range(begin, min(begin + every, whole)):
                given[k] = plan[k - begin]
                measured = plant.plants.advance(given[None, k : k + 1])[1][0].copy()
            if progress is not None:
                progress(min(1.0, (begin + every) / whole))
        return given


def until(moment: RowMoment, time: float) -> RowMoment:
    """The same present, with a load that is at rest behind `time` (s)."""
    load = moment.load.copy()
    load[math.floor(time / moment.sample_time + 1e-6) + 1 :] = 0.0
    return replace(moment, load=load)
