"""What a fit predicts of stretches that it was not fitted to, cell by cell.

A cell is a record x channel x eighth of the stroke since the last turn x direction of motion. A cause that acts in a
tenth of the cycle counts there, whatever the law misses in the rest.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from mrdamp.diagnosis.constants import CELL_SCALE
from mrdamp.diagnosis.fits.least_squares import DAMPING, PRIOR_WEIGHT, ROUGHLY, Fit, gauss_newton
from mrdamp.diagnosis.hypotheses.nominal_effects import own_settings
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array
from mrdamp.records.motion import share_of_stroke

Mask = NDArray[np.bool_]
Numbers = NDArray[np.intp]

#: Groups of records that are left out in turn; parts in time of each record if there are fewer records.
_GROUPS, _PARTS = 4, 3
#: Degree of a parameter's curve over the command.
_DEGREE = 2
#: Parameters of the Bouc-Wen laws that are springs.
_SPRINGS = frozenset({"k0", "k1", "x0"})
#: Share of a matrix's trace that is added where neither the records nor a prior determine a coordinate.
_RIDGE = 1e-12
#: Parts of a stroke.
_EIGHTHS = 8
#: The mean over so many cells is shrunk to one half: a damper has sixteen a record.
_FEW = 2

#: Steps of a fit without some samples, and trials of each.
_REFITS, _RETRIES = 4, 2


def folds(problem: Problem) -> list[Mask]:
    """Masks (samples,) of what is left out in turn: groups of records, or parts in time of each record."""
    lengths = [b.span.stop - b.span.start for b in problem.blocks]
    count, measured = len(problem.records), problem.measured()
    if count < _GROUPS:
        number = np.concatenate([np.arange(n) * _PARTS // n for n in lengths])
        return [number == k for k in range(_PARTS)]
    # Each group has records of all sizes, whatever the order and the names of the files.
    size = dict.fromkeys(problem.records, 0.0)
    for b in problem.blocks:
        size[b.record] += float(np.sum(measured[b.span] ** 2))
    of = {record: rank % _GROUPS for rank, record in enumerate(sorted(size, key=lambda k: size[k]))}
    number = np.concatenate([np.full(n, of[b.record]) for n, b in zip(lengths, problem.blocks, strict=True)])
    return [number == k for k in range(_GROUPS)]


def predicted(problem: Problem, found: Fit, left: Sequence[Mask]) -> Array:
    """Residuals (samples,) of each fold `left` at a fit made without it; all are made together."""
    if not found.hypothesis.coordinates:
        return found.residual
    out = np.empty(problem.samples)
    fits = [_refitted(found, mask) for mask in left]
    trials = {k: next(one) for k, one in enumerate(fits)}
    while trials:
        rows = problem.residuals(found.hypothesis, np.array([*trials.values()]))
        for k, row in zip([*trials], rows, strict=True):
            try:
                trials[k] = fits[k].send(row)
            except StopIteration as end:
                out[left[k]] = end.value[left[k]]
                del trials[k]
    return out


def _refitted(found: Fit, left: Mask) -> Generator[Array, Array, Array]:
    """Residuals (samples,) of a fit made again without the samples `left`; asks for those of each trial.

    Gauss-Newton steps from the fit to all, with its Jacobian. A step that does not make the other samples better is
    tried again at a quarter of its length.
    """
    prior = np.sqrt(PRIOR_WEIGHT) * found.hypothesis.prior()
    low, high = found.hypothesis.bounds()
    j, keep = found.jacobian[~left], ~left
    q, r = found.point, found.residual
    cost = float(np.sum(r[keep] ** 2) + np.sum((prior * q) ** 2))
    for _ in range(_REFITS):
        step, before = gauss_newton(j, r[keep], prior, q, low, high, DAMPING), cost
        for _ in range(_RETRIES):
            trial = np.clip(q + step, low, high)
            row = yield trial
            total = float(np.sum(row[keep] ** 2) + np.sum((prior * trial) ** 2))
            if total < cost:
                q, r, cost = trial, row, total
                break
            step = step / 4
        if not cost < (1 - ROUGHLY) * before:
            break
    return r


@dataclass(frozen=True)
class Curves:
    """Changes of the residuals (samples, columns) if parameters of the law are curves of the command, to first order,
    and the inverse standard deviations of their priors (columns,)."""

    columns: Array
    prior: Array

    @classmethod
    def none(cls, samples: int) -> Curves:
        return cls(np.zeros((samples, 0)), np.zeros(0))


def curves(problem: Problem, law: Fit) -> Curves:
    """Curves of the command of all parameters of a law but its springs, which act without a field.

    law: fit of the nominal parameters alone. The sensitivity to a parameter times a polynomial of the command is, to
    first order, the sensitivity to the parameter's change with the command. None for a frame, whose parameters are
    mostly its structure's, and for a constant command.
    """
    conditions = [problem.rig.conditions(b.record) for b in problem.blocks]
    if not (of_force(problem) and all("command" in c for c in conditions)):
        return Curves.none(problem.samples)
    parts = [c["command"][problem.taken(b.record)] for b, c in zip(problem.blocks, conditions, strict=True)]
    command = np.concatenate(parts)
    low, width = float(command.min()), float(np.ptp(command))
    if not width:
        return Curves.none(problem.samples)
    without = _SPRINGS | set(own_settings(problem.rig.model({}).effects))
    own = np.array([c.name not in without for c in law.hypothesis.coordinates])
    shapes = legvander(2 * (command - low) / width - 1, _DEGREE)[:, 1:]
    columns = np.hstack([law.jacobian[:, own] * shape[:, None] for shape in shapes.T])
    return Curves(columns, np.tile(law.hypothesis.prior()[own], _DEGREE))


def beside_curves(found: Fit, law: Fit, added: Curves, left: Sequence[Mask]) -> Array:
    """Residuals (samples,) of a fit if parameters of the law are curves of the command besides, to first order: of each
    fold `left` as predicted by the others, or of all samples as fitted if there are no folds."""
    parts = [(found.jacobian, found.hypothesis.prior()), (added.columns, added.prior)]
    parts += [] if found.hypothesis.nominal else [(law.jacobian, law.hypothesis.prior())]
    j, prior = np.hstack([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
    out = np.empty(len(j))
    for mask in left or [np.zeros(len(j), dtype=bool)]:
        kept = j[~mask]
        matrix = kept.T @ kept + PRIOR_WEIGHT * np.diag(prior**2)
        matrix += _RIDGE * np.trace(matrix) * np.eye(len(matrix))
        step = -np.linalg.solve(matrix, kept.T @ found.residual[~mask])
        rows = mask if left else ~mask
        out[rows] = found.residual[rows] + j[rows] @ step
    return out


def of_force(problem: Problem) -> bool:
    """True if only forces are compared: a damper's records."""
    return all(name.endswith("force_N") for name in problem.rig.channels)


