"""Bounded nonlinear least squares with priors: Levenberg-Marquardt that evaluates several damping values in
one call."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Settings
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array

#: Weight of the priors' sum of squares in units of a cost (squared gap): priors determine what the records
#: leave open.
PRIOR_WEIGHT = 3e-6
#: Relative reduction of the cost that ends a fit; number of full steps if a fit need not be precise.
TOLERANCE, ROUGHLY = 2e-3, 0.01
#: Damping factors evaluated at once, relative to the present one; initial damping.
_DAMPINGS, DAMPING = (0.03, 1.0, 30.0), 1e-2
#: Number of iterations after which a fit has to be below its bar.
_PATIENCE = 4
#: Number of descents with coarse runs, each from the last full step; relative accuracy required of a coarse
#: run's cost.
_ROUNDS, _AGREEMENT = 3, 0.02
#: A coarse run's error is corrected only if it is below this share of a residual's sum of squares: the
#: correction holds locally.
_NEARBY = 0.1
#: Largest Gauss-Newton step in any coordinate, in units of search.
_LONGEST = 8.0
#: Range of a line scan along a rugged coordinate (logarithm of its setting), and number of scans.
_AHEAD = np.array([0.02, 0.07, 0.25, 0.9])
_SCANS = 4


@dataclass(frozen=True)
class Fit:
    """A hypothesis fitted to the records of a problem.

    point (coordinates,). cost: sum of squared residuals (sum over records of squared gaps, without the
    priors). residual (samples,) at the point. jacobian (samples, coordinates) at the point or at the start of
    the last step.
    """

    hypothesis: Hypothesis
    point: Array
    cost: float
    residual: Array = field(repr=False)
    jacobian: Array = field(repr=False)
    iterations: int = 0
    converged: bool = True

    @property
    def name(self) -> str:
        """Names of the terms and whether the nominal parameters are free."""
        return f"{'free' if self.hypothesis.nominal else 'held'} {self.hypothesis.name}"

    @property
    def settings(self) -> Settings:
        return self.hypothesis.settings(self.point)

    @property
    def move(self) -> float:
        """RMS of the relative changes of the nominal parameters (relative to their size if they are not
        positive)."""
        scales = np.array([c.scale if c.log else 0.1 for c in self.hypothesis.nominal])
        moved = scales * self.point[: len(scales)]
        return float(np.sqrt(np.mean(moved**2))) if len(scales) else 0.0

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Names of the settings at a limit of their range."""
        low, high = self.hypothesis.bounds()
        slack = 1e-6 * np.maximum(high - low, 1e-12)
        return self._named((self.point <= low + slack) | (self.point >= high - slack))

    @property
    def at_lower_bounds(self) -> tuple[str, ...]:
        """Names of the settings within one unit of search of their lower limit."""
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
    """Fits from a point.

    most: largest number of iterations. tolerance: relative reduction of the cost that ends the fit. known
    (samples, columns): Jacobian columns of the first coordinates, used in the first step, or in all steps if
    `frozen` (signatures of the nominal parameters change little with an effect). bar: a fit with a higher
    cost after a few iterations is stopped.
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
    """A fit in progress.

    Its steps are tried in coarse runs, corrected by the difference to the full run at the last full step. At
    the end of a descent a full run is made. If coarse runs give no further reduction, full runs are used.
    """

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
        self.own = self.rough_run()  # without the correction
        self.full = (self.q, self.r, self.own, self.total)
        off = self.r - self.own
        if float(off @ off) > _NEARBY * self.total:
            self.r, self.total = self.own, self.cost(self.own, self.q)
        self.known, self.fresh = known, known is None
        self.damping, self.iterations, self.converged = DAMPING, 0, False
        self.steps_there = 0  # iterations up to the last full step
        self.there = True  # the last full step was at this point
        self.exact = False  # the Jacobian is from full runs
        self.look()

    def cost(self, r: Array, q: Array) -> float:
        """Sum of squares including the priors."""
        return float(r @ r) + float(np.sum((self.prior * q) ** 2))

    def rough_run(self) -> Array:
        """Residual of the coarse run at the present point."""
        if self.rough is self.problem:
            return self.r
        return np.asarray(self.rough.residuals(self.hypothesis, self.q)[0])

    def look(self) -> None:
        """Computes the Jacobian at the present point; from coarse runs as long as they give a reduction."""
        known = self.known if self.frozen or not self.fresh else None
        runs, before = self.stepper, self.r
        if self.stepper is self.rough:
            before = self.own
        elif not self.exact:
            runs, before = self.rough, self.rough_run()
        self.j = _jacobian(runs, self.hypothesis, self.q, before, known)
        self.fresh = known is None

    def run(self, most: int, tolerance: float, bar: float) -> None:
        """Iterates until the reduction is small."""
        self.converged = False
        if self.stepper is self.rough:
            tolerance = min(
                tolerance, TOLERANCE
            )  # these cost little; stopping early on a narrow path ends far from the optimum
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
                    self.known, self.fresh = None, True  # the known columns may be what blocks the descent
            self.look()

    def step(self) -> float:
        """Takes the best of some trial steps; returns the relative reduction of the cost."""
        steps = np.array(
            [
                gauss_newton(self.j * self.smooth, self.r, self.prior, self.q, self.low, self.high, self.damping * d)
                for d in _DAMPINGS
            ]
        )
        gain, best = self.take(steps)
        if gain > 0:
            self.damping = float(np.clip(self.damping * (0.1, 1.0, 10.0)[best], 1e-6, 1e6))
        return gain

    def take(self, moves: Array) -> tuple[float, int]:
        """Takes the best of some moves (moves, coordinates) if it reduces the cost; returns the relative
        reduction and its index."""
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
        """Scans the rugged coordinates from the best point; False if that gains little."""
        moves = []
        for k in np.flatnonzero(self.smooth == 0):
            for ahead in np.concatenate([-_AHEAD, _AHEAD]):
                move = np.zeros(len(self.q))
                move[k] = ahead / self.hypothesis.coordinates[k].scale
                moves.append(move)
        if not moves or self.take(np.array(moves))[0] < tolerance:
            return False
        self.iterations, self.steps_there, self.damping = 0, 0, DAMPING
        self.look()
        return True

    def arrived(self, most: int, bar: float) -> bool:
        """True if a full run confirms the descent of the coarse runs or no further descent is possible; the
        point is then final."""
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
        self.damping = min(self.damping, DAMPING)
        self.look()
        return False

    def fit(self, most: int) -> Fit:
        """The fit at the present point."""
        converged, cost = self.converged or most == 0, float(self.r @ self.r)
        return Fit(self.hypothesis, self.q, cost, self.r, self.j, self.iterations, converged)


def _jacobian(problem: Problem, hypothesis: Hypothesis, q: Array, r: Array, known: Array | None) -> Array:
    if known is None:
        return problem.jacobian(hypothesis, q, r)
    rest = problem.jacobian(hypothesis, q, r, range(known.shape[1], len(q)))
    return np.hstack([known, rest])


def gauss_newton(j: Array, r: Array, prior: Array, q: Array, low: Array, high: Array, damping: float) -> Array:
    """A damped Gauss-Newton step within the bounds; coordinates that would leave stay at their limit."""
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
        at_bound = np.flatnonzero(~free)
        right = vector[index] - matrix[np.ix_(index, at_bound)] @ step[at_bound]
        step[index] = np.linalg.solve(matrix[np.ix_(index, index)], right)
        out = free & ((q + step < low - 1e-12) | (q + step > high + 1e-12))
        if not out.any():
            break
        free &= ~out
    longest = float(np.max(np.abs(step), initial=0.0))
    return step * min(1.0, _LONGEST / longest) if longest > 0 else step
