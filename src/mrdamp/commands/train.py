"""`mrdamp train`: a learned controller, by an evolution strategy or stable-baselines3, over seeds and settings."""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrdamp.commands import OutFolder, add_command, progress_bar, save_picture
from mrdamp.errors import InputError

if TYPE_CHECKING:
    from mrdamp.train.learn import Setting

_ALGORITHMS = ("ppo", "recurrent", "sac", "td3", "a2c", "ddpg", "es", "adjoint")
_WHOLE = "a learner takes whole generations or rollouts"


def add_to(commands: Any) -> None:
    """Adds `train`."""
    p = add_command(
        commands,
        "train",
        run_train,
        "train a controller in an environment, and export it for NumPy alone",
        "mrdamp train mrdamp/Frame-v0 --seeds 5 --jobs 2 -o out/frame",
    )
    p.add_argument("environment", help="mrdamp/Frame-v0, mrdamp/Cable-v0, mrdamp/QuarterCar-v0, or file.py:NAME")
    p.add_argument(
        "--algo", default="es", choices=_ALGORITHMS,
        help="stable-baselines3 (recurrent: sb3-contrib), es: evolution strategy, adjoint: gradients through the "
        "chain, frame alone (default: %(default)s)",
    )  # fmt: skip
    p.add_argument("--seed", type=int, default=0, help="the first seed (default: %(default)s)")
    p.add_argument("--seeds", type=int, default=1, help="how many (default: %(default)s)")
    p.add_argument("--timesteps", type=int, help="control periods (default: the hyperparameters')")
    p.add_argument(
        "--hyperparameters", type=Path, help="YAML keyed by environment id (default: the package's)"
    )
    p.add_argument(
        "--set", nargs="*", default=[], metavar="NAME=VALUE", help="override some, as learning_rate=3e-4"
    )
    p.add_argument(
        "--sweep", nargs="*", default=[], metavar="NAME=VALUE,VALUE", help="train every combination of these"
    )
    p.add_argument(
        "--model", type=Path, nargs="+", default=[], metavar="FILE",
        help="model file of the damper (default: the environment's); es: several, for robustness over all",
    )  # fmt: skip
    p.add_argument(
        "--evaluations",
        type=int,
        default=10,
        help="evaluations on validation loads, with checkpoints (default: %(default)s)",
    )
    p.add_argument(
        "--jobs", type=int, default=1, metavar="N", help="processes; the answer is the same (default: %(default)s)"
    )
    p.add_argument(
        "--backend", choices=("loky", "ray"), default="loky",
        help="of --jobs: local processes, or a Ray cluster (extra `cluster`; RAY_ADDRESS: a running one)",
    )  # fmt: skip
    p.add_argument(
        "-o", "--out", type=OutFolder, required=True, help="folder to write; an interrupted run continues"
    )


def run_train(a: argparse.Namespace) -> int:
    """Trains, and prints the validation figures of every seed."""
    from mrdamp.files import together
    from mrdamp.train.learn import compared, sweep
    from mrdamp.train.settings import Options, settings

    if a.seeds < 1:
        raise InputError("--seeds must be at least 1")
    options = Options(
        a.environment, a.algo, a.seed, a.timesteps, a.hyperparameters, tuple(a.set),
        a.model[0] if a.model else None, a.evaluations, tuple(a.model[1:]),
    )  # fmt: skip
    if a.backend != "loky":
        os.environ["MRDAMP_BACKEND"] = a.backend
    seeds = range(a.seed, a.seed + a.seeds)
    with progress_bar() as progress:
        found = sweep(options, a.out, seeds, a.sweep, a.jobs, progress)
    with together():
        for point in found:
            asked = settings(replace(options, overrides=(*options.overrides, *point.overrides))).n_timesteps
            _print(point, list(seeds), asked)
        if len(found) > 1:
            named = {" ".join(point.overrides): point.results for point in found}
            save_picture(compared(named), a.out / "curves.png")
    return 0


def _print(point: Setting, seeds: list[int], asked: int) -> None:
    """asked: control periods."""
    from mrdamp.train.learn import curves

    if point.overrides:
        print(f"{' '.join(point.overrides)}: mean score {point.score():.4f}")
    names = [name for name in point.results[0].best if name != "timesteps"]
    print(f"{'seed':>6s} {'periods':>10s} " + " ".join(f"{name:>18s}" for name in names) + f" {'CPU s':>8s}")
    for seed, result in zip(seeds, point.results, strict=True):
        best = result.best
        values = " ".join(f"{best[name]:18.4f}" for name in names)
        print(f"{seed:6d} {best['timesteps']:10.0f} {values} {result.seconds:8.0f}")
        if best["timesteps"] == 0:
            print(f"mrdamp: seed {seed}: its policy is untrained, no evaluation beats the start", file=sys.stderr)
        if (done := result.curve[-1]["timesteps"]) > asked:
            print(f"mrdamp: seed {seed}: {done:.0f} periods, not {asked}: {_WHOLE}", file=sys.stderr)
    folder = point.results[0].folder.parent
    print(f"policies: {folder}/seed_*/policy.json")
    save_picture(curves(point.results), folder / "curves.png")
