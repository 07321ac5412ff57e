"""Controllers x loads x amplitudes: every run, the table that comes of them, and bootstrap intervals."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeVar, Unpack

import numpy as np
from numpy.typing import NDArray

from mrdamp.compare.bench import Bench, Load, Measure
from mrdamp.compare.contenders import Contender
from mrdamp.compare.tuning import run_grid
from mrdamp.control.policy import Policy
from mrdamp.control.told import is_code
from mrdamp.errors import InputError, require_positive
from mrdamp.model.core import Array
from mrdamp.parallel import How
from mrdamp.shown import Shown

Whole = NDArray[np.int64]
RESAMPLES = 2000
LEVEL = 0.95
_SEED = 0


@dataclass(frozen=True)
class Summary:
    """Of one measure of one controller: mean and largest value, and the mean's interval (95 %)."""

    mean: float
    worst: float
    low: float
    high: float


def summarise(values: Array) -> Summary:
    """values (seeds, motions, amplitudes); motions and, where there are several, seeds are drawn with replacement.

    The amplitudes of a motion stay together: they are chosen, not drawn. With one motion and one seed there is no
    interval (NaN).
    """
    if values.ndim != 3 or not values.size:
        raise InputError(f"compare: values have shape {values.shape}; allowed: (seeds, motions, amplitudes)")
    low, high = interval(values)
    return Summary(float(values.mean()), float(values.max()), low, high)


def interval(values: Array) -> tuple[float, float]:
    """Percentile interval of the mean of values (seeds, motions, amplitudes)."""
    cells = values.mean(axis=2)
    if not np.isfinite(cells).all() or cells.size == 1:
        return float("nan"), float("nan")
    rows, columns = _draws(cells)
    return _percentiles(cells[rows, columns].mean(axis=(1, 2)))


def ratio(values: Array, other: Array) -> tuple[float, float, float]:
    """Mean of values over mean of other, and its percentile interval; other has one seed.

    Shapes (seeds, motions, amplitudes); drawn together, as in `summarise`. NaN where the mean of other is not above 0,
    and for the interval where it is not in all draws.
    """
    if values.shape[1:] != other.shape[1:] or len(other) != 1:
        raise InputError(f"compare: shapes {values.shape} and {other.shape} have no ratio")
    cells, below = values.mean(axis=2), other.mean(axis=2)
    nan = float("nan")
    if not np.isfinite(cells).all() or not below.mean() > 0:
        return nan, nan, nan
    rows, columns = _draws(cells)
    lower = below[0][columns].mean(axis=(1, 2))
    mean = float(cells.mean() / below.mean())
    if cells.size == 1 or not (lower > 0).all():
        return mean, nan, nan
    return mean, *_percentiles(cells[rows, columns].mean(axis=(1, 2)) / lower)


def _draws(cells: Array) -> tuple[Whole, Whole]:
    """Rows (draws, seeds, 1) and columns (draws, 1, motions) of cells (seeds, motions).

    The same for every controller: differences are paired.
    """
    seeds, motions = cells.shape
    rng = np.random.default_rng(np.random.SeedSequence(_SEED))
    rows = rng.integers(seeds, size=(RESAMPLES, seeds))
    columns = rng.integers(motions, size=(RESAMPLES, motions))
    return rows[:, :, None], columns[:, None, :]


def _percentiles(means: Array) -> tuple[float, float]:
    tail = 50 * (1 - LEVEL)
    low, high = np.percentile(means, [tail, 100 - tail])
    return float(low), float(high)


def difference(values: Array, other: Array) -> Summary:
    """Of values less other, (seeds, motions, amplitudes) each, paired by motion and amplitude.

    Seeds of two trainings have nothing in common: they are drawn apart, and every one is set against every one of the
    other. Raises InputError where motions or amplitudes differ.
    """
    if values.shape[1:] != other.shape[1:]:
        raise InputError(f"compare: shapes {values.shape} and {other.shape} cannot be paired")
    if 1 in (len(values), len(other)):
        return summarise(values - other)
    every = values[:, None] - other[None]
    mean, worst = float(every.mean()), float(every.max())
    cells, less = values.mean(axis=2), other.mean(axis=2)
    if not (np.isfinite(cells).all() and np.isfinite(less).all()):
        return Summary(mean, worst, float("nan"), float("nan"))
    rows, columns = _draws(cells)
    rng = np.random.default_rng(np.random.SeedSequence([_SEED, 1]))  # apart from that of `_draws`
    others = rng.integers(len(less), size=(RESAMPLES, len(less)))[:, :, None]
    drawn = cells[rows, columns].mean(axis=(1, 2)) - less[others, columns].mean(axis=(1, 2))
    return Summary(mean, worst, *_percentiles(drawn))


