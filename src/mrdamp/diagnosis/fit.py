"""Bounded least squares with priors: Levenberg-Marquardt whose trial steps run in one call."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrdamp.core import Array
from mrdamp.diagnosis.problem import Problem
from mrdamp.diagnosis.terms import Hypothesis, Settings

#: What the priors' sum of squares counts in units of a cost (gap squared): they settle what records leave open.
PRIOR_WEIGHT = 3e-6
#: Dampings tried at once, times the present one.
_DAMPINGS = (0.03, 1.0, 30.0)
#: Iterations after which a fit has to be below its bar.
_PATIENCE = 4
#: Gauss-Newton steps are no longer than this in any coordinate, in units of search.
_LONGEST = 8.0


@dataclass(frozen=True)
class Fit:
    """A hypothesis fitted to the records of a problem.

    point (coordinates,), cost: sum of squares of the residuals (a sum over records of gaps squared; the priors'
    share is not in it), residual (samples,) at the point, jacobian (samples, coordinates) there or where the last
    step set out from. at (coordinates,): where that is; None for the point itself.
    """

    hypothesis: Hypothesis
    point: Array
    cost: float
    residual: Array = field(repr=False)
    jacobian: Array = field(repr=False)
    iterations: int = 0
    converged: bool = True
    at: Array | None = field(default=None, repr=False)

    @property
    def settings(self) -> Settings:
        return self.hypothesis.settings(self.point)

    @property
    def move(self) -> float:
        """RMS of what the nominal parameters move by, as shares (or of their size, where they are not positive)."""
        scales = np.array([c.scale if c.log else 0.1 for c in self.hypothesis.nominal])
        moved = scales * self.point[: len(scales)]
        return float(np.sqrt(np.mean(moved**2))) if len(scales) else 0.0

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Names of the settings that stand at an end of their range."""
        low, high = self.hypothesis.bounds()
        slack = 1e-6 * np.maximum(high - low, 1e-12)
        at = (self.point <= low + slack) | (self.point >= high - slack)
        return tuple(c.name for c, is_at in zip(self.hypothesis.coordinates, at, strict=True) if is_at)


def fit(
    problem: Problem,
    hypothesis: Hypothesis,
    start: Array,
    *,
    most: int = 12,
    tolerance: float = 2e-3,
    known: Array | None = None,
    frozen: bool = False,
    bar: float = np.inf,
) -> Fit:
    """Fits from a point. most: iterations; tolerance: relative fall of the cost that ends it.

    known (samples, columns): columns of the Jacobian for the first coordinates, used in the first step, or in all of
    them where `frozen` (signatures of the nominal parameters change little with an effect). bar: a fit whose cost is
    still above this after a few iterations is given up.
    """
    low, high = hypothesis.bounds()
    prior = np.sqrt(PRIOR_WEIGHT) * hypothesis.prior()
    q = np.clip(start, low, high)
    r = problem.residuals(hypothesis, q)[0]
    total = float(r @ r) + float(np.sum((prior * q) ** 2))
    damping, converged, fresh, iterations = 1e-2, most == 0, known is None, 0
    at, j = q, _jacobian(problem, hypothesis, q, r, known)
    while iterations < most:
        iterations += 1
        steps = np.array([_step(j, r, prior, q, low, high, damping * d) for d in _DAMPINGS])
        trials = np.clip(q + steps, low, high)
        rows = problem.residuals(hypothesis, trials)
        totals = np.sum(rows**2, axis=1) + np.sum((prior * trials) ** 2, axis=1)
        best = int(np.argmin(totals))
        gain = 1 - totals[best] / total if total > 0 else 0.0
        if gain > 0:
            q, r, total = trials[best], rows[best], float(totals[best])
            damping = float(np.clip(damping * (0.1, 1.0, 10.0)[best], 1e-6, 1e6))
        if iterations == _PATIENCE and total > bar:
            break
        if gain < tolerance:
            if fresh or frozen:
                if damping >= 1e3 or gain > 0:
                    converged = True
                    break
                damping *= 1e3
                continue
            known, fresh = None, True  # the known columns may be what holds it up
        at, j = q, _jacobian(problem, hypothesis, q, r, known if frozen or not fresh else None)
        fresh = known is None
    return Fit(hypothesis, q, float(r @ r), r, j, iterations, converged, at)


