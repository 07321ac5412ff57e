"""Fitting a force law to records: bounded least squares from several starts, in free run, through the C entry."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, product
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.stats import qmc

from mrdamp.errors import InputError, nearest
from mrdamp.identify.excerpts import excerpts, is_led, skipped
from mrdamp.identify.laws import DEPENDENCES, OF_COMMAND, Dependence, Scales, Space, dependence_for, space
from mrdamp.identify.least_squares import bounded_least_squares
from mrdamp.model import Model, core, effects_from
from mrdamp.model.core import Array, attribute_index
from mrdamp.parallel import Progress, silent
from mrdamp.records import Record
from mrdamp.records.checks import check_channels, check_clipping, check_size
from mrdamp.records.log_filter import held, rings_before_jumps
from mrdamp.records.motion import slowness
from mrdamp.shown import Shown
from mrdamp.simulation.predict import free_run, motion

#: Samples that the starts are compared on; where a set is longer, each record gives its liveliest part.
_SEARCH_SAMPLES = 6_000
#: Steps of one local fit, in the search and in the last fit.
_SEARCH_STEPS, FIT_STEPS = 20, 30
#: The second best end of the search is continued if its cost is within this factor of the best one's.
_CLOSE = 1.15
#: The starts of records that begin in motion are kept as fitted if the cost without them is larger by this: a tenth of
#: the error. Else they stand in for what the law lacks, and a prediction does not have them.
_PAYS = 1.23
#: s, the chain's inner step in the search and in the last fit.
_SEARCH_SUBSTEP, _FIT_SUBSTEP = 1e-3, 5e-4


class RecordError(NamedTuple):
    """Free-run error of a model on one record: RMS error (N), and over the standard deviation of the force."""

    record: str
    rmse: float
    nrmse: float


@dataclass(frozen=True)
class Fit(Shown):
    """A fitted law: the model, its errors by record on what it was fitted to and on what was held out."""

    picture: ClassVar[str] = "mrdamp.identify.comparison:errors_picture"
    model: Model
    train: tuple[RecordError, ...]
    held_out: tuple[RecordError, ...]
    starts: int
    evaluations: int
    #: Requested effects that these records cannot show, and that are left out of the fit.
    left_out: tuple[str, ...] = ()
    #: The search that found it and the point it found, for intervals; not kept in files.
    space: Space | None = field(default=None, compare=False, repr=False)
    point: tuple[float, ...] = field(default=(), compare=False, repr=False)
    #: The train records that are led into, by name: m, x - y at their start beyond that of the run-in, as fitted.
    started: Mapping[str, float] = field(default_factory=dict, compare=False, repr=False)

    def __repr__(self) -> str:
        parts = (self.train_nrmse, len(self.train), "fitted"), (self.held_out_nrmse, len(self.held_out), "held out")
        return f"Fit({self.model!r}, {', '.join(f'error {e:.3f} of {n} {what}' for e, n, what in parts)})"

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


def simulate(model: Model, record: Record, started: float = 0.0) -> Array:
    """Free-run force (n,) N of a model on a damper record, as `mrdamp predict` computes it.

    started: m, x - y of modified_bouc_wen at its start beyond that of its run-in (`Fit.started`).
    """
    if started:
        model = replace(model, parameters={**model.parameters, "start_r": started})
    return free_run(model, record)["force_N"]


def error(model: Model, record: Record) -> RecordError:
    """Free-run error on a record."""
    return error_of(record, "force_N", simulate(model, record))


def error_of(record: Record, channel: str, simulated: Array) -> RecordError:
    """Error of a simulated channel (n,); the first 20 ms, where the unknown start state fades, do not count."""
    measured, skip = record.channel(channel), skipped(record)
    rmse = float(np.sqrt(np.mean((simulated - measured)[skip:] ** 2)))
    deviation = float(np.std(measured[skip:]))
    return RecordError(record.name, rmse, rmse / deviation if deviation > 0 else math.inf)


class Problem:
    """Residuals of all records for many points at once; every record weighs the same, as in `pooled`.

    A point (size,) is one of the search space, and the start of each record in `free`, all from 0 to 1. hold: the
    command is held between samples.
    """

    def __init__(
        self,
        search: Space,
        records: Sequence[Record],
        threads: int,
        substep: float = _FIT_SUBSTEP,
        freed: bool = True,
        hold: bool = False,
    ) -> None:
        self.space, self.threads, self.evaluations = search, threads, 0
        self.freed, self.hold = freed and search.law == "modified_bouc_wen", hold
        names = [c.name for c in search.plain]
        self.records = [(r, *motion(r, names), r.channel("force_N")) for r in records]
        self.substep = substep * slowness((x, v) for _, x, v, *_ in self.records)
        #: Of each record: its constant command, where each of these has values of its own.
        self.commands = [float(np.median(r.command)) if search.each else None for r in records]
        #: Of each record: it is led into; else it begins at rest, or moves as if from rest.
        self.led = [is_led(r) for r in records]
        # One scale for all: a record with a small force must not pull the others with its noise.
        total = sum(float(np.var(f)) for *_, f in self.records)
        self.weights = [1 / np.sqrt(total * (len(f) - skipped(r))) for r, *_, f in self.records]

    @property
    def slices(self) -> list[slice]:
        """Where each record's residuals stand."""
        ends = np.cumsum([0, *(len(f) - skipped(r) for r, *_, f in self.records)])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]

    @property
    def free(self) -> list[int]:
        """The records whose slow state at the start (x - y) is fitted along: those that are led into."""
        return [k for k, led in enumerate(self.led) if led and self.freed]

    def begin(self, point: Array) -> Array:
        """A point of the search space (coordinates,) with every start at that of its run-in."""
        return np.concatenate([point, np.full(len(self.free), 0.5)])

    def started(self, point: Array) -> list[float]:
        """m, x - y at the start of each record beyond that of its run-in."""
        out = [0.0] * len(self.records)
        for k, share in zip(self.free, point[len(self.space.coordinates) :], strict=True):
            out[k] = (2 * float(share) - 1) * float(np.ptp(self.records[k][0].displacement))
        return out

    def residuals(self, points: Array) -> Array:
        """(points, samples) for points (points, size)."""
        return np.concatenate(self._of_records(list(self._vectors(points))), axis=1)

    def _vectors(self, points: Array) -> Array:
        """Attributes (records, points, attributes)."""
        law, n = self.space.law, len(self.space.coordinates)
        made = {u: [self.space.attributes(p[:n], u) for p in points] for u in dict.fromkeys(self.commands)}
        vectors = {u: np.array([core.vector(law, a) for a in attributes]) for u, attributes in made.items()}
        out = np.array([vectors[u] for u in self.commands])
        starts = [self.started(p) for p in points]
        for k in self.free:
            attributes = made[self.commands[k]]
            out[k] = [core.vector(law, a | {"start_r": s[k]}) for a, s in zip(attributes, starts, strict=True)]
        return out

    def _of_records(self, vectors: Sequence[Array]) -> list[Array]:
        """Residuals (points, samples) of each record for its own attributes (points, attributes)."""
        self.evaluations += sum(map(len, vectors))
        runs = core.run_records(
            self.space.law,
            [
                core.Sets(v, r.sample_time, x, r.command, velocity, a, self.hold, led, self.substep)
                for v, (r, x, velocity, a, _), led in zip(vectors, self.records, self.led, strict=True)
            ],
            threads=self.threads,
        )
        each = zip(self.weights, runs, self.records, strict=True)
        return [weight * (run[:, 0] - force)[:, skipped(r) :] for weight, run, (r, *_, force) in each]

    def choose_starts(self, point: Array) -> Array:
        """Starts those records at rest that begin in motion and are nearer to a law at the point (size,) so.

        Returns the point (size,) to go on from, shorter by their starts.
        """
        moving, n, before = self.led, len(self.space.coordinates), self.free
        costs = []
        for led in (moving, [False] * len(moving)):
            self.led = led
            residual = self.residuals(point[None, : n + len(self.free)])[0] ** 2
            costs.append([float(residual[part].sum()) for part in self.slices])
        self.led = [led and costs[0][k] <= costs[1][k] for k, led in enumerate(moving)]
        return np.concatenate([point[:n], [point[n + before.index(k)] for k in self.free]])

    def jacobian(self, point: Array, residual: Array) -> Array:
        """Differences within the bounds (samples, coordinates), all columns in one threaded call.

        residual: (samples,) at the point.
        """
        step, n = 1e-4, len(self.space.coordinates)
        shifts = np.where(point + step <= 1, step, -step)
        vectors = self._vectors(point + np.diag(shifts))
        out = np.zeros((len(point), len(residual)))
        # A start moves its own record alone.
        rows = [
            [*range(n), *(n + i for i, free in enumerate(self.free) if free == k)] for k in range(len(self.records))
        ]
        moved = self._of_records([v[own] for v, own in zip(vectors, rows, strict=True)])
        for own, part, one in zip(rows, self.slices, moved, strict=True):
            out[own, part] = (one - residual[part]) / shifts[own, None]
        return out.T


