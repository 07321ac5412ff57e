"""Fitting a force law to records: bounded least squares from several starts, in free run, through the C entry."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc

from mrdamp import core
from mrdamp.core import Array
from mrdamp.errors import InputError
from mrdamp.laws import Scales, Space, space
from mrdamp.model import Model, effects_from
from mrdamp.records import Record

Progress = Callable[[str, float], None]

#: Samples that the starts are compared on, and that the last fit is made on; where a set is longer, each record
#: gives its beginning.
_SEARCH_SAMPLES = 12_000
_FIT_SAMPLES = 40_000
#: s, the chain's inner step while fitting; the figures that are reported use the finer default.
_FIT_SUBSTEP = 1e-3


@dataclass(frozen=True)
class RecordError:
    """Free-run error of a model on one record: RMS error (N), and over the standard deviation of the force."""

    record: str
    rmse: float
    nrmse: float


@dataclass(frozen=True)
class Fit:
    """A fitted law: the model, its errors by record on what it was fitted to and on what was held out."""

    model: Model
    train: tuple[RecordError, ...]
    held_out: tuple[RecordError, ...]
    starts: int
    evaluations: int

    @property
    def train_nrmse(self) -> float:
        """RMS error over the standard deviation of the force, all train records pooled."""
        return pooled(self.train)

    @property
    def held_out_nrmse(self) -> float:
        """RMS error over the standard deviation of the force, all held-out records pooled."""
        return pooled(self.held_out)


def pooled(errors: Sequence[RecordError]) -> float:
    """RMS error over the standard deviation of the force, mean squares pooled over the records."""
    if not errors:
        return float("nan")
    return float(
        np.sqrt(np.mean([e.rmse**2 for e in errors]) / np.mean([(e.rmse / e.nrmse) ** 2 for e in errors]))
    )


def simulate(model: Model, record: Record) -> Array:
    """Free-run force (n,) N of a model on a damper record, through the C entry."""
    columns = ("force",)
    out = core.run(
        model.law,
        model.attributes,
        record.sample_time,
        record.displacement,
        _velocity(record),
        record.channels.get("acceleration_m_s2"),
        record.command,
        narx=model.narx,
        columns=columns,
    )
    return out["force"]


def error(model: Model, record: Record) -> RecordError:
    """Free-run error on a record; the first 20 ms, where the unknown start state fades, do not count."""
    measured = record.channel("force_N")
    skip = min(record.n // 4, int(0.02 / record.sample_time))
    residual = (simulate(model, record) - measured)[skip:]
    rmse = float(np.sqrt(np.mean(residual**2)))
    return RecordError(record.name, rmse, rmse / float(np.std(measured[skip:])))


class _Problem:
    """Residuals of all records for many points at once; each record weighs by its share of the force's variance."""

    def __init__(self, search: Space, records: Sequence[Record], threads: int) -> None:
        self.space, self.threads, self.evaluations = search, threads, 0
        self.records = [(r, _velocity(r), r.channel("force_N")) for r in records]
        # One weight for all: a record with a small force must not pull the others with its noise.
        total = sum(len(f) * float(np.var(f)) for _, _, f in self.records)
        self.scale = 1 / np.sqrt(total)

    def residuals(self, points: Array) -> Array:
        """(points, samples) for points (points, coordinates) of the unit cube."""
        vectors = np.array([core.vector(self.space.law, self.space.attributes(p)) for p in points])
        self.evaluations += len(points)
        parts = []
        for record, velocity, force in self.records:
            out = core.run_many(
                self.space.law,
                vectors,
                record.sample_time,
                record.displacement,
                record.command,
                v=velocity,
                a=record.channels.get("acceleration_m_s2"),
                threads=self.threads,
                substep=_FIT_SUBSTEP,
            )
            parts.append(out[:, 0, :] - force)
        return np.asarray(np.concatenate(parts, axis=1) * self.scale)

    def jacobian(self, point: Array) -> Array:
        """Differences within the bounds, all columns in one threaded call."""
        step = 1e-4
        shifts = np.where(point + step <= 1, step, -step)
        rows = self.residuals(np.vstack([point, point + np.diag(shifts)]))
        return np.asarray(((rows[1:] - rows[0]) / shifts[:, None]).T)


