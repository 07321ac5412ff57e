"""Bootstrap intervals over independent blocks: seconds of the residuals, or records. Fits are not repeated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrdamp.diagnosis.fits.least_squares import PRIOR_WEIGHT, Fit
from mrdamp.diagnosis.hypotheses.terms import Settings
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.identify.intervals import few_groups
from mrdamp.model.core import Array

Interval = tuple[float, float]
Numbers = NDArray[np.intp]

#: s, length of a block; number of draws; percentiles of the 95 % interval.
SECONDS, DRAWS, _ENDS = 1.0, 400, (2.5, 97.5)
_SEED = 17
#: Resolution of a parameter that the records determine.
_RESOLVED = 0.5
#: Least number of records for a bootstrap over whole records.
_RECORDS = 4


def seconds(problem: Problem) -> Numbers:
    """Number of the block (samples,) of each residual: a second of a record, all its channels together."""
    out, at = np.empty(problem.samples, dtype=np.intp), 0
    for k in problem.records:
        record = problem.rig.records[k]
        number = np.floor((record.time[problem.taken(k)] - record.time[0]) / SECONDS).astype(np.intp)
        for b in (b for b in problem.blocks if b.record == k):
            out[b.span] = at + number
        at += int(number.max()) + 1
    return np.asarray(np.unique(out, return_inverse=True)[1], dtype=np.intp)


def of_records(problem: Problem) -> Numbers:
    """Number of the record (samples,) of each residual, from 0."""
    out = np.empty(problem.samples, dtype=np.intp)
    for b in problem.blocks:
        out[b.span] = problem.records.index(b.record)
    return out


def draws(groups: int) -> Array:
    """Multiplicity of each group (DRAWS, groups): drawn with replacement, as many as there are."""
    rng = np.random.default_rng([_SEED, groups])
    return rng.multinomial(groups, np.full(groups, 1 / groups), size=DRAWS).astype(float)


def interval(values: Array) -> Interval:
    """95 % interval of draws (draws,)."""
    low, high = np.percentile(values, _ENDS)
    return float(low), float(high)


def group_sums(values: Array, groups: Numbers) -> Array:
    """Sums by group (groups, columns) of values (samples, columns)."""
    count = int(groups.max()) + 1
    return np.column_stack([np.bincount(groups, column, minlength=count) for column in values.T])


@dataclass(frozen=True, eq=False)
class Spread:
    """Bootstrap distribution of a fit's parameters (draws, coordinates), in units of search.

    widest: for each coordinate the draws of the grouping with the wider interval. together: joint draws of
    all coordinates, from whole records if there are enough.
    """

    fit: Fit
    widest: Array
    together: Array

    def intervals(self) -> dict[str, Interval]:
        """95 % intervals of the settings by name, in SI units."""
        out = {}
        for k, c in enumerate(self.fit.hypothesis.coordinates):
            values = sorted(c.value(end) for end in interval(self.widest[:, k]))
            out[c.name] = (values[0], values[1])
        return out

    def settings(self) -> Iterator[Settings]:
        """Settings of the joint draws."""
        return (self.fit.hypothesis.settings(q) for q in self.together)


def spread(problem: Problem, found: Fit) -> Spread:
    """Bootstrap distribution of a fit's parameters.

    Score bootstrap (Kline, Santos 2012, doi:10.1515/2156-6674.1006): blocks of the gradient are drawn again,
    and one Gauss-Newton step with the curvature of all records gives the parameters of the draw. Blocks are
    seconds, which suits noise, and records, which suits a model error over a whole record. Draws are clipped
    to the parameters' ranges. The interval of a parameter that its prior determines rather than the records (resolution
    below one half; Backus, Gilbert 1968, doi:10.1111/j.1365-246X.1968.tb00216.x) is its range.
    """
    j, prior = found.jacobian, found.hypothesis.prior()
    low, high = found.hypothesis.bounds()
    if not j.shape[1]:
        return Spread(found, np.zeros((DRAWS, 0)), np.zeros((DRAWS, 0)))
    told = j.T @ j
    curvature = told + PRIOR_WEIGHT * np.diag(prior**2)
    curvature += 1e-9 * max(float(np.max(np.diag(curvature))), 1e-30) * np.eye(len(curvature))
    scores = j * found.residual[:, None]
    points: list[Array] = []
    for groups, least in ((seconds(problem), 2), (of_records(problem), _RECORDS)):
        by_group = group_sums(scores, groups)
        count = len(by_group)
        if count < least:
            continue
        # The blocks' sum is zero at an optimum, except for the prior and active bounds.
        centred = (by_group - by_group.mean(axis=0)) * few_groups(count)
        step = -np.linalg.solve(curvature, (draws(count) @ centred).T).T
        points.append(np.clip(found.point + step, low, high))
    if not points:
        points = [np.repeat(found.point[None], DRAWS, axis=0)]
    wider = np.argmax([p.std(axis=0) for p in points], axis=0)
    widest = np.column_stack([points[w][:, k] for k, w in enumerate(wider)])
    loose = np.diag(np.linalg.solve(curvature, told)) < _RESOLVED
    widest[:, loose] = np.linspace(low, high, DRAWS)[:, loose]
    return Spread(found, widest, points[-1])
