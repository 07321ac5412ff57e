"""The same comparison on frames whose stiffness or mass is not what controllers are told."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Unpack

import numpy as np

from mrdamp.compare.bench import digest
from mrdamp.compare.comparison import Comparison
from mrdamp.compare.contenders import Contender
from mrdamp.compare.frame import FrameBench
from mrdamp.compare.runner import How, run_all
from mrdamp.compare.tuning import Loops
from mrdamp.control import registry
from mrdamp.model import Model
from mrdamp.motions import GroundMotion

PARTS = ("stiffness", "mass")


def scaled(model: Model, part: str, factor: float) -> Model:
    """The model of a frame with the stiffness of every storey, or the mass of every floor, times a factor."""
    assert model.structure is not None
    return replace(model, structure=replace(model.structure, **{part: factor * getattr(model.structure, part)}))


class _Case(NamedTuple):
    """A controller, all of its seeds, on rows of one of several structures."""

    bench: FrameBench
    row: Contender
    loads: tuple[GroundMotion, ...]
    amplitudes: tuple[float, ...]

    def key(self) -> str:
        cases = itertools.product(self.row.specs, self.loads, self.amplitudes)
        return digest(["rows", *(self.bench.key(*case) for case in cases)])

    def run(self) -> dict[str, Any]:
        loads = [self.bench.played(load, a) for load in self.loads for a in self.amplitudes]
        found = Loops(self.bench, loads, len(self.row.specs)).run(
            [self.bench.controller(spec) for spec in self.row.specs]
        )
        return {key: values.tolist() for key, values in found.items()}


def on_rows(
    benches: Mapping[str, FrameBench],
    rows: Sequence[Contender],
    loads: Sequence[GroundMotion],
    amplitudes: Sequence[float],
    **how: Unpack[How],
) -> dict[str, Comparison]:
    """Comparisons on several benches, whose measures are those that make the objective."""
    shape = len(loads), len(amplitudes)
    tasks = [_Case(bench, row, tuple(loads), tuple(amplitudes)) for bench in benches.values() for row in rows]
    results = iter(run_all(tasks, "structures", **how))
    found = {}
    for name, bench in benches.items():
        values = {
            row.name: {key: np.array(each).reshape(-1, *shape) for key, each in next(results).items()} for row in rows
        }
        found[name] = Comparison(
            tuple(rows), tuple(m for m in bench.measures if m.key in bench.objective), tuple(m.name for m in loads),
            tuple(amplitudes), values, base=bench.base,
            objective={key: weight for key, (_, weight) in bench.objective.items()},
        )  # fmt: skip
    return found


def with_spread(
    bench: FrameBench,
    result: Comparison,
    loads: Sequence[GroundMotion],
    percent: Sequence[float],
    **how: Unpack[How],
) -> Comparison:
    """The comparison, with `others`: stiffness and mass less and more by each percentage, on rows of the chain.

    percent: above 0 and below 100.
    """
    # An ideal actuator is no damper, and rows have dampers.
    rows = [c for c in result.contenders if not c.bound and not registry.is_ideal(c.specs[0])]
    if result.base not in [c.name for c in rows]:
        rows.insert(0, Contender(result.base, (result.base,)))
    signed, told = sorted({sign * p for p in percent for sign in (-1, 1)}), bench.told or bench.model
    benches = {
        f"{part} {p:+g} %": replace(bench, model=scaled(bench.model, part, 1 + p / 100), told=told)
        for part in PARTS
        for p in signed
    }
    others = on_rows(benches, rows, loads, result.amplitudes, **how)
    return replace(result, others=others)
