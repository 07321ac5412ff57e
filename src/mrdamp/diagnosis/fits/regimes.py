"""Records left out by regime: a correction has to hold at commands and speeds that none of its numbers saw."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mrdamp.diagnosis.fits.least_squares import Fit, leave_out
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array

Groups = tuple[tuple[int, ...], ...]

#: Records whose level (of the command over its largest, of the logarithm of the speed) lies within this of the one
#: before are one regime; most regimes of a grouping.
_SAME_COMMAND, _SAME_SPEED, _MOST = 0.1, 0.25, 4


def by_record(problem: Problem) -> Groups:
    """Every record alone."""
    return tuple((k,) for k in problem.records)


def groupings(problem: Problem) -> tuple[Groups, ...]:
    """Ways to leave records out: by the mean command, by the RMS speed; each alone where neither has two regimes."""
    conditions = [problem.rig.conditions(k) for k in problem.records]
    levels = []
    if all("command" in c for c in conditions):
        command = np.array([float(np.mean(c["command"])) for c in conditions])
        levels.append((command / (float(np.max(np.abs(command))) or 1.0), _SAME_COMMAND))
    if all("velocity (m/s)" in c for c in conditions):
        speed = np.array([float(np.sqrt(np.mean(c["velocity (m/s)"] ** 2))) for c in conditions])
        levels.append((np.log(np.maximum(speed, 1e-9)), _SAME_SPEED))
    out = []
    for level, same in levels:
        groups = _grouped(level, same)
        if len(groups) > 1:
            out.append(tuple(tuple(problem.records[i] for i in g) for g in groups))
    return tuple(out) or (by_record(problem),)


def _grouped(level: Array, same: float) -> list[list[int]]:
    order = np.argsort(level, kind="stable")
    groups = [[int(order[0])]]
    for before, k in pairwise(order):
        if level[k] - level[before] > same:
            groups.append([])
        groups[-1].append(int(k))
    while len(groups) > _MOST:  # the two that are nearest are one
        means = [float(np.mean(level[g])) for g in groups]
        i = int(np.argmin(np.diff(means)))
        groups[i : i + 2] = [groups[i] + groups[i + 1]]
    return groups


def left_out(problem: Problem, found: Fit, groups: Groups) -> Array:
    """Gaps (blocks,) with the records of each group left out together."""
    if not found.hypothesis.coordinates:
        return problem.gaps(found.residual)
    return leave_out(problem, found, groups)


def regime_cost(problem: Problem, found: Fit) -> float:
    """Sum of squares that a fit leaves of records left out by regime, in the grouping where it leaves most."""
    return max(problem.cost(left_out(problem, found, g)) for g in groupings(problem))
