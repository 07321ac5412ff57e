"""How far the law itself is from the rig's: what the best simulator misses where it misses least.

A fault acts in some regimes and spares others, where an exact law then meets the noise. A law that is not the rig's
misses everywhere.
"""

from __future__ import annotations

import numpy as np

from mrdamp.core import Array
from mrdamp.diagnosis.problem.residuals import Problem

#: s, of a window; share of the windows that the best ones are.
_WINDOW, _BEST = 0.25, 0.1


def least_misfit(problem: Problem, residual: Array, floor: Array) -> float:
    """RMS error over the noise in the tenth of all windows in which it is least.

    residual (samples,): weighted; floor (blocks,): gaps that noise alone leaves. About one: the law meets the noise
    somewhere, and what it misses elsewhere is a fault.
    """
    ratios = []
    for b, level in zip(problem.blocks, floor, strict=True):
        error = residual[b.span] / problem.weights[b.span]
        step = problem.rig.records[b.record].sample_time * problem.stride
        n = max(min(round(_WINDOW / step), len(error)), 4)
        windows = error[: len(error) // n * n].reshape(-1, n)
        if len(windows):
            ratios.append(np.sqrt(np.mean(windows**2, axis=1)) / max(level * b.size, 1e-12))
    return float(np.quantile(np.concatenate(ratios), _BEST)) if ratios else 1.0
