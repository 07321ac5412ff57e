"""Stage of an unknown cause: how well each stage's own variables predict the error on left-out records.

Each stage has three models of the nominal simulator's error:

- the nominal parameters and the stage's columns (`stage_columns`), by ridge regression on the other records;
- the nominal parameters alone, for an error that is random in time;
- one factor for each record, for an error that differs between records.

Their remainders are white noise. As far as none of them explains the error, an intermittent error of the stage counts
besides: its gain times an independent random factor in every window, which vanishes and changes sign with the gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrdamp.diagnosis.attribution.stage_columns import Columns, columns_of
from mrdamp.diagnosis.constants import (
    INDEPENDENT,
    NUMBER,
    RANDOM_PENALTY,
    RANDOM_STAGES,
    STAGE_TEMPER,
    WAVERING,
)
from mrdamp.diagnosis.evidence.resample import draws, seconds
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array

#: Ridge parameters as shares of a column's own square; every so many samples are fitted.
_RIDGES, _EVERY = (1e-3, 1e-2, 1e-1), 3
#: Prior of the nominal parameters relative to the whole square of the error.
_LAW_PRIOR = 3e-3
#: s, windows of an intermittent error (first: one sample, last: the record).
_WINDOWS = (0.0, 0.032, 0.128, np.inf)
#: Intermittent error: number of noise levels, sizes relative to the error, shares of the windows that contain
#: it.
_LEVELS, _SIZES, _SHARES = 7, np.geomspace(0.03, 30, 6), (0.15, 0.999)

_Groups = list[NDArray[np.intp]]


@dataclass(frozen=True, eq=False)
class StageEvidence:
    """Log evidence of the stages: values (1 + draws, stages) nats, of the records and of bootstrap draws of
    seconds."""

    stages: tuple[str, ...]
    values: Array

    @classmethod
    def of(cls, problem: Problem, noise: float, *, exact: bool = True) -> StageEvidence | None:
        """Evidence from the nominal simulator's error in a damper's last channel; None for another rig. noise: standard
        deviation, N. exact: the law is the rig's."""
        if not isinstance(problem.rig, DamperRig):
            return None
        errors = _Errors(problem)
        law = min((errors.left(None), errors.weighted), key=_cost)
        level = noise**2 * float(np.mean([u**2 for u in errors.units]))
        plain: dict[str, Array] = {}
        evidence: dict[str, Array] = {}
        costs = [_cost(law)]
        for name, own in columns_of(problem, problem.rig).items():
            stage = "sensor" if name == "reading" else name
            rare = 0.0 if name in RANDOM_STAGES else RANDOM_PENALTY
            models = (errors.left(own.columns), 0.0), (errors.by_record(own), NUMBER * len(own.gains) + rare)
            costs += [_cost(left) for left, _ in models]
            values = [INDEPENDENT * errors.white(left) - penalty for left, penalty in (*models, (law, rare))]
            best, wavers = np.max(values, axis=0), errors.wavering(own, level)
            evidence[stage] = np.maximum(best, evidence.get(stage, best))
            plain[stage] = np.maximum(wavers, plain.get(stage, wavers))
        unexplained = min(costs) / max(costs[0], 1e-30)
        for stage in evidence:
            rare = 0.0 if stage in RANDOM_STAGES else RANDOM_PENALTY
            evidence[stage] = evidence[stage] + unexplained * (WAVERING * plain[stage] - rare)
        return cls(tuple(evidence), np.column_stack(list(evidence.values())) / (1.0 if exact else STAGE_TEMPER))

    def at(self, draw: int | None = None) -> dict[str, float]:
        """Shares by stage, adding up to 1; of a bootstrap draw if its index is given."""
        row = self.values[0 if draw is None else 1 + draw]
        weights = np.exp(row - row.max())
        return dict(zip(self.stages, (weights / weights.sum()).tolist(), strict=True))