def cells(problem: Problem) -> Numbers:
    """Number of each sample's cell (samples,), from 0. A frame's floors do not follow the stroke of its damper: the
    cells of a frame are its records and channels."""
    out = np.empty(problem.samples, dtype=np.intp)
    if not of_force(problem):
        for number, b in enumerate(problem.blocks):
            out[b.span] = number
        return out
    for number, b in enumerate(problem.blocks):
        conditions = problem.rig.conditions(b.record)
        x, taken = conditions["displacement (m)"], problem.taken(b.record)
        eighth = (_EIGHTHS * share_of_stroke(x)).astype(np.intp).clip(max=_EIGHTHS - 1)
        forward = conditions["velocity (m/s)"] > 0
        out[b.span] = ((number * _EIGHTHS + eighth) * 2 + forward)[taken]
    return np.asarray(np.unique(out, return_inverse=True)[1], dtype=np.intp)


def ratio(residual: Array, reference: Array, cell: Numbers, best: Array) -> float:
    """Geometric mean over cells of the mean squares of residuals (samples,) over those of a reference.

    The variance of a law's error differs between cells and is unknown. The likelihood of Gaussian errors, marginal over
    variances with an inverse-gamma prior, is a power of this ratio. The scale of the prior is CELL_SCALE times the mean
    over cells of the squares of `best`, the residual (samples,) of the best fit: with the rig's law that is the noise.
    Source: Gelman et al. (2013), Bayesian Data Analysis, section 3.2.
    """
    count = np.bincount(cell)
    own, other, least = (np.bincount(cell, r**2) / count for r in (residual, reference, best))
    scale = CELL_SCALE * float(np.mean(least))
    mean = float(np.mean(np.log((own + scale) / (other + scale))))
    return float(np.exp(mean * len(count) / (len(count) + _FEW)))
