"""How far controllers go from a constant command towards what the best commands found reach."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mrdamp.compare.comparison import Comparison
from mrdamp.compare.summary import Summary, ratio
from mrdamp.errors import InputError
from mrdamp.model.core import Array


def share(result: Comparison, contender: str, bound: str) -> Summary:
    """Of the way from the base to a bound in what the bound makes small: 0 as the base, 1 as the bound.

    A ratio of means over all runs, with its interval over loads and seeds; worst: the least of a load. NaN where the
    bound is no better than the base.
    """
    gone, way = _way(result, contender, bound)
    mean, low, high = ratio(gone, way)
    return Summary(mean, float(np.nanmin(by_load(result, contender, bound), initial=np.inf)), low, high)


def least(judged: Sequence[Mapping[str, float]], weights: Mapping[str, float]) -> Mapping[str, float]:
    """Measures of the run with the least weighted sum of them."""
    return min(judged, key=lambda values: sum(w * values[key] for key, w in weights.items()))


def by_load(result: Comparison, contender: str, bound: str) -> Array:
    """(loads,) the share under each load, all amplitudes and seeds together."""
    gone, way = _way(result, contender, bound)
    long = way.mean(axis=(0, 2))
    some = np.where(long > 0, long, np.nan)
    return np.asarray(gone.mean(axis=(0, 2)) / some)


def start_of_way(result: Comparison) -> str:
    """The contender that is the base. Raises InputError."""
    for c in result.contenders:
        if c.specs == (result.base,):
            return c.name
    raise InputError(f"compare: a bound needs {result.base} among the controllers; add it")


def _way(result: Comparison, contender: str, bound: str) -> tuple[Array, Array]:
    """What a contender gains over the base, (seeds, loads, amplitudes), and what the bound does, (1, ...)."""
    weights = result.bounds[bound]
    on = score(result, start_of_way(result), weights)
    return on - score(result, contender, weights), on - score(result, bound, weights)


def score(result: Comparison, contender: str, weights: Mapping[str, float]) -> Array:
    return np.asarray(sum(w * result.values[contender][key] for key, w in weights.items()))