def taken_up(
    problem: Problem, hypothesis: Hypothesis, point: Array, at: Array, known: Array | None, *, converged: bool
) -> Fit:
    """The fit that ended at a point, to the last bit. at: of its Jacobian; known: the columns that it had frozen."""
    residual = problem.residuals(hypothesis, point)[0]
    before = problem.residuals(hypothesis, at)[0]
    jacobian = _jacobian(problem, hypothesis, at, before, known)
    return Fit(hypothesis, point, float(residual @ residual), residual, jacobian, 0, converged, at)


def leave_out(problem: Problem, found: Fit, groups: Sequence[Sequence[int]]) -> Array:
    """Gaps (blocks,) on records that the parameters were not fitted to.

    groups: records (numbers) left out together. One Gauss-Newton step takes the fit to the optimum of the others,
    and the records left out are simulated there.
    """
    prior = np.sqrt(PRIOR_WEIGHT) * found.hypothesis.prior()
    low, high = found.hypothesis.bounds()
    gaps = np.full(len(problem.blocks), np.nan)
    for group in groups:
        keep = np.ones(problem.samples, dtype=bool)
        for b in problem.blocks:
            if b.record in group:
                keep[b.span] = False
        q = found.point
        # Damped: along what hardly matters (poles that may swap) an undamped step would go anywhere.
        step = _step(found.jacobian[keep], found.residual[keep], prior, q, low, high, 1e-2)
        inside = [k for k in problem.records if k in group]
        part = Problem(problem.rig, inside, stride=problem.stride, coarse=problem.coarse, trust=problem.trust)
        rows = part.gaps(part.residuals(found.hypothesis, np.clip(q + step, low, high))[0])
        for b, value in zip(part.blocks, rows, strict=True):
            at = next(
                i for i, o in enumerate(problem.blocks) if (o.record, o.channel) == (b.record, b.channel)
            )
            gaps[at] = value
    return gaps


def _jacobian(problem: Problem, hypothesis: Hypothesis, q: Array, r: Array, known: Array | None) -> Array:
    if known is None:
        return problem.jacobian(hypothesis, q, r)
    rest = problem.jacobian(hypothesis, q, r, range(known.shape[1], len(q)))
    return np.hstack([known, rest])


def _step(j: Array, r: Array, prior: Array, q: Array, low: Array, high: Array, damping: float) -> Array:
    """A damped Gauss-Newton step within the bounds: coordinates that would leave stay at their end."""
    matrix = j.T @ j + np.diag(prior**2)
    vector = -(j.T @ r + prior**2 * q)
    floor = 1e-9 * max(float(np.max(np.diag(matrix), initial=0.0)), 1e-30)
    matrix = matrix + np.diag(damping * np.diag(matrix) + floor)
    free = np.ones(len(q), dtype=bool)
    step = np.zeros(len(q))
    for _ in range(len(q) + 1):
        step = np.where(q + step < low, low - q, np.where(q + step > high, high - q, step))
        index = np.flatnonzero(free)
        if len(index) == 0:
            break
        held = np.flatnonzero(~free)
        right = vector[index] - matrix[np.ix_(index, held)] @ step[held]
        step[index] = np.linalg.solve(matrix[np.ix_(index, index)], right)
        out = free & ((q + step < low - 1e-12) | (q + step > high + 1e-12))
        if not out.any():
            break
        free &= ~out
    longest = float(np.max(np.abs(step), initial=0.0))
    return step * min(1.0, _LONGEST / longest) if longest > 0 else step
