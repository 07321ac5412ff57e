"""Trainings over seeds and settings, in processes of this machine or of a Ray cluster, and their curves."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.parallel import mapped
from mrdamp.train.learn import train
from mrdamp.train.reporting import Left, watched
from mrdamp.train.run import Progress, Result
from mrdamp.train.settings import Options, folder_name, settings


@dataclass(frozen=True)
class Setting:
    """One point of a sweep: its overrides, and the trainings of its seeds."""

    overrides: tuple[str, ...]
    results: tuple[Result, ...]

    def score(self) -> float:
        """Mean over seeds of the best validation score."""
        return float(np.mean([r.best["score"] for r in self.results]))


def points(choices: Sequence[str]) -> list[tuple[str, ...]]:
    """Overrides of each point of the grid of `NAME=VALUE,VALUE,...`. Raises InputError."""
    axes = []
    for choice in choices:
        name, equals, values = choice.partition("=")
        if not equals or not all(values.split(",")):
            raise InputError(f"sweep {choice!r}; allowed: NAME=VALUE,VALUE,...")
        axes.append([f"{name}={value}" for value in values.split(",")])
    return list(itertools.product(*axes))


def sweep(
    options: Options,
    out: Path,
    seeds: Sequence[int],
    choices: Sequence[str] = (),
    jobs: int = 1,
    progress: Progress | None = None,
) -> list[Setting]:
    """Trains every seed of every point of the grid into `out`, and writes sweep.json there.

    Trainings that are done are taken as they are; the numbers do not depend on jobs. Raises InputError before the first
    training where a point's hyperparameters are not allowed.
    """
    grid = points(choices)
    tasks = []
    for overrides in grid:
        chosen = replace(options, overrides=(*options.overrides, *overrides))
        settings(chosen)
        folder = out / folder_name(overrides) if choices else out
        tasks += [(replace(chosen, seed=seed), folder / f"seed_{seed}") for seed in seeds]
    if jobs == 1:
        results = list(mapped(train, [(*task, progress) for task in tasks]))
    else:
        with watched([folder for _, folder in tasks], progress):
            results = list(mapped(train, [(*task, Left(task[1])) for task in tasks], jobs))
    n = len(seeds)
    found = [Setting(overrides, tuple(results[k * n : (k + 1) * n])) for k, overrides in enumerate(grid)]
    rows = [
        {
            "overrides": list(point.overrides),
            "score": point.score(),
            "seeds": [
                {"seed": s, "seconds": r.seconds, **r.best} for s, r in zip(seeds, point.results, strict=True)
            ],
        }
        for point in found
    ]
    write_atomic(out / "sweep.json", json.dumps(rows, indent=1) + "\n")
    return found
