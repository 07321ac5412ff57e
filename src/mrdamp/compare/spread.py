"""The same comparison on frames whose stiffness or mass is not what controllers are told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mrdamp.compare.bench import Load
from mrdamp.compare.comparison import Comparison, compare
from mrdamp.compare.contenders import Contender
from mrdamp.compare.frame import FrameBench
from mrdamp.compare.runner import Progress
from mrdamp.errors import InputError
from mrdamp.model import Model

PARTS = ("stiffness", "mass")


def scaled(model: Model, part: str, factor: float) -> Model:
    """The model of a frame with the stiffness of every storey, or the mass of every floor, times a factor."""
    assert model.structure is not None
    return replace(model, structure=replace(model.structure, **{part: factor * getattr(model.structure, part)}))


def with_spread(
    bench: FrameBench,
    result: Comparison,
    loads: Sequence[Load],
    percent: Sequence[float],
    *,
    jobs: int = 1,
    keep: Path | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """The comparison, with `others`: stiffness and mass less and more by each of some percentages.

    jobs, keep: see `mrdamp.compare.runner.run_all`. Raises InputError for a percentage outside 0 to 100.
    """
    for p in percent:
        if not 0 < p < 100:
            raise InputError(f"--spread {p:g}; allowed: percentages above 0 and below 100")
    rows = [c for c in result.contenders if not c.bound]
    if result.base not in [c.name for c in rows]:
        rows.insert(0, Contender(result.base, (result.base,)))
    told = bench.told or bench.model
    others = {}
    for part in PARTS:
        for p in sorted({sign * p for p in percent for sign in (-1, 1)}):
            other = replace(bench, model=scaled(bench.model, part, 1 + p / 100), told=told)
            others[f"{part} {p:+g} %"] = compare(
                other, rows, loads, result.amplitudes, jobs=jobs, keep=keep, progress=progress
            )
    return replace(result, others=others)
