"""Bounded least squares with priors: Levenberg-Marquardt whose trial steps run in one call."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Settings
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array

#: What the priors' sum of squares counts in units of a cost (gap squared): they settle what records leave open.
PRIOR_WEIGHT = 3e-6
#: Relative fall of the cost that ends a fit, and full steps of one whose last figures do not matter.
TOLERANCE, ROUGHLY = 2e-3, 0.01
#: Dampings tried at once, times the present one; the first of them.
_DAMPINGS, _DAMPING = (0.03, 1.0, 30.0), 1e-2
#: Iterations after which a fit has to be below its bar.
_PATIENCE = 4
#: Descents in rough runs, each from where the full step stands; a cost that the rough runs got right to this share.
_ROUNDS, _AGREEMENT = 3, 0.02
#: Share of a residual's sum of squares above which what a rough run is off by is not taken off: it holds nearby alone.
_NEARBY = 0.1
#: Gauss-Newton steps are no longer than this in any coordinate, in units of search.
_LONGEST = 8.0
#: How far a fit looks along a rugged coordinate (logarithm of its setting), and how often it goes on from there.
_AHEAD = np.array([0.02, 0.07, 0.25, 0.9])
_SCANS = 4


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
    def name(self) -> str:
        """Of the terms, and whether the nominal parameters are free beside them."""
        return f"{'free' if self.hypothesis.nominal else 'held'} {self.hypothesis.name}"

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
        return self._named((self.point <= low + slack) | (self.point >= high - slack))

    @property
    def at_lower_bounds(self) -> tuple[str, ...]:
        """Names of those that stand at its lower end, to a unit of search."""
        return self._named(self.point <= self.hypothesis.bounds()[0] + 1)

    def _named(self, which: NDArray[np.bool_]) -> tuple[str, ...]:
        return tuple(c.name for c, is_it in zip(self.hypothesis.coordinates, which, strict=True) if is_it)


def fit(
    problem: Problem,
    hypothesis: Hypothesis,
    start: Array,
    *,
    most: int = 12,
    tolerance: float = TOLERANCE,
    known: Array | None = None,
    frozen: bool = False,
    bar: float = np.inf,
) -> Fit:
    """Fits from a point. most: iterations; tolerance: relative fall of the cost that ends it.

    known (samples, columns): columns of the Jacobian for the first coordinates, used in the first step, or in all of
    them where `frozen` (signatures of the nominal parameters change little with an effect). bar: a fit whose cost is
    still above this after a few iterations is given up.
    """
    descent = _Descent(problem, hypothesis, start, known, frozen)
    for _ in range(1 + _SCANS):
        for _ in range(_ROUNDS):
            descent.run(most, tolerance, bar)
            if descent.arrived(most, bar):
                break
        if most == 0 or descent.total > bar or not descent.scan(tolerance):
            break
    if not descent.there:
        descent.arrived(0, bar)
    return descent.fit(most)


class _Descent:
    """A fit under way. Its steps are tried in rough runs, each less what such a run was off by where the full step was
    last taken; where they end, the full step is taken again. Where rough runs lead no further, full ones do."""

    def __init__(
        self, problem: Problem, hypothesis: Hypothesis, start: Array, known: Array | None, frozen: bool
    ) -> None:
        self.problem, self.hypothesis, self.frozen = problem, hypothesis, frozen
        self.rough = self.stepper = problem.rougher(hypothesis)
        self.low, self.high = hypothesis.bounds()
        self.smooth = np.array([0.0 if c.rugged else 1.0 for c in hypothesis.coordinates])
        self.prior = np.sqrt(PRIOR_WEIGHT) * hypothesis.prior()
        self.q = np.clip(start, self.low, self.high)
        self.r: Array = problem.residuals(hypothesis, self.q)[0]
        self.total = self.cost(self.r, self.q)
        self.own = self.rough_run()  # without what is taken off it
        self.full = (self.q, self.r, self.own, self.total)
        off = self.r - self.own
        if float(off @ off) > _NEARBY * self.total:
            self.r, self.total = self.own, self.cost(self.own, self.q)
        self.known, self.fresh = known, known is None
        self.damping, self.iterations, self.converged = _DAMPING, 0, False
        self.steps_there = 0  # iterations up to where the full step was last taken
        self.there = True  # the full step was taken where it stands
        self.exact = False  # the Jacobian is of full runs
        self.look()

    def cost(self, r: Array, q: Array) -> float:
        """Sum of squares with the priors' share."""
        return float(r @ r) + float(np.sum((self.prior * q) ** 2))

    def rough_run(self) -> Array:
        """The rough run's residual where it stands."""
        if self.rough is self.problem:
            return self.r
        return np.asarray(self.rough.residuals(self.hypothesis, self.q)[0])

    def look(self) -> None:
        """The Jacobian where it stands; by rough runs as long as that leads on."""
        known = self.known if self.frozen or not self.fresh else None
        runs, before = self.stepper, self.r
        if self.stepper is self.rough:
            before = self.own
        elif not self.exact:
            runs, before = self.rough, self.rough_run()
        self.at, self.j = self.q, _jacobian(runs, self.hypothesis, self.q, before, known)
        self.fresh = known is None

    def run(self, most: int, tolerance: float, bar: float) -> None:
        """Steps until they gain little."""
        self.converged = False
        if self.stepper is self.rough:
            tolerance = min(
                tolerance, TOLERANCE
            )  # these cost little, and stopped early a slow way ends far off
        while self.iterations < most:
            self.iterations += 1
            gain = self.step()
            if self.iterations == _PATIENCE and self.total > bar:
                return
            if gain < tolerance:
                if self.stepper is not self.rough and not self.exact:
                    self.exact = True
                elif self.fresh or self.frozen:
                    if self.damping >= 1e3 or gain > 0:
                        self.converged = gain < TOLERANCE
                        return
                    self.damping *= 1e3
                    continue
                else:
                    self.known, self.fresh = None, True  # the known columns may be what holds it up
            self.look()

    def step(self) -> float:
        """The best of some trial steps; the relative fall of the cost."""
        steps = np.array(
            [
                _step(self.j * self.smooth, self.r, self.prior, self.q, self.low, self.high, self.damping * d)
                for d in _DAMPINGS
            ]
        )
        gain, best = self.take(steps)
        if gain > 0:
            self.damping = float(np.clip(self.damping * (0.1, 1.0, 10.0)[best], 1e-6, 1e6))
        return gain

    def take(self, moves: Array) -> tuple[float, int]:
        """The best of some moves (moves, coordinates), where it is one; the relative fall of the cost, and which."""
        trials = np.clip(self.q + moves, self.low, self.high)
        runs = self.stepper.residuals(self.hypothesis, trials)
        rows = runs if self.stepper is self.problem else runs + (self.r - self.own)
        totals = np.sum(rows**2, axis=1) + np.sum((self.prior * trials) ** 2, axis=1)
        best = int(np.argmin(totals))
        gain = float(1 - totals[best] / self.total) if self.total > 0 else 0.0
        if gain > 0:
            self.q, self.r, self.own, self.total = trials[best], rows[best], runs[best], float(totals[best])
            self.there = self.stepper is self.problem
        return gain, best

    def scan(self, tolerance: float) -> bool:
        """Goes on from the best point along the rugged coordinates; False where that gains little."""
        moves = []
        for k in np.flatnonzero(self.smooth == 0):
            for ahead in np.concatenate([-_AHEAD, _AHEAD]):
                move = np.zeros(len(self.q))
                move[k] = ahead / self.hypothesis.coordinates[k].scale
                moves.append(move)
        if not moves or self.take(np.array(moves))[0] < tolerance:
            return False
        self.iterations, self.steps_there, self.damping = 0, 0, _DAMPING
        self.look()
        return True

    def arrived(self, most: int, bar: float) -> bool:
        """True where the full step finds what the rough runs led to, or there is no going on; that is then taken."""
        if self.stepper is self.problem:
            return True
        expected, q, self.there = self.total, self.q, True
        r = self.problem.residuals(self.hypothesis, q)[0]
        total = self.cost(r, q)
        if total < self.full[-1]:
            self.r, self.total = r, total
            self.full = (q, r, self.own, total)
            self.steps_there = self.iterations
            agreed = abs(total - expected) <= _AGREEMENT * total
        else:
            self.q, self.r, self.own, self.total = self.full
            agreed, self.stepper = False, self.problem
            self.iterations = self.steps_there
        if agreed or self.iterations >= most or self.total > bar:
            return True
        self.damping = min(self.damping, _DAMPING)
        self.look()
        return False

    def fit(self, most: int) -> Fit:
        """What was found."""
        converged = self.converged or most == 0
        point, cost = self.q, float(self.r @ self.r)
        if self.stepper is not self.rough:  # the Jacobian as `taken_up` will have it
            self.stepper, self.q = self.rough, self.at
            self.own = self.rough_run()
            self.look()
        return Fit(self.hypothesis, point, cost, self.r, self.j, self.iterations, converged, self.at)


def taken_up(
    problem: Problem, hypothesis: Hypothesis, point: Array, at: Array, known: Array | None, *, converged: bool
) -> Fit:
    """The fit that ended at a point, to the last bit. at: of its Jacobian; known: the columns that it had frozen."""
    residual = problem.residuals(hypothesis, point)[0]
    rough = problem.rougher(hypothesis)
    before = rough.residuals(hypothesis, at)[0]
    jacobian = _jacobian(rough, hypothesis, at, before, known)
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
