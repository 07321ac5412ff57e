"""Means, worst cases and bootstrap intervals over motions and seeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrdamp.errors import InputError
from mrdamp.model.core import Array

Whole = NDArray[np.int64]
RESAMPLES = 2000
LEVEL = 0.95
_SEED = 0


@dataclass(frozen=True)
class Summary:
    """Of one measure of one controller: mean and largest value, and the mean's interval (95 %)."""

    mean: float
    worst: float
    low: float
    high: float


def summarise(values: Array) -> Summary:
    """values (seeds, motions, amplitudes); motions and, where there are several, seeds are drawn with replacement.

    The amplitudes of a motion stay together: they are chosen, not drawn. With one motion and one seed there is no
    interval (NaN).
    """
    if values.ndim != 3 or not values.size:
        raise InputError(f"compare: values have shape {values.shape}; allowed: (seeds, motions, amplitudes)")
    low, high = interval(values)
    return Summary(float(values.mean()), float(values.max()), low, high)


def interval(values: Array) -> tuple[float, float]:
    """Percentile interval of the mean of values (seeds, motions, amplitudes)."""
    cells = values.mean(axis=2)
    if not np.isfinite(cells).all() or cells.size == 1:
        return float("nan"), float("nan")
    rows, columns = _draws(cells)
    return _percentiles(cells[rows, columns].mean(axis=(1, 2)))


def ratio(values: Array, other: Array) -> tuple[float, float, float]:
    """Mean of values over mean of other, and its percentile interval; other has one seed.

    Shapes (seeds, motions, amplitudes); drawn together, as in `summarise`. NaN where the mean of other is not above 0,
    and for the interval where it is not in all draws.
    """
    if values.shape[1:] != other.shape[1:] or len(other) != 1:
        raise InputError(f"compare: shapes {values.shape} and {other.shape} have no ratio")
    cells, below = values.mean(axis=2), other.mean(axis=2)
    nan = float("nan")
    if not np.isfinite(cells).all() or not below.mean() > 0:
        return nan, nan, nan
    rows, columns = _draws(cells)
    lower = below[0][columns].mean(axis=(1, 2))
    mean = float(cells.mean() / below.mean())
    if cells.size == 1 or not (lower > 0).all():
        return mean, nan, nan
    return mean, *_percentiles(cells[rows, columns].mean(axis=(1, 2)) / lower)


def _draws(cells: Array) -> tuple[Whole, Whole]:
    """Rows (draws, seeds, 1) and columns (draws, 1, motions) of cells (seeds, motions).

    The same for every controller: differences are paired.
    """
    seeds, motions = cells.shape
    rng = np.random.default_rng(np.random.SeedSequence(_SEED))
    rows = rng.integers(seeds, size=(RESAMPLES, seeds))
    columns = rng.integers(motions, size=(RESAMPLES, motions))
    return rows[:, :, None], columns[:, None, :]


def _percentiles(means: Array) -> tuple[float, float]:
    tail = 50 * (1 - LEVEL)
    low, high = np.percentile(means, [tail, 100 - tail])
    return float(low), float(high)


def difference(values: Array, other: Array) -> Summary:
    """Of values less other, (seeds, motions, amplitudes) each, paired by motion and amplitude.

    Seeds of two trainings have nothing in common: they are drawn apart, and every one is set against every one of the
    other. Raises InputError where motions or amplitudes differ.
    """
    if values.shape[1:] != other.shape[1:]:
        raise InputError(f"compare: shapes {values.shape} and {other.shape} cannot be paired")
    if 1 in (len(values), len(other)):
        return summarise(values - other)
    every = values[:, None] - other[None]
    mean, worst = float(every.mean()), float(every.max())
    cells, less = values.mean(axis=2), other.mean(axis=2)
    if not (np.isfinite(cells).all() and np.isfinite(less).all()):
        return Summary(mean, worst, float("nan"), float("nan"))
    rows, columns = _draws(cells)
    rng = np.random.default_rng(np.random.SeedSequence([_SEED, 1]))  # apart from that of `_draws`
    others = rng.integers(len(less), size=(RESAMPLES, len(less)))[:, :, None]
    drawn = cells[rows, columns].mean(axis=(1, 2)) - less[others, columns].mean(axis=(1, 2))
    return Summary(mean, worst, *_percentiles(drawn))
