"""The commands `mrdamp compare` and `mrdamp train`.

compare: controllers on motions they were not tuned on, or a published table. train: a learned controller, by an
evolution strategy or stable-baselines3, over seeds and settings.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrdamp.commands import (
    OutFolder,
    add_command,
    add_jobs,
    add_json,
    progress_bar,
    refuse_unused,
    save_picture,
    silent_output,
)
from mrdamp.errors import InputError
from mrdamp.files import together, write_atomic

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from mrdamp.compare.bench import Bench
    from mrdamp.compare.comparison import Comparison
    from mrdamp.compare.tuning import Setting
    from mrdamp.report import Page
    from mrdamp.train.learn import Setting as Trained

_PRESETS = "dyke1996", "cable"
#: Options in the page's command, and those among them that have a default.
_SHOWN = (
    "controllers", "motions", "speed", "amplitudes", "compression", "model", "dampers", "told", "spread",
    "command_unit", "period", "engine", "bound",
)  # fmt: skip
_USUAL = {"engine": "mujoco"}
_ALGORITHMS = ("ppo", "recurrent", "sac", "td3", "a2c", "ddpg", "es", "adjoint")
_WHOLE = "a learner takes whole generations or rollouts"


def add_to(commands: Any) -> None:
    _add_compare(commands)
    _add_train(commands)


def _add_compare(commands: Any) -> None:
    p = add_command(
        commands,
        "compare",
        run_compare,
        "controllers x motions x amplitudes -> one table with intervals, and a page",
        "mrdamp compare frame --motions records/*.AT2 --controllers passive-on best-constant policy:seeds/",
    )
    p.add_argument(
        "environment", nargs="?", default="frame", help="frame (default), cable or car, their ids, or file.py:NAME"
    )
    p.add_argument("--preset", choices=_PRESETS, help="a published table in place of a comparison")
    p.add_argument(
        "--controllers",
        nargs="+",
        metavar="NAME",
        help="names, NAME=KIND:key=value,..., NAME=policy:FILES (several are seeds), or your own: NAME=module:CLASS, "
        "NAME=file.py:CLASS, NAME=model.zip (default: all but your own)",
    )
    p.add_argument(
        "--motions", nargs="+", type=Path, metavar="FILE", help="CSV or AT2 files, folders; roads as CSV"
    )
    p.add_argument(
        "--speed", type=float, metavar="M/S", help="on road files (default: 20)"
    )
    p.add_argument("--amplitudes", nargs="+", type=float, metavar="A", help="factors on every motion")
    p.add_argument(
        "--compression", type=float, metavar="K",
        help="ground motions K times as fast (default: 5, as published; full size: 1)",
    )  # fmt: skip
    p.add_argument(
        "--model", type=Path, help="model file of a damper or of a frame with one, or a set's name (default: published)"
    )
    p.add_argument(
        "--dampers", nargs="+", type=_places, metavar="A-B",
        help="floors between which a frame has dampers, as 0-1 1-2 (0: the ground)",
    )  # fmt: skip
    p.add_argument(
        "--told", type=Path, metavar="FILE",
        help="model file of the frame that controllers know, as a diagnosis writes it (default: the true one)",
    )  # fmt: skip
    p.add_argument(
        "--spread", nargs="+", type=float, metavar="PERCENT",
        help="repeat with so much less and more stiffness, and mass, than controllers know",
    )  # fmt: skip
    p.add_argument(
        "--command-unit", choices=("A", "V"),
        help="of the command (default: V; with --model that of the parameter set of its name, else A)",
    )  # fmt: skip
    p.add_argument(
        "--period", type=float, metavar="MS", help="of control (default: 1 ms on the frame, else 5 ms)"
    )
    p.add_argument(
        "--engine", choices=("mujoco", "chain"), default=_USUAL["engine"],
        help="MuJoCo, or the plugin's chain without it (default: %(default)s)",
    )  # fmt: skip
    p.add_argument(
        "--bound", nargs="?", type=int, const=1, metavar="N",
        help="add the best commands for motions known in advance, searched from the N best runs of each case (1)",
    )  # fmt: skip
    p.add_argument("--tune", action="store_true", help="tune the named controllers anew, on loads of their own")
    add_jobs(p, default=-1)
    add_json(p)
    p.add_argument(
        "-o", "--out", type=OutFolder, help="folder to write; an interrupted run continues, but not a file.py:Class"
    )


def run_compare(a: argparse.Namespace) -> int:
    if a.preset:
        shown = dict.fromkeys(_SHOWN) | _USUAL | {"tune": False}
        if a.preset == "dyke1996":
            del shown["motions"]  # one of its own may be given
        refuse_unused(a, f"has no effect on --preset {a.preset}", **shown)
    if a.preset == "dyke1996":
        return _dyke1996(a)
    if a.preset == "cable":
        return _cable_reference(a)
    with silent_output() if a.json else nullcontext():
        text = _compare(a)
    print(text)
    return 0


def _compare(a: argparse.Namespace) -> str:
    from mrdamp.compare import tables
    from mrdamp.compare.benches import bench_of, compared
    from mrdamp.compare.frame import FrameBench
    from mrdamp.compare.page import paths_picture, shares_picture, write_comparison
    from mrdamp.envs.training_loads import doubtful
    from mrdamp.motions import GroundMotion

    period = None if a.period is None else 1e-3 * a.period
    bench = bench_of(
        a.environment,
        a.model,
        command_unit=a.command_unit,
        period=period,
        engine=a.engine,
        compression=a.compression,
        dampers=a.dampers or (),
        told=a.told,
    )
    if a.spread and not isinstance(bench, FrameBench):
        raise InputError("--spread is for a frame; leave it out")
    for percent in a.spread or ():
        if not 0 < percent < 100:
            raise InputError(f"--spread {percent:g}; allowed: percentages above 0 and below 100")
    if a.bound is not None and a.bound < 1:
        raise InputError(f"--bound is {a.bound}; allowed: 1 or more")
    if a.bound is not None and (a.dampers or ())[1:]:
        raise InputError("--bound is for one damper; leave it out")
    if a.speed is not None and not (a.motions and bench.structure.option == "road"):
        raise InputError("--speed is for files of roads (--motions); leave it out")
    loads = bench.read(a.motions, 20.0 if a.speed is None else a.speed) if a.motions else None
    for check in (said for load in loads or () if isinstance(load, GroundMotion) for said in doubtful(load)):
        print(f"check: {check}", file=sys.stderr)
    keep = a.out / "kept.jsonl" if a.out and bench.continues else None
    with progress_bar() as progress:
        result, loads, settings = compared(
            bench, a.controllers, loads, a.amplitudes, tune=a.tune, tuned=a.out and a.out / "tuned.json",
            percent=a.spread, bound=a.bound, jobs=a.jobs, keep=keep, progress=progress,
        )  # fmt: skip
        about = _about(bench, result, settings)
        noted = " ".join([about, *(f"Note: {note}." for note in result.notes)])
        if a.out:
            progress("page", 1.0)
            with together():
                page = write_comparison(a.out, bench, result, loads, noted, _command(a))
                if result.bounds and not a.json:  # which is printed alone
                    save_picture(shares_picture(result), a.out / "shares.png")
                    save_picture(paths_picture(result), a.out / "paths.png")
    for note in result.notes:
        print(f"mrdamp: {note}", file=sys.stderr)
    if a.json:
        return tables.to_json(result, bench.command_unit, noted).rstrip()
    said = [
        tables.means(result, bench, bench.headline).aligned(),
        f"mean (worst) over motions or loads and amplitudes; ratios are over {bench.reference}",
    ]
    more = [tables.spread(result)] if result.others else []
    more += [tables.shares(result)] if result.bounds else []
    for table in more:
        said += [table.aligned(), table.note]
    said.append(about)
    if not settings and not a.controllers:
        said.append("tuned controllers are left out: there are no settings for this model; add --tune")
    if a.out:
        said.append(f"page: {page}")
    return "\n".join(said)


def _places(text: str) -> tuple[int, int]:
    """A pair of floors, `0-1`."""
    lower, _, upper = text.partition("-")
    try:
        return int(lower), int(upper)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: two floors, as 0-1") from None


def _about(bench: Bench, result: Comparison, settings: Mapping[str, Setting]) -> str:
    amplitudes = ", ".join(f"{x:g}" for x in result.amplitudes)
    by = "the chain" if bench.engine == "chain" else "MuJoCo"
    text = f"{bench.about()}; by {by}; {', '.join(result.loads)}; amplitudes {amplitudes}."
    if settings:
        tuned = ", ".join(f"{name} = {s.spec}" for name, s in settings.items())
        text += f" Tuned on {len(bench.tuning_loads())} loads: {tuned}."
    return text


def _command(a: argparse.Namespace) -> str:
    parts = ["mrdamp", "compare", a.environment]
    for name in _SHOWN:
        given = getattr(a, name)
        if given is None or given == _USUAL.get(name):
            continue
        each = [v if isinstance(v, tuple) else (v,) for v in (given if isinstance(given, list) else [given])]
        words = ("-".join(str(x) for x in v) for v in each)
        parts += [f"--{name.replace('_', '-')}", *words]
    return shlex.join([*parts, "-o", str(a.out)])


def _dyke1996(a: argparse.Namespace) -> int:
    from mrdamp.compare import dyke1996 as preset

    if a.motions and len(a.motions) != 1:
        raise InputError(f"preset dyke1996: {len(a.motions)} motions; allowed: one, of El Centro 1940 NS")
    motion = preset.el_centro(a.motions[0] if a.motions else None)
    with progress_bar() as progress:
        rows = preset.table(motion, progress=progress)
    lines = [
        f"{motion.name}, peak {motion.pga:.3f} m/s2, at five times its speed; damper dyke1996_3kN",
        preset.shown(rows, motion).aligned(),
        *(f"{row.controller}: mean deviation {row.mean_deviation:.2f} %" for row in rows),
    ]
    return _answer(a, lines, preset.to_dict(rows, motion), preset.markdown(rows, motion), preset.page(rows, motion))


def _cable_reference(a: argparse.Namespace) -> int:
    from mrdamp.compare import cable_reference as preset

    with progress_bar() as progress:
        rows = preset.table(jobs=a.jobs, progress=progress)
    table = preset.shown(rows)
    said = "RMS motion of a taut cable over that with the best viscous damper; deviation from the reference"
    markdown = f"# Taut cable: reference numbers\n\n{table.markdown()}\n{table.note}\n"
    return _answer(a, [said, table.aligned()], preset.to_dict(rows), markdown)


def _answer(a: argparse.Namespace, lines: Sequence[str], report: Any, markdown: str, page: Page | None = None) -> int:
    """Prints a published table and writes it; 0."""
    print(json.dumps(report, indent=1) if a.json else "\n".join(lines))
    if a.out:
        a.out.mkdir(parents=True, exist_ok=True)
        with together():
            write_atomic(a.out / "table.md", markdown)
            if page:
                page.write(a.out / "index.html")
        if not a.json:
            print(f"page: {a.out / 'index.html'}" if page else f"table: {a.out / 'table.md'}")
    return 0


def _add_train(commands: Any) -> None:
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
        "--model", type=Path, nargs="+", default=[], metavar="MODEL",
        help="model file of the damper, or a set's name (default: the environment's); es: several, for robustness over "
        "all",
    )  # fmt: skip
    p.add_argument(
        "--evaluations",
        type=int,
        default=10,
        help="evaluations on validation loads, with checkpoints (default: %(default)s)",
    )
    add_jobs(p)
    p.add_argument(
        "--backend", choices=("loky", "ray"), default="loky",
        help="of --jobs: local processes, or a Ray cluster (extra `cluster`; RAY_ADDRESS: a running one)",
    )  # fmt: skip
    p.add_argument(
        "-o", "--out", type=OutFolder, required=True, help="folder to write; an interrupted run continues"
    )


def run_train(a: argparse.Namespace) -> int:
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
            _print(point, asked)
        if len(found) > 1:
            named = {" ".join(point.overrides): point.results for point in found}
            save_picture(compared(named), a.out / "curves.png")
    return 0


def _print(point: Trained, asked: int) -> None:
    """asked: control periods."""
    from mrdamp.train.learn import curves

    if point.overrides:
        print(f"{' '.join(point.overrides)}: mean score {point.score():.4f}")
    names = [name for name in point.results[0].best if name != "timesteps"]
    print(f"{'seed':>6s} {'periods':>10s} " + " ".join(f"{name:>18s}" for name in names) + f" {'CPU s':>8s}")
    for seed, result in point.seeds.items():
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
