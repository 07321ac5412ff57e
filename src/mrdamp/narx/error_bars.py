"""How far a network can be trusted on an input: error bars of its free run, and inputs outside its training range.

With few records a network is free to do anything between and beyond them. Its posterior shows that: the variance of
the free-run force is g' H^-1 g, g its derivatives by the weights and H the Hessian of the training objective
(MacKay, Neural Computation 4 (1992) 448-472, doi 10.1162/neco.1992.4.3.448). The noise of the force is not in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from mrdamp.identify import RecordError
from mrdamp.model.core import Array
from mrdamp.narx.bayes import Posterior
from mrdamp.narx.data import Series
from mrdamp.narx.network import Network
from mrdamp.narx.problems import FreeRun

#: Records do not suffice where the free-run error of the middle record among others is so many times theirs.
_WORSE = 2.0
#: Signs that go with it: error bars so many times the usual ones, and an input this share beyond its range.
_DOUBTFUL, _OUTSIDE = 3.0, 0.2


@dataclass(frozen=True, eq=False)
class ErrorBars:
    """Of a free run over one part.

    record: its name. deviation: (n,) N, standard deviation of the force as far as the weights are uncertain. share: RMS
    of it over the standard deviation of the measured force; it ranks records rather than bounding their errors: errors
    of one sign in a row count as independent in H, so the true error may be several times as large. outside: channel ->
    how far it leaves the training range, over half of that range; 0 within.
    """

    record: str
    deviation: Array
    share: float
    outside: dict[str, float]


def error_bars(network: Network, posterior: Posterior, s: Series, most: int = 3000) -> ErrorBars:
    """Error bars of the free run from rest over the first `most` samples of a part.

    network: with the weights of the posterior, none of them pruned. posterior: from training in free run.
    """
    part = s.part(0, min(s.n, most))
    problem = FreeRun.of(network, [part], None)
    _, jacobian = problem.sensitivities(posterior.theta)
    factor = linalg.cholesky(posterior.hessian, lower=True)
    rows = linalg.solve_triangular(factor, jacobian[:, 0].T, lower=True)
    deviation = np.sqrt(np.sum(rows**2, axis=0)) * abs(network.force_scale)
    scaled = network.scaled(part.regressors(network.inputs)[network.max_lag :])
    outside: dict[str, float] = {}
    for k, (channel, _) in enumerate(network.inputs):
        over = max(0.0, float(np.max(np.abs(scaled[:, k]))) - 1.0)
        outside[channel] = max(over, outside.get(channel, 0.0))
    share = float(np.sqrt(np.mean(deviation**2)) / np.std(part.force))
    return ErrorBars(s.name, deviation, share, outside)


@dataclass(frozen=True)
class Sufficiency:
    """Whether others are predicted as well as the training records, and by which sign, in one line."""

    suffice: bool
    why: str


def sufficiency(
    network: Network,
    posterior: Posterior,
    train: Sequence[Series],
    others: Sequence[Series],
    fitted: Sequence[RecordError],
    new: Sequence[RecordError],
) -> Sufficiency:
    """Judges the training records by the free-run errors on others, and names the signs in the posterior.

    The errors decide: by the middle record of each side, as one odd record does not characterise the set. The
    posterior's error bars and inputs beyond their training range need no measured force and say where to measure.

    network, posterior: as for `error_bars`. train, others: parts. fitted, new: free-run errors on them.
    """
    before, after = (float(np.median([e.nrmse for e in errors])) for errors in (fitted, new))
    suffice = after <= _WORSE * before
    usual = float(np.median([error_bars(network, posterior, s).share for s in train]))
    found = [error_bars(network, posterior, s) for s in others]
    worst = max(found, key=lambda d: d.share)
    over, channel, record = max((over, c, d.record) for d in found for c, over in d.outside.items())
    signs = [f"free-run error of the middle record {before:.3f} among them, {after:.3f} among others"]
    if worst.share > _DOUBTFUL * usual:
        signs.append(
            f"error bars from the weights' uncertainty are widest in {worst.record}"
            f" ({worst.share / usual:.0f} times the training records')"
        )
    if over > _OUTSIDE:
        signs.append(f"{channel} leaves its training range most in {record} (by {100 * over:.0f} %)")
    return Sufficiency(suffice, "; ".join(signs))
