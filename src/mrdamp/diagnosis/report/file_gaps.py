"""Gaps of the written files: every reported figure is computed again with the files."""

from __future__ import annotations

import numpy as np

from mrdamp.diagnosis.problem.residuals import Problem, compared
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.predict import free_run

#: Largest difference between the gap of the fit and that of the file, as a share of the measurement's RMS.
AGREEMENT = 0.01


def predicted_gap(model: Model, problem: Problem) -> float:
    """RMS error over the measurement's RMS, by the path of `mrdamp predict`; records and channels have equal
    weight."""
    rig = problem.rig
    squares = []
    for k in problem.records:
        try:
            channels = rig.compared(free_run(model, rig.driven(k)), k)
        except InputError:
            return float("nan")
        measured = rig.measured(k)
        keep = compared(rig.records[k].n, rig.records[k].sample_time)
        squares += [_square(one[keep], other[keep]) for one, other in zip(channels, measured, strict=True)]
    return float(np.sqrt(np.mean(squares)))


def _square(simulated: Array, measured: Array) -> float:
    return float(np.mean((simulated - measured) ** 2)) / (float(np.mean(measured**2)) or 1.0)
