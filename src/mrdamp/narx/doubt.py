"""How far a network can be trusted on an input: error bars of its free run, and inputs outside its training range.

With few records a network is free to do anything between and beyond them. Its posterior shows that: the variance of
the free-run force is g' H^-1 g, g its derivatives by the weights and H the Hessian of the training objective
(MacKay, Neural Computation 4 (1992) 448-472, doi 10.1162/neco.1992.4.3.448). The noise of the force is not in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from mrdamp.core import Array
from mrdamp.narx.bayes import Posterior
from mrdamp.narx.data import Series
from mrdamp.narx.network import Network
from mrdamp.narx.problems import FreeRun


@dataclass(frozen=True, eq=False)
class Doubt:
    """Of a free run over one stretch.

    Attributes:
        record: its name.
        deviation: (n,) N, standard deviation of the force as far as the weights are uncertain.
        share: RMS of it over the standard deviation of the measured force. It ranks records rather than bounding
            their errors: errors of one sign in a row count as independent in H, so the true error may be several
            times as large. Where it is many times that of the training records, these do not suffice.
        outside: channel -> how far it leaves the training range, over half of that range; 0 within.
    """

    record: str
    deviation: Array
    share: float
    outside: dict[str, float]


def doubt(network: Network, posterior: Posterior, s: Series, most: int = 3000) -> Doubt:
    """Error bars of the free run from rest over the first `most` samples of a stretch.

    Args:
        network: with the weights of the posterior, none of them pruned.
        posterior: from training in free run; its alpha and beta are in scaled units.
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
    return Doubt(s.name, deviation, share, outside)
