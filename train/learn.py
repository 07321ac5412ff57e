"""Trainings from their options to the files in their folders: one, or over seeds and settings, and their curves."""

from __future__ import annotations

import hashlib
import itertools
import json
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mrdamp.errors import InputError
from mrdamp.files import differing, write_atomic
from mrdamp.model.core import Array
from mrdamp.parallel import Progress, mapped, silent
from mrdamp.pictures import style
from mrdamp.train.run import Result, Run, reading, require_policy
from mrdamp.train.settings import Options, Settings, settings

_CLAIM, _FINISHED = "options.json", "training.json"
#: Options that are a seed's, or that the settings hold.
_OWN = ("seed", "timesteps", "overrides", "hyperparameters")


def train(options: Options, out: Path | str, progress: Progress | None = None) -> Result:
    """Trains into the folder `out`; continues from its checkpoint, and does nothing where it is done already.

    More control periods than it was begun with extend it, a finished one too. Raises InputError where `out` holds a
    training with other options.
    """
    out = Path(out)
    chosen, own = settings(options), _claim(options)
    files = own.get("files", {})
    claim, finished = out / _CLAIM, out / _FINISHED
    held = _read(claim, "settings", "options") if claim.is_file() else own
    changed = [name for name, digest in files.items() if held.get("files", {}).get(name, digest) != digest]
    if changed:
        raise InputError(f"{out}: holds a training with another content of {changed[0]}; choose another folder")
    if _without_length(held) != _without_length(own) or chosen.n_timesteps < held["settings"]["n_timesteps"]:
        raise InputError(f"{out}: holds a training with other options, or a longer one; choose another folder")
    if finished.is_file() and held == own:
        return _done(out)
    run = _run(options, chosen, out)
    out.mkdir(parents=True, exist_ok=True)
    finished.unlink(missing_ok=True)
    write_atomic(run.matrix_file, lambda file: np.save(file, run.matrix))
    write_atomic(claim, json.dumps(own, indent=1) + "\n")
    run.learn(progress or silent)
    write_atomic(finished, json.dumps({"curve": run.curve, "seconds": run.seconds()}, indent=1) + "\n")
    return Result(out, tuple(run.curve), run.seconds())


def _claim(options: Options) -> dict[str, Any]:
    """What a training's folder says of it."""
    files = _files(options)
    own = {"options": options.to_dict(), "settings": asdict(settings(options))} | ({"files": files} if files else {})
    return dict(json.loads(json.dumps(own)))


def _done(out: Path) -> Result:
    kept = _read(out / _FINISHED, "curve", "seconds")
    require_policy(out)
    return Result(out, tuple(kept["curve"]), kept["seconds"])


def _require_alike(options: Options, folder: Path, seeds: Sequence[int]) -> None:
    """InputError where another seed in the folder has other options: `compare` takes all as seeds of one training.
    Those of the seeds that are asked for may be shorter."""
    own = _of_all_seeds(_claim(options))
    for file in sorted(folder.glob(f"seed_*/{_CLAIM}")):
        held = _of_all_seeds(_read(file, "settings", "options"))
        if file.parent.name in {f"seed_{seed}" for seed in seeds}:
            held["n_timesteps"] = own["n_timesteps"]
        if (other := next(differing(held, own), None)) is not None:
            name = other.removeprefix("learner.")
            raise InputError(f"{folder}: {name} is another one in {file.parent.name}; choose another folder")


def _of_all_seeds(claim: Mapping[str, Any]) -> dict[str, Any]:
    """Without the seed, and what the settings hold."""
    options = {name: v for name, v in claim["options"].items() if name not in _OWN}
    return {**options, **claim["settings"], "content": claim.get("files", {})}


def _read(file: Path, *needed: str) -> dict[str, Any]:
    """InputError where a file of the folder is damaged. needed: what it holds."""
    with reading(file):
        found = dict(json.loads(file.read_text(encoding="utf-8")))
        return {**found, **{name: found[name] for name in needed}}


def _files(options: Options) -> dict[str, str]:
    """Digests of the files that the options name: a structure of one's own, a model, motions."""
    found: dict[str, str] = {}

    def look(value: Any) -> None:
        if isinstance(value, Mapping):
            for each in value.values():
                look(each)
        elif isinstance(value, (list, tuple)):
            for each in value:
                look(each)
        elif isinstance(value, (str, Path)):
            file = Path(str(value).rpartition(":")[0] if ".py:" in str(value) else value)
            if file.is_file():
                found[str(value)] = hashlib.sha256(file.read_bytes()).hexdigest()

    look(json.loads(json.dumps(options.to_dict(), default=str)))
    return found


def _without_length(claim: Mapping[str, Any]) -> dict[str, Any]:
    """Options and settings but for how many control periods there are."""
    options, chosen = claim["options"], claim["settings"]
    return {"options": {**options, "timesteps": None}, "settings": {**chosen, "n_timesteps": None}}


def _run(options: Options, chosen: Settings, out: Path) -> Run:
    if options.algorithm == "es":
        from mrdamp.train.search import EvolutionRun

        return EvolutionRun(options, chosen, out)
    try:
        if options.algorithm == "adjoint":
            from mrdamp.train.adjoint import AdjointRun

            return AdjointRun(options, chosen, out)
        from mrdamp.train.gradient import GradientRun
    except ImportError as error:
        raise InputError(
            f"{options.algorithm} needs {error.name}, which is not installed: pip install 'mrdamp[train]'"
        ) from None
    return GradientRun(options, chosen, out, chosen.n_envs)