AnyLoad = TypeVar("AnyLoad", bound=Load)


@dataclass(frozen=True, eq=False)
class Comparison(Shown):
    """values: contender -> measure's key -> (seeds, loads, amplitudes); NaN where a measure has no value.

    objective: weights by measure, what controllers are tuned for; others: the same on other structures, by name; notes:
    what to know of loads and policies, a line each.

    Where there are bounds among the contenders (`with_bounds`): bounds and base, as of a bench, and paths, how they
    were found: (load, amplitude) -> bound -> results of the searches, one a start.
    """

    picture: ClassVar[str] = "mrdamp.compare.page:means_picture"
    contenders: tuple[Contender, ...]
    measures: tuple[Measure, ...]
    loads: tuple[str, ...]
    amplitudes: tuple[float, ...]
    values: Mapping[str, Mapping[str, Array]]
    bounds: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    base: str = "passive-on"
    paths: Mapping[tuple[str, float], Mapping[str, Sequence[Mapping[str, Any]]]] = field(default_factory=dict)
    objective: Mapping[str, float] = field(default_factory=dict)
    others: Mapping[str, Comparison] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        counts = (self.contenders, "controllers"), (self.loads, "loads"), (self.amplitudes, "amplitudes")
        return f"Comparison({', '.join(f'{len(some)} {what}' for some, what in counts)})"

    @property
    def has_intervals(self) -> bool:
        """False with one load and one seed of each controller, between which nothing is drawn."""
        return len(self.loads) > 1 or any(len(c.specs) > 1 for c in self.contenders)

    def summary(self, contender: str, measure: str) -> Summary:
        """Mean, worst and the mean's interval over seeds and loads."""
        return summarise(self.values[contender][measure])

    def against(self, contender: str, other: str, measure: str) -> Summary:
        """Of the difference to another contender, run by run; below 0: less than the other's."""
        return difference(self.values[contender][measure], self.values[other][measure])

    def score(self, contender: str, weights: Mapping[str, float]) -> Array:
        """(seeds, loads, amplitudes) weighted sum of measures, of every run."""
        return sum((w * self.values[contender][key] for key, w in weights.items()), np.zeros(1))

    def rated(self, contender: str) -> Array:
        """(seeds, loads, amplitudes) what controllers are tuned for, of every run."""
        return self.score(contender, self.objective)

    def gain(self, contender: str) -> Summary:
        """Of that, less the base's, run by run."""
        return difference(self.rated(contender), self.rated(self.base))

    def by_amplitude(self, contender: str, measure: str) -> Array:
        """(amplitudes,) mean over seeds and loads."""
        return np.asarray(self.values[contender][measure].mean(axis=(0, 1)))

    def start_of_way(self) -> str:
        """The contender that is the base. Raises InputError."""
        for c in self.contenders:
            if c.specs == (self.base,):
                return c.name
        raise InputError(f"compare: a bound needs {self.base} among the controllers; add it")

    def share(self, contender: str, bound: str) -> Summary:
        """Of the way from the base to a bound in what the bound makes small: 0 as the base, 1 as the bound.

        A ratio of means over all runs, with its interval over loads and seeds; worst: the least of a load. NaN where
        the bound is no better than the base.
        """
        mean, low, high = ratio(*self._way(contender, bound))
        return Summary(mean, float(np.nanmin(self.load_shares(contender, bound), initial=np.inf)), low, high)

    def load_shares(self, contender: str, bound: str) -> Array:
        """(loads,) the share under each load, all amplitudes and seeds together."""
        gone, way = (gain.mean(axis=(0, 2)) for gain in self._way(contender, bound))
        return np.asarray(gone / np.where(way > 0, way, np.nan))

    def _way(self, contender: str, bound: str) -> tuple[Array, Array]:
        """What a contender gains over the base, (seeds, loads, amplitudes), and what the bound does, (1, ...)."""
        weights = self.bounds[bound]
        base, own, best = (self.score(name, weights) for name in (self.start_of_way(), contender, bound))
        return base - own, base - best


