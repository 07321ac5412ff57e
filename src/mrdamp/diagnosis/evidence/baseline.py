"""What a cause does to the rig's baseline: it is no change where it takes as much off there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.problem.residuals import Problem

#: Fits that are looked at, those that leave least of each number of causes.
_LOOKED_AT = 12


def of_baseline(problem: Problem, fits: Sequence[Fit], weight: float) -> dict[int, float]:
    """Nats, by id, against fits whose settings leave less of the baseline than the nominal simulator does.

    weight: nats per logarithm of the cost. problem: of the baseline's records, in the state in which the nominal
    simulator was identified. What a cause mends there is the simulator's own misfit, and counts off the evidence that
    it has for a change.
    """
    chosen: list[Fit] = []
    for count in (0, 1, 2):
        alike = [f for f in fits if len(f.hypothesis.causes) == count and f.hypothesis.coordinates]
        chosen += sorted(alike, key=lambda f: (f.cost, f.hypothesis.name))[:_LOOKED_AT]
    rows = problem.of_settings([{}, *(f.settings for f in chosen)])
    costs = np.sum(rows**2, axis=1)
    gains = weight * np.log(costs[0] / np.maximum(costs[1:], 1e-30))
    return {id(f): max(float(g), 0.0) for f, g in zip(chosen, gains, strict=True)}
