"""What a fit predicts of stretches that it was not fitted to, cell by cell.

A cell is a record x channel x eighth of the stroke since the last turn x direction of motion. A cause that acts in a
tenth of the cycle counts there, whatever the law misses in the rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mrdamp.diagnosis.constants import CELL_SCALE
from mrdamp.diagnosis.fits.least_squares import DAMPING, PRIOR_WEIGHT, ROUGHLY, Fit, gauss_newton
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array
from mrdamp.records.motion import share_of_stroke

Mask = NDArray[np.bool_]
Numbers = NDArray[np.intp]

#: Groups of records that are left out in turn; parts in time of each record if there are fewer records.
_GROUPS, _PARTS, _SEED = 4, 3, 1
#: Parts of a stroke.
_EIGHTHS = 8
#: The mean over so many cells is shrunk to one half: a frame of two records has two, a damper sixteen a record.
_FEW = 2

#: Steps of a fit without some samples, and trials of each.
_REFITS, _RETRIES = 4, 2


def folds(problem: Problem) -> list[Mask]:
    """Masks (samples,) of what is left out in turn: groups of records at random, or parts in time of each record."""
    lengths = [b.span.stop - b.span.start for b in problem.blocks]
    count = len(problem.records)
    if count < _GROUPS:
        number = np.concatenate([np.arange(n) * _PARTS // n for n in lengths])
        return [number == k for k in range(_PARTS)]
    group = np.random.default_rng(_SEED).permutation(count) % _GROUPS
    of = dict(zip(problem.records, group.tolist(), strict=True))
    number = np.concatenate([np.full(n, of[b.record]) for n, b in zip(lengths, problem.blocks, strict=True)])
    return [number == k for k in range(_GROUPS)]


def predicted(problem: Problem, found: Fit, left: Sequence[Mask]) -> Array:
    """Residuals (samples,) of each fold `left` at a fit made without it."""
    if not found.hypothesis.coordinates:
        return found.residual
    out = np.empty(problem.samples)
    for mask in left:
        out[mask] = refitted(problem, found, mask)[mask]
    return out


def refitted(problem: Problem, found: Fit, left: Mask) -> Array:
    """Residuals (samples,) of a fit made again without the samples `left`.

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
            row = problem.residuals(found.hypothesis, trial)[0]
            total = float(np.sum(row[keep] ** 2) + np.sum((prior * trial) ** 2))
            if total < cost:
                q, r, cost = trial, row, total
                break
            step = step / 4
        if not cost < (1 - ROUGHLY) * before:
            break
    return r


def cells(problem: Problem) -> Numbers:
    """Number of each sample's cell (samples,), from 0. A frame's floors do not follow the stroke of its damper: the
    cells of a frame are its records."""
    out = np.empty(problem.samples, dtype=np.intp)
    if not all(name.endswith("force_N") for name in problem.rig.channels):
        for b in problem.blocks:
            out[b.span] = problem.records.index(b.record)
        return out
    for number, b in enumerate(problem.blocks):
        conditions = problem.rig.conditions(b.record)
        x, taken = conditions["displacement (m)"], problem.taken(b.record)
        eighth = (_EIGHTHS * share_of_stroke(x)).astype(np.intp).clip(max=_EIGHTHS - 1)
        forward = conditions["velocity (m/s)"] > 0
        out[b.span] = ((number * _EIGHTHS + eighth) * 2 + forward)[taken]
    return np.asarray(np.unique(out, return_inverse=True)[1], dtype=np.intp)


def ratio(residual: Array, reference: Array, cell: Numbers) -> float:
    """Geometric mean over cells of the mean squares of residuals (samples,) over those of a reference.

    The variance of a law's error differs between cells and is unknown. The likelihood of Gaussian errors, marginal over
    variances with an inverse-gamma prior of scale CELL_SCALE times the mean, is a power of this ratio.
    Source: Gelman et al. (2013), Bayesian Data Analysis, section 3.2.
    """
    count = np.bincount(cell)
    own, other = (np.bincount(cell, r**2) / count for r in (residual, reference))
    scale = CELL_SCALE * float(np.mean(other))
    mean = float(np.mean(np.log((own + scale) / (other + scale))))
    return float(np.exp(mean * len(count) / (len(count) + _FEW)))