def identify(
    law: str,
    train: Sequence[Record],
    held_out: Sequence[Record] = (),
    *,
    extras: Sequence[str] = ("offset",),
    starts: int = 4,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fits a parametric law to the train records and judges it on the others, in free run.

    extras: effects fitted along (see `mrdamp.laws.EXTRAS`). starts: local fits, from the best of a Latin hypercube
    and from the law's own start. The same seed gives the same answer for any number of threads. Raises InputError.
    """
    for record in (*train, *held_out):
        if record.force is None:
            raise InputError(f"{record.label}: no channel force_N; a fit needs it")
    scales = Scales.of(train)
    if all(np.ptp(record.command) < 1e-3 * scales.command for record in train):
        extras = [extra for extra in extras if extra != "driver_lag"]  # nothing would show it
    search = space(law, scales, extras, max(record.sample_time for record in train))
    threads = threads or os.cpu_count() or 1
    problem = _Problem(search, _shorten(train, _SEARCH_SAMPLES), threads)
    n = len(search.coordinates)
    sampler = qmc.LatinHypercube(n, rng=np.random.default_rng(seed))
    # Half of the trial points are around the law's own start, half anywhere.
    trials = sampler.random(24 * starts)
    near = np.clip(search.start + 0.3 * (trials[::2] - 0.5), 0, 1)
    points = np.vstack([search.start, near, trials[1::2]])
    if progress:
        progress("trying starts", 0.0)
    cost = np.concatenate([np.sum(problem.residuals(p) ** 2, axis=1) for p in np.array_split(points, 6)])
    chosen = [0, *(k for k in np.argsort(cost) if k != 0)][:starts]
    found: list[tuple[float, int, Array]] = []
    for count, k in enumerate(chosen):
        if progress:
            progress(f"start {count + 1} of {starts}", 0.1 + 0.6 * count / starts)
        found.append(_descend(problem, np.clip(points[k], 1e-6, 1 - 1e-6), 40, count))
    # The two best go on with all the data, as a short beginning may favour the wrong one.
    full = _Problem(search, _shorten(train, _FIT_SAMPLES), threads)
    final = []
    for count, (_, order, point) in enumerate(sorted(found, key=lambda item: item[:2])[:2]):
        if progress:
            progress(f"final fit {count + 1} of 2", 0.7 + 0.15 * count)
        final.append(_descend(full, np.clip(point, 1e-6, 1 - 1e-6), 40, order))
    best = min(final, key=lambda item: item[:2])[2]
    model = model_of(search, best)
    commands = np.concatenate([record.command for record in train])
    held = {"command_min": float(commands.min()), "command_max": float(commands.max())}
    parameters = (
        {**model.parameters, **held} if held["command_min"] < held["command_max"] else model.parameters
    )
    model = replace(model, parameters=parameters, sample_rate_hz=round(1 / train[0].sample_time, 6))
    if progress:
        progress("judging", 1.0)
    return Fit(
        model,
        tuple(error(model, record) for record in train),
        tuple(error(model, record) for record in held_out),
        starts,
        problem.evaluations + full.evaluations,
    )


def model_of(search: Space, point: Array) -> Model:
    """The model at a point of the search space."""
    attributes = search.attributes(point)
    mine = set(core.law_parameters(search.law)) | set(core.law_options(search.law))
    parameters = {key: attributes[key] for key in core.law_parameters(search.law)}
    parameters |= {key: value for key, value in attributes.items() if key in mine and key not in parameters}
    return Model(search.law, parameters, effects_from(attributes), name=f"{search.law} fit")


def _descend(problem: _Problem, start: Array, most: int, order: int) -> tuple[float, int, Array]:
    """Cost, order and end of one bounded least squares."""
    solution = least_squares(
        lambda p: problem.residuals(p[None])[0],
        start,
        problem.jacobian,
        bounds=(0, 1),
        ftol=1e-6,
        xtol=1e-6,
        gtol=1e-9,
        max_nfev=most,
    )
    return float(solution.cost), order, solution.x


def _velocity(record: Record) -> Array:
    return record.velocity()


def _shorten(records: Sequence[Record], most: int) -> list[Record]:
    """The records, or their beginnings where they are too long together."""
    total = sum(record.n for record in records)
    if total <= most:
        return list(records)
    share = most / total
    return [r.part(r.time[0], r.time[0] + max(share * r.duration, 100 * r.sample_time)) for r in records]
