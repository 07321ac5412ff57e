"""The best commands for loads known in advance, as rows of a comparison."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np

from mrdamp.compare import clairvoyant
from mrdamp.compare.beam import Beam
from mrdamp.compare.bench import Bench, Load
from mrdamp.compare.cable_bound import cable_bound
from mrdamp.compare.car_bound import car_bound
from mrdamp.compare.comparison import Comparison
from mrdamp.compare.contenders import Contender
from mrdamp.compare.frame_bound import frame_bound
from mrdamp.compare.runner import How, run_all
from mrdamp.control import registry
from mrdamp.errors import InputError

_VERSION = 2  # of the search
#: Environment -> search. Arguments: bench; starts, bound -> specs of controllers, the best first; load; amplitude.
#: Answer, for JSON: bound -> `values`, as `Bench.values`, and `paths`, one a start: its name (`start`), what was made
#: small after every step of the search (`values`), and why it `ended`.
_SEARCHES: Mapping[str, Callable[..., dict[str, Any]]] = {
    "frame": frame_bound,
    "cable": cable_bound,
    "car": car_bound,
}


@dataclass(frozen=True)
class Case:
    """The searches on a bench for one load at one amplitude. starts: bound -> specs of controllers, the best first."""

    bench: Bench
    load: Load
    amplitude: float
    starts: Mapping[str, tuple[str, ...]]

    def key(self) -> str:
        specs = {
            name: [self.bench.key(spec, self.load, self.amplitude) for spec in some]
            for name, some in self.starts.items()
        }
        effort = {**vars(clairvoyant.Effort()), **vars(Beam())}
        return hashlib.sha256(json.dumps([_VERSION, effort, specs]).encode()).hexdigest()[:32]

    def run(self) -> dict[str, Any]:
        return _SEARCHES[self.bench.environment](self.bench, self.starts, self.load, self.amplitude)


def with_bounds(
    bench: Bench,
    result: Comparison,
    loads: Sequence[Load],
    *,
    starts: int = 1,
    **how: Unpack[How],
) -> Comparison:
    """A comparison with the bench's bounds as rows of their own, searched for from the best `starts` runs of each case.

    A bound is not worse than any controller of the comparison in any case. loads: those of the result. Raises
    InputError.
    """
    if not bench.bounds:
        raise InputError(
            f"compare: there is no clairvoyant command for the {bench.environment}; leave --bound out"
        )
    if starts < 1:
        raise InputError(f"compare: bound from {starts} controllers; allowed: 1 or more")
    result = replace(result, base=bench.base)
    result.start_of_way()
    cases = []
    for (i, load), (j, amplitude) in itertools.product(enumerate(loads), enumerate(result.amplitudes)):
        best = {name: _best(result, weights, i, j)[:starts] for name, weights in bench.bounds.items()}
        cases.append(Case(bench, load, amplitude, best))
    found = run_all(cases, "bound", **how)
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


def _best(result: Comparison, weights: Mapping[str, float], load: int, amplitude: int) -> tuple[str, ...]:
    """Specs of the controllers of a damper, the best in one case first."""
    rated = {
        spec: float(value)
        for c in result.contenders
        if not c.bound and not any(spec.partition(":")[0] == registry.IDEAL for spec in c.specs)
        for spec, value in zip(c.specs, result.score(c.name, weights)[:, load, amplitude], strict=True)
    }
    return tuple(sorted(rated, key=rated.__getitem__))
