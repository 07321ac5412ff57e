"""Effect of a cause on the rig's baseline: a cause that improves the baseline as well is not a change of the
rig."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mrdamp.diagnosis.constants import EVIDENCE_GAIN
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.left_out import cells, ratio
from mrdamp.diagnosis.problem.residuals import Problem

#: Number of best fits, for each number of causes, that are evaluated.
_LOOKED_AT = 12


def of_baseline(problem: Problem, fits: Sequence[Fit]) -> dict[int, float]:
    """Penalties (nats), by id, of fits whose settings reduce the error on the baseline below the nominal
    simulator's.

    problem: of the baseline's records, in the state in which the nominal simulator was identified. An improvement on
    the baseline is a model error of the nominal simulator. It is subtracted from the evidence for a change.
    """
    chosen: list[Fit] = []
    for count in (0, 1, 2):
        alike = [f for f in fits if len(f.hypothesis.causes) == count and f.hypothesis.coordinates]
        chosen += sorted(alike, key=lambda f: (f.cost, f.hypothesis.name))[:_LOOKED_AT]
    nominal, *rows = problem.of_settings([{}, *(f.settings for f in chosen)])
    cell, best = cells(problem), min((nominal, *rows), key=lambda r: float(r @ r))
    gains = [-EVIDENCE_GAIN * math.log(ratio(row, nominal, cell, best)) for row in rows]
    return {id(f): max(g, 0.0) for f, g in zip(chosen, gains, strict=True)}
