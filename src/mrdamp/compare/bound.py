"""How far controllers go from a constant command towards what a clairvoyant one reaches."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from mrdamp.compare import clairvoyant
from mrdamp.compare.beam import Beam
from mrdamp.compare.bench import UNCONTROLLED, Bench, Load
from mrdamp.compare.comparison import Comparison
from mrdamp.compare.contenders import Contender
from mrdamp.compare.runner import Progress, run_all
from mrdamp.compare.summary import Summary, ratio
from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.replay import Replay
from mrdamp.errors import InputError
from mrdamp.model.core import Array

_VERSION = 2  # of the search


class Driven(Bench, Protocol):
    """A bench whose controllers act every `period` s, and that runs any of them under a load."""

    @property
    def period(self) -> float: ...

    def driven(self, controller: Controller, load: Any, amplitude: float) -> dict[str, Any]:
        """What is kept of a controller's run."""


@dataclass(frozen=True)
class Case:
    """One load at one amplitude. starts: bound -> specs of controllers, the best first."""

    load: Load
    amplitude: float
    starts: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True)
class Cases:
    """Searches on a bench, for `run_all`."""

    bench: Bench

    def key(self, task: Case) -> str:
        specs = {
            name: [self.bench.key(s, task.load, task.amplitude) for s in some]
            for name, some in task.starts.items()
        }
        effort = {**vars(clairvoyant.Effort()), **vars(Beam())}
        return hashlib.sha256(json.dumps([_VERSION, effort, specs]).encode()).hexdigest()[:32]

    def run(self, task: Case) -> dict[str, Any]:
        return self.bench.bound(task.starts, task.load, task.amplitude)


def with_bounds(
    bench: Bench,
    result: Comparison,
    loads: Sequence[Load],
    *,
    starts: int = 1,
    jobs: int = 1,
    keep: Path | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """A comparison with the bench's bounds as rows of their own, searched for from the best `starts` runs of each case.

    A bound is not worse than any controller of the comparison in any case. loads: those of the result. jobs, keep: see
    `run_all`. Raises InputError.
    """
    if not bench.bounds:
        raise InputError(
            f"compare: there is no clairvoyant command for the {bench.environment}; leave --bound out"
        )
    if starts < 1:
        raise InputError(f"compare: bound from {starts} controllers; allowed: 1 or more")
    result = replace(result, base=bench.base)
    start_of_way(result)
    cases = []
    for (i, load), (j, amplitude) in itertools.product(enumerate(loads), enumerate(result.amplitudes)):
        best = {name: _best(result, weights, i, j)[:starts] for name, weights in bench.bounds.items()}
        cases.append(Case(load, amplitude, best))
    found = run_all(Cases(bench), cases, jobs=jobs, keep=keep, progress=progress, what="bound")
    shape = 1, len(loads), len(result.amplitudes)
    values = {
        name: {
            m.key: np.array([f[name]["values"][m.key] for f in found]).reshape(shape) for m in bench.measures
        }
        for name in bench.bounds
    }
    rows = tuple(Contender(name, (name,), bound=True) for name in bench.bounds)
    paths = {
        (case.load.name, case.amplitude): {name: f[name]["paths"] for name in bench.bounds}
        for case, f in zip(cases, found, strict=True)
    }
    return replace(
        result,
        contenders=(*result.contenders, *rows),
        values={**result.values, **values},
        bounds=dict(bench.bounds),
        paths=paths,
    )


def share(result: Comparison, contender: str, bound: str) -> Summary:
    """Of the way from the base to a bound in what the bound makes small: 0 as the base, 1 as the bound.

    A ratio of means over all runs, with its interval over loads and seeds; worst: the least of a load. NaN where the
    bound is no better than the base.
    """
    gone, way = _way(result, contender, bound)
    mean, low, high = ratio(gone, way)
    return Summary(mean, float(np.nanmin(by_load(result, contender, bound), initial=np.inf)), low, high)


def least(judged: Sequence[Mapping[str, float]], weights: Mapping[str, float]) -> Mapping[str, float]:
    """Measures of the run with the least weighted sum of them."""
    return min(judged, key=lambda values: sum(w * values[key] for key, w in weights.items()))


def judged(
    bench: Driven, name: str, start: str, load: Any, amplitude: float, commands: Array, values: Sequence[float]
) -> dict[str, Any]:
    """A bound's entry of `Bench.bound`: found commands (periods,) in the bench's engine, or a better run.

    start: spec of a controller; values: what was made small after every step of the search.
    """
    uncontrolled = bench.run(UNCONTROLLED, load, amplitude)
    replayed = bench.driven(Replay(commands, bench.period, name), load, amplitude)
    runs = replayed, bench.run(start, load, amplitude)
    return {
        "values": dict(least([bench.values(run, uncontrolled) for run in runs], bench.bounds[name])),
        "paths": [{"start": "beam", "values": list(values), "ended": "widest beam"}],
    }


def by_load(result: Comparison, contender: str, bound: str) -> Array:
    """(loads,) the share under each load, all amplitudes and seeds together."""
    gone, way = _way(result, contender, bound)
    long = way.mean(axis=(0, 2))
    some = np.where(long > 0, long, np.nan)
    return np.asarray(gone.mean(axis=(0, 2)) / some)


def start_of_way(result: Comparison) -> str:
    """The contender that is the base. Raises InputError."""
    for c in result.contenders:
        if c.specs == (result.base,):
            return c.name
    raise InputError(f"compare: a bound needs {result.base} among the controllers; add it")


def _way(result: Comparison, contender: str, bound: str) -> tuple[Array, Array]:
    """What a contender gains over the base, (seeds, loads, amplitudes), and what the bound does, (1, ...)."""
    weights = result.bounds[bound]
    on = _score(result, start_of_way(result), weights)
    return on - _score(result, contender, weights), on - _score(result, bound, weights)


def _score(result: Comparison, contender: str, weights: Mapping[str, float]) -> Array:
    return np.asarray(sum(w * result.values[contender][key] for key, w in weights.items()))


def _best(result: Comparison, weights: Mapping[str, float], load: int, amplitude: int) -> tuple[str, ...]:
    """Specs of the controllers of a damper, the best in one case first."""
    rated = {
        spec: float(value)
        for c in result.contenders
        if not c.bound and not any(spec.partition(":")[0] == registry.IDEAL for spec in c.specs)
        for spec, value in zip(c.specs, _score(result, c.name, weights)[:, load, amplitude], strict=True)
    }
    return tuple(sorted(rated, key=rated.__getitem__))