def identify(
    law: str,
    train: Sequence[Record],
    held_out: Sequence[Record] = (),
    *,
    extras: Sequence[str] = ("offset",),
    dependence: Dependence | None = None,
    follows: Sequence[str] | None = None,
    start: Mapping[str, float] | None = None,
    starts: int = 4,
    seed: int = 0,
    hold: bool | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fits a parametric law to the train records and evaluates it on the others, in free run.

    extras: effects fitted along (see `mrdamp.identify.laws.EXTRAS`). dependence: how coefficients follow the command
    (`mrdamp.identify.laws.DEPENDENCES`); None is a straight line where the command varies. follows: which of them (see
    `mrdamp.identify.laws.space`). start: attributes to begin from in place of the law's own start. starts: local fits,
    from the best of a Latin hypercube and from the start. hold: commands are held between samples, or run along lines;
    None: whichever is nearer to the records. The same seed gives the same answer for any number of threads. Raises
    InputError.
    """
    if not train:
        raise InputError("there is no record to fit to")
    for name in start or {}:
        if name not in attribute_index():
            raise InputError(f"start: {name!r} is no attribute{nearest(name, attribute_index())}")
    check_channels(train)
    check_channels(held_out)
    check_clipping(train)
    scales = Scales.of(train)
    dependence = dependence_for(dependence, scales, train[0].label)
    requested = tuple(extras)
    if scales.levels == 1:
        extras = [extra for extra in extras if extra != "saturation"]
    if all(np.ptp(record.command) < 1e-3 * scales.command for record in train):
        extras = [extra for extra in extras if extra not in OF_COMMAND]  # nothing would show it
    search = space(law, scales, extras, dependence, follows)
    check_size(train, len(search.coordinates))
    threads = threads or os.cpu_count() or 1
    varying = [r for r in train if np.ptp(r.command) > 0 and not rings_before_jumps(np.asarray(r.command))]
    first_hold = any(held(r.command) for r in varying) if hold is None else hold
    problem = Problem(
        search, excerpts(train, _SEARCH_SAMPLES), threads, _SEARCH_SUBSTEP, freed=False, hold=first_hold
    )
    n = len(search.coordinates)
    first = search.start if start is None else search.point(start)
    sampler = qmc.LatinHypercube(n, rng=np.random.default_rng(seed))
    # Half of the trial points are around the first one, half anywhere.
    trials = sampler.random(24 * starts if starts > 1 else 0)
    near = np.clip(first + 0.3 * (trials[::2] - 0.5), 0, 1)
    points = np.vstack([first, near, trials[1::2]])
    say = progress or silent
    say("trying starts", 0.0)
    points = np.array([problem.begin(p) for p in points])
    parts = np.array_split(points, min(6, len(points)))
    cost = np.concatenate([np.sum(problem.residuals(p) ** 2, axis=1) for p in parts])
    chosen = [0, *(k for k in np.argsort(cost, kind="stable") if k != 0)][:starts]
    found: list[tuple[float, int, Array]] = []
    for count, k in enumerate(chosen):
        say(f"start {count + 1} of {starts}", 0.1 + 0.6 * count / starts)
        found.append(descend(problem, points[k], _SEARCH_STEPS, count))
    # A second one that is close is also continued with more data, as a short part may favour the wrong one.
    found.sort(key=lambda item: item[:2])
    last = [item for item in found[:2] if item[0] <= _CLOSE * found[0][0]]
    full = Problem(search, train, threads, hold=first_hold)
    ways = [freed for freed in (True, False) if freed <= bool(full.free)]
    ends: dict[bool, tuple[float, int, Array]] = {}
    for count, (freed, (_, order, point)) in enumerate(product(ways, last)):
        say(f"final fit {count + 1} of {len(ways) * len(last)}", 0.7 + 0.07 * count)
        full.freed = freed
        end = descend(full, full.begin(point[:n]), FIT_STEPS, order)
        ends[freed] = min(ends.get(freed, end), end, key=lambda item: item[:2])
    full.freed = True in ends and ends[False][0] > _PAYS * ends[True][0]
    reached, _, best = ends[full.freed]
    if hold is None and varying:
        full.hold = not first_hold
        other = descend(full, best, FIT_STEPS)
        if other[0] < 0.999 * reached:
            best = other[2]
        else:
            full.hold = first_hold
    before = list(full.led)
    again = full.choose_starts(best)
    if full.led != before:
        best = descend(full, again, FIT_STEPS)[2]
    model = model_of(search, best[:n])
    model = replace(model, sample_rate_hz=round(1 / train[0].sample_time, 6))
    model = within(model, np.concatenate([record.command for record in train]))
    if varying:
        model = model.with_hold(full.hold)
    say("evaluating", 1.0)
    return Fit(
        model,
        tuple(error(model, record) for record in train),
        tuple(error(model, record) for record in held_out),
        starts,
        problem.evaluations + full.evaluations,
        tuple(extra for extra in requested if extra not in extras),
        search,
        tuple(float(p) for p in best[:n]),
        {train[k].name: full.started(best)[k] for k, led in enumerate(full.led) if led},
    )


def compare_dependences(
    law: str,
    train: Sequence[Record],
    held_out: Sequence[Record],
    dependences: Sequence[str] = tuple(DEPENDENCES)[1:],
    *,
    extras: Sequence[str] = ("offset",),
    starts: int = 4,
    seed: int = 0,
    hold: bool | None = None,
    follows: Sequence[str] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Fit]:
    """One fit of a law for each dependence on the command that the records can show, by name.

    The criterion is `held_out_nrmse`, on records outside the fit. Raises InputError.
    """
    fits: dict[str, Fit] = {}
    levels = Scales.of(train).levels
    shown = [d for d in dependences if levels >= max(2, DEPENDENCES[d])]
    for count, dependence in enumerate(shown or ["constant"]):
        (progress or silent)(dependence, count / max(len(shown), 1))
        # Each begins where the one before ended: a straight line is a curve without a bend.
        before = list(fits.values())[-1].model.attributes if fits else None
        fits[dependence] = identify(
            law, train, held_out, extras=extras, dependence=dependence, follows=follows, start=before, starts=starts,
            seed=seed, hold=hold, threads=threads,
        )  # fmt: skip
    return fits


def model_of(search: Space, point: Array, command: float | None = None) -> Model:
    """The model at a point of the search space; command: as in `Space.attributes`."""
    attributes = search.attributes(point, command)
    mine = set(core.law_parameters(search.law)) | set(core.law_options(search.law))
    parameters = {key: attributes[key] for key in core.law_parameters(search.law)}
    parameters |= {key: value for key, value in attributes.items() if key in mine and key not in parameters}
    return Model(search.law, parameters, effects_from(attributes), name=f"{search.law} fit")


def within(model: Model, commands: Array) -> Model:
    """The model with the range of the commands (n,) that it was identified on; a bipolar current counts by its size."""
    low, high = float(commands.min()), float(commands.max())
    if low < 0:
        return replace(model, parameters={**model.parameters, "command_max": max(-low, high)})
    return replace(model, parameters={**model.parameters, "command_min": low, "command_max": high})


def descend(problem: Problem, start: Array, most: int, order: int = 0) -> tuple[float, int, Array]:
    """Cost, order and end of one bounded least squares from a point of the unit cube."""
    solution = bounded_least_squares(
        lambda p: problem.residuals(p[None])[0],
        problem.jacobian,
        np.clip(start, 1e-6, 1 - 1e-6),
        bounds=(0, 1),
        most=most,
        ftol=1e-6,
        xtol=1e-6,
        gtol=1e-9,
    )
    return float(solution.cost), order, solution.x
