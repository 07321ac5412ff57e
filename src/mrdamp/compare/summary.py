"""Means, worst cases and bootstrap intervals over motions and seeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrdamp.errors import InputError
from mrdamp.model.core import Array

RESAMPLES = 2000
LEVEL = 0.95


@dataclass(frozen=True)
class Summary:
    """Of one measure of one controller: mean and largest value, and the mean's interval (95 %)."""

    mean: float
    worst: float
    low: float
    high: float


def summarise(values: Array, seed: int = 0) -> Summary:
    """values (seeds, motions, amplitudes); motions and, where there are several, seeds are drawn with replacement.

    The amplitudes of a motion stay together: they are chosen, not drawn. With one motion and one seed there is no
    interval (NaN).
    """
    if values.ndim != 3 or not values.size:
        raise InputError(f"compare: values have shape {values.shape}; allowed: (seeds, motions, amplitudes)")
    low, high = interval(values, seed)
    return Summary(float(values.mean()), float(values.max()), low, high)


def interval(values: Array, seed: int = 0) -> tuple[float, float]:
    """Percentile interval of the mean of values (seeds, motions, amplitudes)."""
    cells = values.mean(axis=2)
    seeds, motions = cells.shape
    if not np.isfinite(cells).all() or seeds * motions == 1:
        return float("nan"), float("nan")
    # The same draws for every controller: their differences are paired.
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    rows = rng.integers(seeds, size=(RESAMPLES, seeds))
    columns = rng.integers(motions, size=(RESAMPLES, motions))
    means = cells[rows[:, :, None], columns[:, None, :]].mean(axis=(1, 2))
    tail = 50 * (1 - LEVEL)
    low, high = np.percentile(means, [tail, 100 - tail])
    return float(low), float(high)


def difference(values: Array, other: Array, seed: int = 0) -> Summary:
    """Of values less other, run by run; a single seed of the one is compared with every seed of the other."""
    paired = len(values) == len(other) or 1 in (len(values), len(other))
    if values.shape[1:] != other.shape[1:] or not paired:
        raise InputError(f"compare: shapes {values.shape} and {other.shape} cannot be paired")
    return summarise(values - other, seed)
