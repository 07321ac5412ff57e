"""Trainings over seeds and settings, in processes of this machine or of a Ray cluster, and their curves."""

from __future__ import annotations

import itertools
import json
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.parallel import Progress, mapped
from mrdamp.train.learn import train
from mrdamp.train.run import Result
from mrdamp.train.settings import Options, folder_name, settings

#: Trainings in other processes leave their share in a file, which who started them reads.
_FILE = "progress.txt"
_EVERY = 1.0  # s, between two looks, and between two writings


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


@dataclass
class Left:
    """A `Progress` that leaves the share in the folder, once a second at most."""

    folder: Path
    _last: float = field(default=-1e9, init=False)

    def __call__(self, what: str, share: float) -> None:
        if time.monotonic() - self._last >= _EVERY and self.folder.is_dir():
            self._last = time.monotonic()
            (self.folder / _FILE).write_text(f"{share:.4f}\n")


def share(folder: Path) -> float:
    """Of the training in a folder: 0 before its first word, 1 when it is done."""
    if (folder / "training.json").is_file():
        return 1.0
    try:
        return float((folder / _FILE).read_text())
    except (OSError, ValueError):  # not yet, or just being written
        return 0.0


@contextmanager
def watched(folders: Sequence[Path], progress: Progress | None) -> Iterator[None]:
    """Meanwhile, progress reports every second how many of the trainings are done, in tenths."""
    stop = threading.Event()

    def look() -> None:
        while not stop.wait(_EVERY):
            tell(folders, progress)

    thread = threading.Thread(target=look, daemon=True)
    if progress is not None:
        thread.start()
    try:
        yield
    finally:
        stop.set()
        if progress is not None:
            thread.join()
            tell(folders, progress)


def tell(folders: Sequence[Path], progress: Progress | None) -> None:
    """Says how many of the trainings in these folders are done."""
    done = sum(map(share, folders))
    if progress is not None:
        progress(f"train: {done:.1f} of {len(folders)} trainings", done / len(folders))
