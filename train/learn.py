"""One training from its options to the files in its folder."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.parallel import Progress, silent
from mrdamp.train.run import Result, Run, reading, require_policy
from mrdamp.train.settings import Options, Settings, settings


def train(options: Options, out: Path | str, progress: Progress | None = None) -> Result:
    """Trains into the folder `out`; continues from its checkpoint, and does nothing where it is done already.

    More control periods than it was begun with extend it, a finished one too. Raises InputError where `out` holds a
    training with other options.
    """
    out = Path(out)
    chosen = settings(options)
    own = json.loads(json.dumps({"options": options.to_dict(), "settings": asdict(chosen)}))
    files = _files(options)
    if files:
        own["files"] = files
    claim, finished = out / "options.json", out / "training.json"
    held = _read(claim, "settings", "options") if claim.is_file() else own
    changed = [name for name, digest in files.items() if held.get("files", {}).get(name, digest) != digest]
    if changed:
        raise InputError(f"{out}: holds a training with another content of {changed[0]}; choose another folder")
    if _without_length(held) != _without_length(own) or chosen.n_timesteps < held["settings"]["n_timesteps"]:
        raise InputError(f"{out}: holds a training with other options, or a longer one; choose another folder")
    if finished.is_file() and held == own:
        kept = _read(finished, "curve", "seconds")
        require_policy(out)
        return Result(out, tuple(kept["curve"]), kept["seconds"])
    run = _run(options, chosen, out)
    out.mkdir(parents=True, exist_ok=True)
    finished.unlink(missing_ok=True)
    write_atomic(run.matrix_file, lambda file: np.save(file, run.matrix))
    write_atomic(claim, json.dumps(own, indent=1) + "\n")
    run.learn(progress or silent)
    write_atomic(finished, json.dumps({"curve": run.curve, "seconds": run.seconds()}, indent=1) + "\n")
    return Result(out, tuple(run.curve), run.seconds())


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