class _Errors:
    """Error (measured less simulated) in the last channel by record, weighted as the residuals are."""

    def __init__(self, problem: Problem) -> None:
        last = len(problem.rig.channels) - 1
        self._spans = [b.span for b in problem.blocks if b.channel == last]
        nominal = Hypothesis(problem.rig.nominal)
        at = np.zeros(len(problem.rig.nominal))
        residual = problem.residuals(nominal, at)[0]
        jacobian = problem.jacobian(nominal, at, residual)
        self._weights = [problem.weights[s] for s in self._spans]
        self._law = [jacobian[s] for s in self._spans]
        self.weighted = [-residual[s] for s in self._spans]
        #: Factors from an error in N to an error relative to its record's size.
        self.units = [float(w[0]) * np.sqrt(len(w)) for w in self._weights]
        self._prior = _LAW_PRIOR * _cost(self.weighted) * (nominal.prior() ** 2 + 1e-9)
        self._times = [problem.rig.records[k].sample_time * problem.stride for k in problem.records]
        groups = seconds(problem)
        self._seconds: _Groups = [groups[s] for s in self._spans]
        self._drawn = draws(int(groups.max()) + 1)

    def left(self, columns: Sequence[Array] | None) -> list[Array]:
        """Remainder of each record after regression on columns and nominal parameters, fitted to the other
        records; best ridge."""
        tables = self._law
        if columns is not None:
            own = zip(self._weights, columns, self._law, strict=True)
            tables = [np.hstack([w[:, None] * c, law]) for w, c, law in own]
        count = tables[0].shape[1] - self._law[0].shape[1]
        thin = [(t[::_EVERY], e[::_EVERY]) for t, e in zip(tables, self.weighted, strict=True)]
        grams, moments = [_EVERY * t.T @ t for t, _ in thin], [_EVERY * t.T @ e for t, e in thin]
        gram, moment = sum(grams), sum(moments)
        found = []
        for ridge in _RIDGES if count else _RIDGES[:1]:
            ridges = np.concatenate([ridge * np.diag(gram)[:count], self._prior])
            left = []
            for g, m, t, e in zip(grams, moments, tables, self.weighted, strict=True):
                a = gram - g + np.diag(ridges + 1e-10 * np.trace(gram) / len(ridges) + 1e-300)
                left.append(e - t @ np.linalg.solve(a, moment - m))
            found.append(left)
        return min(found, key=_cost)

    def by_record(self, own: Columns) -> list[Array]:
        """Remainder after one factor for each record times the best of the stage's gains."""
        found = []
        for kind in range(len(own.gains[0])):
            gains = [g[kind] for g in own.gains]
            scale = [
                float(e @ g) / max(float(g @ g), 1e-30) for e, g in zip(self.weighted, gains, strict=True)
            ]
            found.append([e - c * g for e, c, g in zip(self.weighted, scale, gains, strict=True)])
        return min(found, key=_cost)

    def white(self, left: Sequence[Array]) -> Array:
        """Mean log likelihood (1 + draws,) of a model's remainder as white noise."""
        count = self._drawn.shape[1]
        parts = [np.concatenate([len(e) * e**2 for e in left]), np.ones(sum(map(len, left)))]
        second = np.concatenate(self._seconds)
        squares, counts = (self._draw(np.bincount(second, p, minlength=count).astype(float)) for p in parts)
        return -0.5 * np.log(np.maximum(squares / counts, 1e-30)) - 0.5

    def wavering(self, own: Columns, level: float) -> Array:
        """Mean log likelihood (1 + draws,) of the error as an intermittent one with the best of the stage's gains."""
        errors = [e * np.sqrt(len(e)) for e in self.weighted]
        means = []
        for kind in range(len(own.gains[0])):
            gains = [u * g[kind] for u, g in zip(self.units, own.gains, strict=True)]
            values, samples = wavering(errors, gains, self._times, level, self._seconds, self._drawn.shape[1])
            means.append(self._draw(values) / np.maximum(self._draw(samples), 1e-30))
        return np.asarray(np.max(means, axis=0))

    def _draw(self, sums: Array) -> Array:
        """Sums (seconds,): over all seconds, then in each draw (1 + draws,)."""
        return np.concatenate([[sums.sum()], self._drawn @ sums])


def wavering(
    errors: Sequence[Array],
    gains: Sequence[Array],
    times: Sequence[float],
    level: float,
    groups: _Groups,
    count: int,
) -> tuple[Array, Array]:
    """Log likelihood of an intermittent error in white noise, maximised over window, size and share.

    errors, gains: (n,) of each record. The error in a window is the gain times an independent normal factor;
    it may be absent from a window. level: least variance of the white noise. Returns sums by group and their
    numbers of samples, (groups,) each.
    """
    best = -np.inf
    values: Array = np.zeros(count)
    samples: Array = np.zeros(count)
    for window in _WINDOWS:
        rows = []
        for e, g, dt, group in zip(errors, gains, times, groups, strict=True):
            n = round(min(max(window / dt, 1.0), len(e)))
            cut = slice(0, len(e) // n * n)
            a, b = e[cut].reshape(-1, n), g[cut].reshape(-1, n)
            sums = ((a * a).sum(1), (a * b).sum(1), (b * b).sum(1))
            rows.append(np.column_stack([*sums, np.full(len(a), float(n)), group[cut][::n]]))
        ee, eg, gg, n, group = np.concatenate(rows).T
        mean = float(ee.sum() / n.sum())
        unit = mean / max(float(gg.sum() / n.sum()), 1e-30)
        low = max(level, 1e-9 * mean, 1e-30)
        for rest in np.geomspace(low, max(mean, 1.1 * low), _LEVELS):
            still = -0.5 * (n * np.log(rest) + ee / rest)
            tried = [still]
            for size in _SIZES * unit:
                known = eg**2 * size / (rest + size * gg)
                moved = -0.5 * (n * np.log(rest) + np.log1p(size * gg / rest) + (ee - known) / rest)
                tried += [np.logaddexp(np.log1p(-p) + still, np.log(p) + moved) for p in _SHARES]
            top = max(tried, key=lambda v: float(v.sum()))
            if float(top.sum() / n.sum()) > best:
                best = float(top.sum() / n.sum())
                number = group.astype(np.intp)
                values = np.asarray(np.bincount(number, top, minlength=count), dtype=float)
                samples = np.asarray(np.bincount(number, n, minlength=count), dtype=float)
    return values, samples


def _cost(parts: Sequence[Array]) -> float:
    return sum(float(e @ e) for e in parts)
