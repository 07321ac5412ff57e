"""How well records fix the parameters of a fit: bootstrap intervals, and what they do not determine.

The bootstrap resamples whole records (or blocks in time where there are few) with their residuals, as residuals of
a damper model are correlated over whole periods (Kuensch 1989, doi:10.1214/aos/1176347265). Each resample is fitted
by one Gauss-Newton step within the bounds, or, on request, by a fit of its own from the optimum.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import lsq_linear
from scipy.stats import norm, t

from mrdamp.errors import InputError
from mrdamp.identify import Fit, Problem, simulate
from mrdamp.identify.laws import Coordinate, Space
from mrdamp.identify.least_squares import bounded_least_squares
from mrdamp.model import core
from mrdamp.model.core import Array
from mrdamp.parallel import mapped
from mrdamp.records import Record

#: Below so many records, blocks in time are resampled in place of records.
_FEW_RECORDS = 8
_BLOCKS = 40
#: A coordinate whose whole range moves the force by less than this share of its deviation is not seen.
_SEEN = 0.003
_TIED = 0.98


@dataclass(frozen=True)
class Interval:
    """A parameter: value, 95 % interval and unit; `word` gives the reason if it is not identifiable, else empty."""

    name: str
    value: float
    low: float
    high: float
    unit: str
    word: str = ""


@dataclass(frozen=True)
class ChannelFinding:
    """Information of a record's residual on its channels: force offset (N) and delay of the force (s), left over.

    Both with a standard error that allows for correlated residuals, and with their share of the squared residual.
    """

    record: str
    offset: float
    offset_error: float
    delay: float
    delay_error: float
    offset_share: float = 1.0
    delay_share: float = 1.0


def intervals(
    fit: Fit,
    train: Sequence[Record],
    *,
    resamples: int = 200,
    refit: bool = False,
    block: float | None = None,
    seed: int = 0,
    workers: int = 1,
) -> tuple[Interval, ...]:
    """95 % intervals of every fitted attribute, from a bootstrap over records or blocks.

    block (s): length of the blocks; None: whole records, or 40 blocks where there are fewer than 8 records.
    refit: fit each resample rather than one Gauss-Newton step (slower, and right where the model is far from
    linear). The same seed gives the same answer for any number of workers. Raises InputError.
    """
    if fit.space is None:
        raise InputError("this fit holds no search space (it was read from a file); fit again for intervals")
    problem = Problem(fit.space, train, 1)
    n, point = len(fit.point), _whole(fit, problem)
    parts = _blocks(problem, block)
    residual = problem.residuals(point[None])[0]
    jacobian = problem.jacobian(point, residual)
    late = [
        (k, max(r.sample_time for r in train) / (c.high - c.low))
        for k, c in enumerate(fit.space.coordinates)
        if c.name == "command_delay_d" and problem.hold
    ]
    for k, sample in late:
        # A held command is late by whole samples: the force follows its delay in steps, which have no slope.
        ends = np.clip(point + sample * np.eye(len(point))[k] * [[-1], [1]], 0, 1)
        before, after = problem.residuals(ends)
        jacobian[:, k] = (after - before) / np.ptp(ends[:, k])
        residual = residual - jacobian @ np.linalg.lstsq(jacobian, residual)[0]
    rng = np.random.default_rng(seed)
    counts = rng.multinomial(len(parts), np.full(len(parts), 1 / len(parts)), resamples)
    if refit:
        found = mapped(_refitted, [(fit, train, parts, row, point) for row in counts], workers)
    else:
        normal = [(jacobian[p].T @ jacobian[p], jacobian[p].T @ residual[p]) for p in parts]
        found = mapped(_stepped, [(normal, row, point) for row in counts], workers)
    points = point + few_groups(len(parts)) * (np.array(list(found)) - point)
    for k, sample in late:  # nor is it known within a sample
        points[:, k] += sample * (-1.0) ** np.arange(resamples)
    points = np.clip(points, 0, 1)[:, :n]
    return _attributes(fit, fit.space, points, _words(fit, fit.space.coordinates, points, jacobian))


def few_groups(count: int) -> float:
    """Factor on the scatter of a bootstrap over `count` groups: their sample variance has count - 1 degrees of freedom.

    Source: Cameron, Gelbach & Miller (2008), doi:10.1162/rest.90.3.414, section II (t of G - 1 degrees, G / (G - 1)).
    """
    return float(np.sqrt(count / (count - 1)) * t.ppf(0.975, count - 1) / norm.ppf(0.975))


def _whole(fit: Fit, problem: Problem) -> Array:
    """The point of a fit in the problem (size,), with the starts that it found."""
    records = [record for record, *_ in problem.records]
    problem.hold = bool(fit.model.hold)
    problem.led = [record.name in fit.started for record in records]
    problem.freed = problem.freed and any(fit.started.values())
    point = problem.begin(np.asarray(fit.point))
    for i, k in enumerate(problem.free):
        point[len(fit.point) + i] += fit.started[records[k].name] / (
            2 * float(np.ptp(records[k].displacement))
        )
    return point


def channel_findings(fit: Fit, records: Sequence[Record]) -> tuple[ChannelFinding, ...]:
    """Offset and constant delay that each record's residual still holds after the fit, by linear regression.

    delay > 0: the measured force is late against the model, so the displacement channel is early.
    """
    out = []
    for record in records:
        force = simulate(fit.model, record, fit.started.get(record.name, 0.0))
        residual = record.channel("force_N") - force
        slope = np.gradient(force, record.sample_time)
        columns = np.column_stack([np.ones(record.n), -slope])
        inverse = np.linalg.pinv(columns.T @ columns)
        found = inverse @ columns.T @ residual
        left = residual - columns @ found
        # Blocks of a tenth of the record stand for independent samples.
        scores = [columns[p].T @ left[p] for p in np.array_split(np.arange(record.n), 10)]
        covariance = inverse @ sum(np.outer(s, s) for s in scores) @ inverse
        error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        numbers = [float(x) for pair in zip(found, error, strict=True) for x in pair]
        shares = np.mean((columns * found) ** 2, axis=0) / np.mean(residual**2)
        out.append(ChannelFinding(record.name, *numbers, *map(float, shares)))
    return tuple(out)


def _blocks(problem: Problem, block: float | None) -> list[slice]:
    """Slices of the residuals that are resampled as one."""
    whole = problem.slices
    if block is None and len(whole) >= _FEW_RECORDS:
        return whole
    out = []
    for part, (record, *_) in zip(whole, problem.records, strict=True):
        size = part.stop - part.start
        length = (block or sum(r.duration for r, *_ in problem.records) / _BLOCKS) / record.sample_time
        ends = np.linspace(part.start, part.stop, max(1, round(size / max(length, 1))) + 1).astype(int)
        out += [slice(int(a), int(b)) for a, b in pairwise(ends)]
    if len(out) < 4:
        raise InputError(
            f"{len(out)} blocks are too few for intervals; give shorter ones (at least 4 are needed)"
        )
    return out


def _stepped(normal: Sequence[tuple[Array, Array]], counts: Array, point: Array) -> Array:
    """The point of a resample by one Gauss-Newton step within the unit cube."""
    matrix = sum(
        (c * a for c, (a, _) in zip(counts, normal, strict=True)), np.zeros((len(point), len(point)))
    )
    # The step that the whole set would still make is no scatter: it is taken off.
    vector = sum(((c - 1.0) * b for c, (_, b) in zip(counts, normal, strict=True)), np.zeros(len(point)))
    values, vectors = np.linalg.eigh(matrix)
    root = np.sqrt(np.maximum(values, 1e-9 * values.max()))
    lower, upper = -point - 1e-12, 1 - point + 1e-12
    solution = lsq_linear((vectors * root).T, -(vectors.T @ vector) / root, bounds=(lower, upper))
    return np.asarray(np.clip(point + solution.x, 0, 1))


def _refitted(
    fit: Fit, records: Sequence[Record], parts: Sequence[slice], counts: Array, point: Array
) -> Array:
    """The point of a resample by a fit of its own from the optimum."""
    assert fit.space is not None
    problem = Problem(fit.space, records, 1)
    _whole(fit, problem)
    weight = np.concatenate(
        [np.full(p.stop - p.start, np.sqrt(c)) for p, c in zip(parts, counts, strict=True)]
    )
    # The residual handed on is weighted, by 0 where a block is left out: the Jacobian needs the plain one.
    solution = bounded_least_squares(
        lambda p: weight * problem.residuals(p[None])[0],
        lambda p, _: weight[:, None] * problem.jacobian(p, problem.residuals(p[None])[0]),
        np.clip(point, 1e-6, 1 - 1e-6),
        bounds=(0, 1),
        most=8,
        ftol=1e-5,
        xtol=1e-5,
    )
    return np.asarray(solution.x)


def _words(fit: Fit, coordinates: Sequence[Coordinate], points: Array, jacobian: Array) -> dict[str, str]:
    """Coordinate -> why these records do not fix it."""
    n, size = len(coordinates), np.linalg.norm(jacobian, axis=0)
    covariance = np.linalg.pinv(jacobian.T @ jacobian + 1e-12 * np.eye(len(size)) * size.max() ** 2)[:n, :n]
    size, spread = size[:n], np.sqrt(np.diag(covariance))
    tied = covariance / np.outer(spread, spread)
    out: dict[str, str] = {}
    for k, coordinate in enumerate(coordinates):
        low, high = np.percentile(points[:, k], [2.5, 97.5])
        others = np.abs(tied[k]) * (np.arange(n) != k)
        partner = int(np.argmax(others))
        if size[k] < _SEEN:
            out[coordinate.name] = "these records do not show it"
        elif n > 1 and others[partner] > _TIED:
            out[coordinate.name] = f"only together with {coordinates[partner].name}"
        elif high - low > 0.6:
            out[coordinate.name] = "its interval is as wide as its range"
        elif min(fit.point[k], 1 - fit.point[k]) < 1e-4 and not (coordinate.low == 0 and fit.point[k] < 0.5):
            out[coordinate.name] = "at the end of its range"
    return out


def _attributes(fit: Fit, space: Space, points: Array, words: dict[str, str]) -> tuple[Interval, ...]:
    """Intervals of the attributes that the coordinates make."""
    made = [space.attributes(p) for p in points]
    value = space.attributes(np.asarray(fit.point))
    units = {row.name: row.unit for row in core.attributes()}
    constant = {m.stem for m in space.maps if len(m.own(space.knots)) == 1}
    out = []
    for name, best in value.items():
        samples = np.array([m[name] for m in made])
        if not np.ptp(samples) > 0 and (name in ("x0", "n") or name[:-1] in constant):
            continue  # held, not fitted; of one command, no slope is known
        low, high = np.percentile(samples, [2.5, 97.5])
        out.append(Interval(name, best, float(low), float(high), units[name], _word(space, name, words)))
    return tuple(out)


def _word(space: Space, attribute: str, words: dict[str, str]) -> str:
    """The word for an attribute, from those of the coordinates it is made of."""
    own = {"A": "yield_displacement", "beta": "beta_share", "gamma": "beta_share"}
    names = [own.get(attribute, attribute)]
    for m in space.maps:
        if attribute.startswith(m.stem) and len(attribute) == len(m.stem) + 1:
            rate = attribute.endswith("r")
            names = ["field_rate"] if rate else [c.name for c in m.coordinates(space.knots)]
    return "; ".join(dict.fromkeys(words[name] for name in names if name in words))
