"""Regimes of the records: groups of similar commands or speeds."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array

Groups = tuple[tuple[int, ...], ...]

#: Records belong to one regime if neighbouring levels (command over its largest, logarithm of the speed)
#: differ by less than this; largest number of regimes.
_SAME_COMMAND, _SAME_SPEED, _MOST = 0.1, 0.25, 4


@dataclass(frozen=True)
class Grouping:
    """Records by one condition of the tests.

    over: `command` (mean of a record), `speed` (RMS, m/s) or `record`. groups: numbers of the records. levels:
    smallest and largest value in each group; empty for single records.
    """

    over: str
    groups: Groups
    levels: tuple[tuple[float, float], ...] = ()


def groupings(problem: Problem) -> tuple[Grouping, ...]:
    """Groupings by the mean command and by the RMS speed; single records if neither has
    two regimes."""
    conditions = [problem.rig.conditions(k) for k in problem.records]
    levels = []
    if all("command" in c for c in conditions):
        command = np.array([float(np.mean(c["command"])) for c in conditions])
        levels.append(("command", command, command / (float(np.max(np.abs(command))) or 1.0), _SAME_COMMAND))
    if all("velocity (m/s)" in c for c in conditions):
        speed = np.array([float(np.sqrt(np.mean(c["velocity (m/s)"] ** 2))) for c in conditions])
        levels.append(("speed", speed, np.log(np.maximum(speed, 1e-9)), _SAME_SPEED))
    out = []
    for over, values, level, same in levels:
        groups = _grouped(level, same)
        if len(groups) > 1:
            numbers = tuple(tuple(problem.records[i] for i in g) for g in groups)
            ends = tuple((float(values[g].min()), float(values[g].max())) for g in groups)
            out.append(Grouping(over, numbers, ends))
    return tuple(out) or (Grouping("record", tuple((k,) for k in problem.records)),)


def _grouped(level: Array, same: float) -> list[list[int]]:
    order = np.argsort(level, kind="stable")
    groups = [[int(order[0])]]
    for before, k in pairwise(order):
        if level[k] - level[before] > same:
            groups.append([])
        groups[-1].append(int(k))
    while len(groups) > _MOST:  # merge the two nearest groups
        means = [float(np.mean(level[g])) for g in groups]
        i = int(np.argmin(np.diff(means)))
        groups[i : i + 2] = [groups[i] + groups[i + 1]]
    return groups
