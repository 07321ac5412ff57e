"""Cost of a fit whose law is not the rig's, from the costs of its records."""

from __future__ import annotations

import numpy as np

from mrdamp.diagnosis.constants import RECORD_VARIANCE
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.table import FitTable
from mrdamp.model.core import Array


def over_records(table: FitTable, costs: Array) -> float:
    """Cost of the nominal simulator times the geometric mean, over the records, of the ratio to it.

    costs: of each record. The variance of a wrong law's error differs between records and is unknown. The likelihood of
    Gaussian errors, marginal over variances with an inverse-gamma prior of scale RECORD_VARIANCE times the mean, is a
    power of this mean. In a sum, records that a cause cannot affect would hide what it does in the others.
    Source: Gelman et al. (2013), Bayesian Data Analysis, section 3.2.
    """
    nominal = table.problem.costs(table.problem.gaps(table.residual))
    scale = RECORD_VARIANCE * float(np.mean(nominal))
    return table.nominal_cost * float(np.exp(np.mean(np.log((costs + scale) / (nominal + scale)))))


def own_cost(table: FitTable, found: Fit) -> float:
    """`over_records` on the records that a fit was fitted to."""
    return over_records(table, table.problem.costs(table.problem.gaps(found.residual)))