#: Trainings in other processes leave their share in a file, which who started them reads.
_FILE = "progress.txt"
_EVERY = 1.0  # s, between two looks, and between two writings


@dataclass(frozen=True)
class Setting:
    """One point of a sweep: its overrides, and its trainings by seed."""

    overrides: tuple[str, ...]
    seeds: Mapping[int, Result]

    @property
    def results(self) -> tuple[Result, ...]:
        return tuple(self.seeds.values())

    def score(self) -> float:
        """Mean over seeds of the best validation score."""
        return float(np.mean([r.best["score"] for r in self.results]))


def points(choices: Sequence[str]) -> list[tuple[str, ...]]:
    """Overrides of each point of the grid of `NAME=VALUE,VALUE,...`. Raises InputError."""
    axes = []
    for choice in choices:
        name, equals, text = choice.partition("=")
        values = _values(text)
        if not equals or not all(values):
            raise InputError(f"sweep {choice!r}; allowed: NAME=VALUE,VALUE,...")
        if len(set(values)) < len(values):
            raise InputError(f"sweep {choice!r}: a value is given twice")
        axes.append([f"{name}={value}" for value in values])
    return list(itertools.product(*axes))


def _values(text: str) -> list[str]:
    """Between the commas that are outside of brackets."""
    found, depth = [""], 0
    for c in text:
        depth += (c in "[{(") - (c in "]})")
        if c == "," and depth == 0:
            found.append("")
        else:
            found[-1] += c
    return found


def sweep(
    options: Options,
    out: Path,
    seeds: Sequence[int],
    choices: Sequence[str] = (),
    jobs: int = 1,
    progress: Progress | None = None,
) -> list[Setting]:
    """Trains every seed of every point of the grid into `out`, and writes sweep.json there.

    Trainings that are done are taken as they are, those of further seeds in the folders too; the numbers do not depend
    on jobs. Raises InputError before the first training where a point's hyperparameters are not allowed, or where its
    folder holds a seed with others.
    """
    grid = points(choices)
    tasks = []
    for overrides in grid:
        chosen = replace(options, overrides=(*options.overrides, *overrides))
        settings(chosen)
        folder = out / ",".join(value.replace("/", "-") for value in overrides) if choices else out
        _require_alike(chosen, folder, seeds)
        tasks += [(replace(chosen, seed=seed), folder / f"seed_{seed}") for seed in seeds]
    if jobs == 1:
        results = list(mapped(train, [(*task, progress) for task in tasks]))
    else:
        with watched([folder for _, folder in tasks], progress):
            results = list(mapped(train, [(*task, Left(task[1])) for task in tasks], jobs))
    n = len(seeds)
    found = [Setting(overrides, _seeds(results[k * n : (k + 1) * n])) for k, overrides in enumerate(grid)]
    rows = [
        {
            "overrides": list(point.overrides),
            "score": point.score(),
            "seeds": [{"seed": s, "seconds": r.seconds, **r.best} for s, r in point.seeds.items()],
        }
        for point in found
    ]
    write_atomic(out / "sweep.json", json.dumps(rows, indent=1) + "\n")
    return found


def _seeds(results: Sequence[Result]) -> dict[int, Result]:
    """Those of one point, and of further seeds in its folder whose trainings are done, in their order."""
    known = {r.folder.name: r for r in results}
    for file in results[0].folder.parent.glob(f"seed_*/{_FINISHED}"):
        name = file.parent.name
        if name not in known and name.removeprefix("seed_").isdecimal():
            known[name] = _done(file.parent)
    numbers = {int(name.removeprefix("seed_")): r for name, r in known.items()}
    return dict(sorted(numbers.items()))


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
    if (folder / _FINISHED).is_file():
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


def curve(result: Result) -> Figure:
    return curves([result])


def _axes(height: float) -> tuple[Figure, Axes]:
    fig = style.figure(height * style.WIDTH)
    axes = fig.add_subplot()
    axes.set_xlabel("control periods (millions)")
    axes.set_ylabel("validation score")
    return fig, axes


def _shared(results: Sequence[Result]) -> tuple[Array, Array]:
    """Mean millions of control periods (n,) and scores (seeds, n) at the evaluations that all have."""
    rows = [r.curve[: min(len(result.curve) for result in results)] for r in results]
    at, scores = (np.array([[row[name] for row in curve] for curve in rows]) for name in ("timesteps", "score"))
    return (at / 1e6).mean(axis=0), scores


@style.styled
def curves(results: Sequence[Result]) -> Figure:
    """One thin line a seed, a thick one their mean at the evaluations that all have."""
    fig, axes = _axes(0.55)
    for result in results:
        at, scores = _shared([result])
        axes.plot(at, scores[0], color=style.COLOURS[0], linewidth=0.7, alpha=0.6)
    at, scores = _shared(results)
    axes.plot(at, scores.mean(axis=0), color=style.COLOURS[1], linewidth=1.8)
    return fig


@style.styled
def compared(named: Mapping[str, Sequence[Result]]) -> Figure:
    """One line a setting: the mean over its seeds at the evaluations that all have, and the seeds' range around it."""
    fig, axes = _axes(0.6)
    for k, (name, results) in enumerate(named.items()):
        colour = style.COLOURS[k % len(style.COLOURS)]
        at, scores = _shared(results)
        axes.plot(at, scores.mean(axis=0), color=colour, linewidth=1.6, label=name)
        if len(results) > 1:
            axes.fill_between(at, scores.min(axis=0), scores.max(axis=0), color=colour, alpha=0.15, linewidth=0)
    axes.legend()
    return fig
