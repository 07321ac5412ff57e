"""Controllers tuned on loads of their own: a grid over the options of each kind, evaluated by the bench's score."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mrdamp.compare.bench import UNCONTROLLED, Bench, Load
from mrdamp.compare.runner import Progress, run_all
from mrdamp.errors import InputError
from mrdamp.files import write_atomic


class Run(NamedTuple):
    """One run of a bench."""

    spec: str
    load: Load
    amplitude: float


@dataclass(frozen=True)
class Runs:
    """Runs of one bench, for `run_all`."""

    bench: Bench

    def key(self, task: Run) -> str:
        return self.bench.key(task.spec, task.load, task.amplitude)

    def run(self, task: Run) -> dict[str, Any]:
        return self.bench.run(task.spec, task.load, task.amplitude)


@dataclass(frozen=True)
class Setting:
    """A tuned controller: its spec, and the score that it had on the tuning loads."""

    spec: str
    score: float


def run_grid(
    bench: Bench,
    specs: Sequence[str],
    cases: Sequence[tuple[Load, float]],
    *,
    jobs: int = 1,
    keep: Path | None = None,
    progress: Progress | None = None,
    what: str = "runs",
) -> dict[str, list[Mapping[str, float]]]:
    """Every measure of every spec on every case of load and amplitude. jobs, keep: see `run_all`."""
    rows = list(dict.fromkeys([UNCONTROLLED, *specs]))
    tasks = [Run(spec, load, amplitude) for spec in rows for load, amplitude in cases]
    found = run_all(Runs(bench), tasks, jobs=jobs, keep=keep, progress=progress, what=what)
    parts = [found[k : k + len(cases)] for k in range(0, len(found), len(cases))]
    return {
        spec: [bench.values(kept, without) for kept, without in zip(part, parts[0], strict=True)]
        for spec, part in zip(rows[1:], parts[1:], strict=True)
    }


def tune(
    bench: Bench,
    names: Sequence[str] | None = None,
    *,
    jobs: int = 1,
    keep: Path | None = None,
    progress: Progress | None = None,
) -> dict[str, Setting]:
    """The best setting of each named controller, of all that are tuned by default. keep: see `run_all`."""
    cases = list(itertools.product(bench.tuning_loads(), bench.tuning_amplitudes))
    grids = {name: bench.grid(bench.tuned[name]) for name in (bench.tuned if names is None else names)}
    tried = list(dict.fromkeys(itertools.chain(*grids.values())))
    values = run_grid(bench, tried, cases, jobs=jobs, keep=keep, progress=progress, what="tuning")
    scores = {spec: float(np.mean([bench.score(v) for v in rows])) for spec, rows in values.items()}
    best = {name: min(specs, key=scores.__getitem__) for name, specs in grids.items()}
    return {name: Setting(spec, scores[spec]) for name, spec in best.items()}


def shipped(bench: Bench) -> dict[str, Setting] | None:
    """The settings that come with the package, None where they belong to another bench."""
    file = resources.files("mrdamp") / "data" / "controllers" / f"{bench.environment}.json"
    return _of(json.loads(file.read_text(encoding="utf-8")), bench) if file.is_file() else None


def read_settings(path: Path, bench: Bench) -> dict[str, Setting] | None:
    """Settings of an earlier run, None where there are none or they belong to another bench."""
    try:
        return _of(json.loads(path.read_text(encoding="utf-8")), bench)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def to_dict(settings: Mapping[str, Setting], bench: Bench) -> dict[str, Any]:
    """For JSON."""
    return {
        "identity": bench.identity(),
        "loads": [load.name for load in bench.tuning_loads()],
        "amplitudes": list(bench.tuning_amplitudes),
        "settings": {name: vars(setting) for name, setting in settings.items()},
    }


def _of(data: Mapping[str, Any], bench: Bench) -> dict[str, Setting] | None:
    if data["identity"] != bench.identity():
        return None
    return {name: Setting(**setting) for name, setting in data["settings"].items()}


def settings_for(
    bench: Bench,
    names: Sequence[str],
    *,
    anew: bool = False,
    needed: bool = True,
    file: Path | None = None,
    jobs: int = 1,
    keep: Path | None = None,
    progress: Progress | None = None,
) -> dict[str, Setting]:
    """Of the tuned controllers among names: as shipped, as they are in a file, or (anew) tuned now and written there.

    needed: without any it is an error, else the answer is empty. Raises InputError.
    """
    wanted = [name for name in names if name.rpartition("=")[2] in bench.tuned]
    if not wanted:
        return {}
    if anew:
        found = tune(bench, jobs=jobs, keep=keep, progress=progress)
        if file is not None:
            write_atomic(file, json.dumps(to_dict(found, bench), indent=1) + "\n")
        return found
    settings = shipped(bench)
    if settings is None and file is not None:
        settings = read_settings(file, bench)
    if settings is None and needed:
        raise InputError(f"{wanted[0]}: not tuned for this model yet; add --tune (some minutes, kept in -o OUT)")
    return settings or {}
