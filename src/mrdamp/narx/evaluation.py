"""Errors of a network on parts: one step ahead, the self-sensing paper's way, and in free run, a simulator's.

Both are always reported together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.identify import RecordError, pooled
from mrdamp.model import core
from mrdamp.model.core import Array
from mrdamp.narx.data import Series
from mrdamp.narx.network import Network

_REST = 5.0  # s at rest
START = 0.02  # s of a free run that do not count, where the unknown start fades, as in `mrdamp.identify`


@dataclass(frozen=True)
class Evaluation:
    """Errors of one network by part, one step ahead or in free run."""

    train: tuple[RecordError, ...]
    validation: tuple[RecordError, ...]
    test: tuple[RecordError, ...]

    @property
    def pooled(self) -> tuple[float, float, float]:
        """RMS error over the standard deviation: training, validation, test; NaN for none."""
        return pooled(self.train), pooled(self.validation), pooled(self.test)


def one_step_force(network: Network, s: Series) -> Array:
    """Force (n - max_lag,) N predicted one step ahead of measured forces."""
    return network.forward(s.regressors(network.inputs)[network.max_lag :])


def free_run_force(network: Network, s: Series) -> Array:
    """Force (n,) N in free run through the C entry, from the plugin's start."""
    return core.run("narx", {}, s.sample_time, s.x, s.v, u=s.i, narx=core.Narx(network.to_text()))["force"]


def force_at_rest(network: Network, parts: Sequence[Series]) -> list[tuple[float, float]]:
    """(command, force N) that a rod at rest in the middle of its stroke is pushed with, at the least and most command.

    0 but for a preload; where no record holds a rest, a network may settle anywhere.
    """
    ends = np.array([[f(getattr(s, name)) for s in parts] for name in "xi" for f in (np.min, np.max)])
    x, n = (ends[0].min() + ends[1].max()) / 2, round(_REST / network.sample_time)
    out = []
    for u in sorted({float(ends[2].min()), float(ends[3].max())}):
        still = Series("rest", network.sample_time, np.full(n, x), np.zeros(n), np.full(n, u), np.zeros(n))
        out.append((u, float(free_run_force(network, still)[-1])))
    return out


def one_step_error(network: Network, s: Series) -> RecordError:
    """One step ahead, over the samples whose lags are all measured."""
    return _error(s.name, one_step_force(network, s), s.force[network.max_lag :])


def free_run_error(network: Network, s: Series) -> RecordError:
    """In free run; the first 20 ms do not count."""
    skip = min(s.n // 4, int(START / s.sample_time))
    return _error(s.name, free_run_force(network, s)[skip:], s.force[skip:])


def evaluate(
    network: Network, train: Sequence[Series], validation: Sequence[Series] = (), test: Sequence[Series] = ()
) -> tuple[Evaluation, Evaluation]:
    one, free = (
        Evaluation(*(tuple(error(network, s) for s in part) for part in (train, validation, test)))
        for error in (one_step_error, free_run_error)
    )
    return one, free


def _error(name: str, force: Array, measured: Array) -> RecordError:
    with np.errstate(over="ignore", invalid="ignore"):
        rmse = float(np.sqrt(np.mean((force - measured) ** 2)))
    rmse = rmse if np.isfinite(rmse) else float("inf")  # a run away
    return RecordError(name, rmse, rmse / float(np.std(measured)))