def compare(
    bench: Bench,
    contenders: Sequence[Contender],
    loads: Sequence[Load],
    amplitudes: Sequence[float],
    **how: Unpack[How],
) -> Comparison:
    """Every contender under every one of the `distinct` loads at every amplitude. Raises InputError."""
    if not contenders or not loads or not amplitudes:
        raise InputError("compare: give at least one controller, one motion and one amplitude")
    for amplitude in amplitudes:
        require_positive("compare", amplitude=amplitude)
        if list(amplitudes).count(amplitude) > 1:
            raise InputError(f"compare: amplitude {amplitude:g} is given twice; allowed: each once")
    for load in loads:
        try:
            forces = bench.forces(load)
        except AttributeError as error:
            raise InputError(f"{load!r:.80} is no load of a {bench.environment}: {error}") from None
        if not np.any(forces):
            raise InputError(f"{load.name}: the load is zero throughout; there is nothing to control")
    given, loads = loads, distinct(bench, loads)
    cases = list(itertools.product(loads, amplitudes))
    specs = [spec for c in contenders for spec in c.specs]
    rows = run_grid(bench, specs, cases, **how)
    own = [spec for spec in specs if is_code(spec)]
    anew: How = {**how, "keep": None}
    again = run_grid(bench, own, cases[:1], "repeated runs", **anew) if own else {}
    unsteady = [
        f"{spec.partition(':')[2]}: its first run, repeated, has another result: it keeps state between runs that its "
        "reset does not put back, or draws numbers without a seed"
        for spec in own
        if not np.array_equal(list(again[spec][0].values()), list(rows[spec][0].values()), equal_nan=True)
    ]
    shape = len(loads), len(amplitudes)
    values = {
        c.name: {
            m.key: np.array([[row[m.key] for row in rows[spec]] for spec in c.specs]).reshape(-1, *shape)
            for m in bench.measures
        }
        for c in contenders
    }
    names = tuple(load.name for load in loads)
    objective = {key: weight for key, (_, weight) in bench.objective.items()}
    return Comparison(
        tuple(contenders), bench.measures, names, tuple(amplitudes), values, base=bench.base, objective=objective,
        notes=(*unsteady, *_notes(bench, contenders, given, loads)),
    )  # fmt: skip


def distinct(bench: Bench, loads: Sequence[AnyLoad]) -> list[AnyLoad]:
    """The loads without those that are an earlier one but for a factor: intervals are over independent loads. With
    more rest at an end a run lasts longer, and has other results."""
    found: dict[str, AnyLoad] = {}
    for load in loads:
        found.setdefault(bench.likeness(load), load)
    return list(found.values())


def _notes(
    bench: Bench, contenders: Sequence[Contender], given: Sequence[Load], loads: Sequence[Load]
) -> Iterator[str]:
    if again := len(given) - len(loads):
        yield f"{again} of {len(given)} loads repeat another up to a factor and are left out"
    if any(c.periods for c in contenders):
        known = {bench.likeness(load, rest=False) for load in bench.tuning_loads()}
        same = dict.fromkeys(load.name for load in loads if bench.likeness(load, rest=False) in known)
        if same:
            yield f"controllers were tuned or policies chosen on {', '.join(same)} too; others may show less"
    own = {c.name: bench.controller(c.specs[0]).period for c in contenders}
    if said := [f"{name} {1e3 * period:g} ms" for name, period in own.items() if period != bench.period]:
        yield f"control periods other than {1e3 * bench.period:g} ms: {', '.join(said)}"
    for c in contenders:
        if c.repeated:
            yield f"{c.repeated} of {len(c.specs) + c.repeated} policies of {c.name} repeat another and are left out"
        if c.learned and c.periods == 0:
            yield f"{c.name} is untrained: no evaluation of its training was better than its start's"
        policy = Policy.read(c.specs[0].partition(":")[2]) if c.learned else None
        about = {} if policy is None else policy.about
        if policy is not None and policy.dampers < bench.site.dampers:
            yield f"{c.name} was trained with one damper; its command is given to all {bench.site.dampers}"
        if about.get("structure", bench.structure.identity) != bench.structure.identity:
            yield f"{c.name} was trained on another version of {bench.environment}: other matrices or places"
