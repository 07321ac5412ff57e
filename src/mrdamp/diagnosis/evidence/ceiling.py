"""Predictable share of a residual: ridge regression on random features, evaluated on left-out records.

Features are causal: motion, command and simulated force, their lags, first-order filters of them, the stroke
since the last reversal and the dissipated energy. Random Fourier features (Rahimi, Recht 2007) make the ridge
nonparametric. Whole records are left out, so that noise or trends of a record are not learnt.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array
from mrdamp.records.motion import stroke_since_reversal
from mrdamp.records.sampling import memory

#: Number of random features; ridge parameter over the number of samples.
_WIDTH, _RIDGES = 240, (1e-4, 1e-2, 1.0)
#: s, time constants of first-order filters.
_MEMORIES = (0.01, 0.05, 0.5)
_SEED = 7
#: Every so many samples are fitted.
_STRIDE = 2


def features(
    inputs: Sequence[Array], force: Array, velocity: Array, sample_time: float, stroke: Array
) -> Array:
    """Feature table (n, features). inputs: motion, velocity, command, ... of the record; force: the simulated
    force."""
    columns = [*inputs, force, stroke]
    for x in (*inputs, force):
        columns += [memory(x, sample_time, tau) for tau in _MEMORIES]
    columns.append(np.cumsum(np.abs(force * velocity)) * sample_time)
    return np.column_stack(columns)


def of_fit(problem: Problem, residual: Array, floor: float) -> float:
    """Predictable share of a fit's weighted residuals (samples,), from the rig's inputs and its simulated output.

    floor: sum of squares of the weighted residuals due to noise. Each channel of a record is a separate
    series.
    """
    tables, left, weights = [], [], []
    simulated = residual / problem.weights + problem.measured()
    for b in problem.blocks:
        record = problem.rig.records[b.record]
        conditions = problem.rig.conditions(b.record)
        taken, dt = problem.taken(b.record), record.sample_time * problem.stride
        inputs = [v[taken] for v in conditions.values()]
        motion = next((v for name, v in conditions.items() if name.startswith("displacement")), inputs[0])
        speed = next((v for name, v in conditions.items() if name.startswith("velocity")), inputs[0])
        stroke = stroke_since_reversal(motion, 0.01 * float(np.std(motion)))[taken]
        answer = simulated[b.span]
        channel = np.zeros((len(answer), len(problem.rig.channels)))
        channel[:, b.channel] = 1.0
        table = features(inputs, answer, speed[taken], dt, stroke)
        tables.append(np.hstack([table, channel]))
        left.append(residual[b.span] / problem.weights[b.span] / b.size)
        weights.append(problem.weights[b.span] * b.size)
    groups = [b.record for b in problem.blocks]
    return ceiling(tables, left, weights, floor, groups)


def ceiling(
    tables: Sequence[Array],
    residuals: Sequence[Array],
    weights: Sequence[Array],
    noise: float,
    groups: Sequence[int],
) -> float:
    """Predictable share (0 to 1) of the sum of squares of weighted residuals (series), from feature tables
    (n, features) of each.

    noise: sum of squares due to noise, which cannot be predicted and is excluded. groups: number of the
    record of each series; the series of a record are left out together.
    """
    mean = np.mean(np.vstack([t[::_STRIDE] for t in tables]), axis=0)
    scale = np.std(np.vstack([t[::_STRIDE] for t in tables]), axis=0)
    scale[scale == 0] = 1.0
    rng = np.random.default_rng(_SEED)
    width = tables[0].shape[1]
    # Each feature has few inputs: interactions of all of them cannot be learnt from few records.
    mask = rng.random((width, _WIDTH)) < 3.0 / width
    w = rng.standard_normal((width, _WIDTH)) * mask
    phase = rng.uniform(0, 2 * np.pi, _WIDTH)
    maps = []
    for t in tables:
        z = np.clip((t - mean) / scale, -4, 4)
        maps.append(np.column_stack([np.ones(len(z)), z, np.cos(z @ w + phase)]))
    total = sum(float(np.sum((weight * r) ** 2)) for weight, r in zip(weights, residuals, strict=True))
    best = total
    parts = []
    for m, r, weight in zip(maps, residuals, weights, strict=True):
        rows = weight[::_STRIDE, None] * m[::_STRIDE]
        parts.append((rows.T @ rows, rows.T @ (weight * r)[::_STRIDE]))
    gram, moment = sum(p[0] for p in parts), sum(p[1] for p in parts)
    for ridge in _RIDGES:
        solved: dict[int, Array] = {}
        for group in dict.fromkeys(groups):
            own = [p for p, g in zip(parts, groups, strict=True) if g == group]
            a = gram - sum(p[0] for p in own) + ridge * np.diag(np.diag(gram))
            a = a + 1e-12 * np.trace(gram) * np.eye(len(gram))
            solved[group] = np.linalg.solve(a, moment - sum(p[1] for p in own))
        series = zip(maps, residuals, weights, groups, strict=True)
        left = sum(float(np.sum((weight * (r - m @ solved[g])) ** 2)) for m, r, weight, g in series)
        best = min(best, left)
    return float(np.clip((total - best) / max(total - noise, 1e-30), 0.0, 1.0))
