"""What the size of an error goes with, where no effect of the catalogue touches it.

An error that follows no state of the chain (a hum, a wander, a chatter, drop-outs) still has a size: the same all the
time where a sensor adds it, that of the force where the fluid's share is multiplied, that of the force's part which
the command makes where the command fails. The residual is taken for normal, its variance that of the noise and one
part in proportion to the square of such a size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from mrdamp.core import Array
from mrdamp.diagnosis.damper import DamperRig
from mrdamp.diagnosis.fit import Fit
from mrdamp.diagnosis.problem import Problem
from mrdamp.diagnosis.resample import draws, group_sums, seconds

#: Stages whose errors have a size of their own; see `_sizes`.
_STAGES = ("sensor", "fluid", "driver")
#: Independent samples that the likelihood of all residuals counts for.
_INDEPENDENT = 14.0


@dataclass(frozen=True, eq=False)
class ErrorSizes:
    """Log likelihoods of an error by stage: table (seconds, stages) of sums, and the samples that it is of."""

    table: Array
    samples: int
    drawn: Array

    @classmethod
    def of(cls, problem: Problem, found: Fit, noise: float) -> ErrorSizes | None:
        """Of a fit's residual in the damper's own force (noise: standard deviation, N); None for another rig."""
        if not isinstance(problem.rig, DamperRig):
            return None
        own = np.concatenate([np.arange(b.span.start, b.span.stop) for b in problem.blocks if b.channel == 0])
        error = (found.residual / problem.weights)[own]
        terms = []
        for size in _sizes(problem, problem.rig, found):
            mean = float(np.mean(size**2))
            terms.append(_likelihood(error, size**2 / mean if mean > 0 else np.ones(len(size)), noise**2))
        groups = seconds(problem)[own]
        table = group_sums(np.column_stack(terms), groups)
        return cls(table, len(own), draws(len(table)) @ table)

    def at(self, draw: int | None = None) -> dict[str, float]:
        """Shares by stage, adding up to 1; in a draw of seconds."""
        sums = self.table.sum(axis=0) if draw is None else self.drawn[draw]
        weights = np.exp(_INDEPENDENT / self.samples * (sums - sums.max()))
        return dict(zip(_STAGES, (weights / weights.sum()).tolist(), strict=True))


def _sizes(problem: Problem, rig: DamperRig, found: Fit) -> list[Array]:
    """Size (samples,) of an error of each stage: 1, the force, and the part of it that the command makes."""
    force, without = [], []
    for k in problem.records:
        take, record = problem.taken(k), rig.records[k]
        force.append(rig.through(k, np.asarray(record.command), found.settings)["force"][take])
        without.append(rig.through(k, np.zeros(record.n), found.settings)["force"][take])
    total, plain = np.concatenate(force), np.concatenate(without)
    return [np.ones(len(total)), total, total - plain]


def _likelihood(error: Array, square: Array, noise: float) -> Array:
    """Log likelihood (samples,) of errors whose variance is that of the noise and a multiple of a square, the best."""

    def each(log: float) -> Array:
        variance = np.exp(log) * square + noise
        return np.asarray(-0.5 * np.log(variance) - error**2 / (2 * variance))

    low = np.log(max(noise, 1e-12)) - 6
    found = minimize_scalar(lambda log: -float(np.mean(each(log))), bounds=(low, low + 24), method="bounded")
    return each(float(found.x))
