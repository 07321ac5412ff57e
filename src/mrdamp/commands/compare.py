"""The command `mrdamp compare`: controllers on motions they were not tuned on, or a published table."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrdamp.commands import add_command
from mrdamp.commands.models import named_model
from mrdamp.commands.output import OutFolder, progress_bar, save_picture, silent_output
from mrdamp.errors import InputError
from mrdamp.files import together, write_atomic

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mrdamp.compare.bench import Bench
    from mrdamp.compare.comparison import Comparison
    from mrdamp.compare.tuning import Setting

_PRESETS = "dyke1996", "cable"
#: Options in the page's command, and those among them that have a default.
_SHOWN = (
    "controllers", "motions", "speed", "amplitudes", "compression", "model", "dampers", "told", "spread",
    "command_unit", "period", "engine", "bound",
)  # fmt: skip
_USUAL = {"engine": "mujoco"}


def add_to(commands: Any) -> None:
    """Adds `compare` to the subparsers of an argparse parser."""
    p = add_command(
        commands,
        "compare",
        run,
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
        "--model", type=Path, help="model file of a damper, or of a frame with one (default: published)"
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
        "--command-unit", choices=("A", "V"), help="of the model's command (default: V, A with --model)"
    )
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
    p.add_argument(
        "--jobs", type=int, default=-1, help="processes (default: all cores); the answer is the same"
    )
    p.add_argument("--json", action="store_true", help="print JSON in place of a table")
    p.add_argument(
        "-o", "--out", type=OutFolder, help="folder for the page and tables; an interrupted run continues"
    )


def run(a: argparse.Namespace) -> int:
    """Runs `compare`."""
    if a.preset == "dyke1996":
        return _dyke1996(a)
    if a.preset == "cable":
        return _cable_reference(a)
    with silent_output() if a.json else nullcontext():
        text = _compare(a)
    print(text)
    return 0


def _compare(a: argparse.Namespace) -> str:
    """What is printed of a comparison."""
    from mrdamp.compare.benches import bench_of
    from mrdamp.compare.bound import with_bounds
    from mrdamp.compare.comparison import compare, distinct
    from mrdamp.compare.contenders import contenders, shipped_policies
    from mrdamp.compare.frame import FrameBench
    from mrdamp.compare.motions import doubtful
    from mrdamp.compare.output import write_comparison
    from mrdamp.compare.page import paths_picture, shares_picture
    from mrdamp.compare.tables import (
        mean_rows,
        share_columns,
        share_note,
        share_rows,
        spread_columns,
        spread_note,
        spread_rows,
        to_json,
    )
    from mrdamp.compare.tuning import settings_for
    from mrdamp.motions import GroundMotion

    period = None if a.period is None else 1e-3 * a.period
    bench = bench_of(
        a.environment,
        None if a.model is None else named_model(str(a.model)),
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
    if a.bound is not None and (a.dampers or ())[1:]:
        raise InputError("--bound is for one damper; leave it out")
    if a.speed is not None and not (a.motions and bench.option == "road"):
        raise InputError("--speed is for files of roads (--motions); leave it out")
    loads: Sequence[Any] = bench.read(a.motions, a.speed or 20.0) if a.motions else bench.unseen_loads()
    for check in (said for load in loads if a.motions and isinstance(load, GroundMotion) for said in doubtful(load)):
        print(f"check: {check}", file=sys.stderr)
    amplitudes = tuple(a.amplitudes) if a.amplitudes else (1.0,) if a.motions else bench.unseen_amplitudes
    shipped = shipped_policies(bench.environment)
    names = a.controllers or [*bench.default, *shipped]
    keep = _keep(a.out)
    # Tuning takes minutes: what is wrong with a file or a name is said before.
    contenders(bench, [name for name in names if name.rpartition("=")[2] not in bench.tuned], {}, shipped)
    with progress_bar() as progress:
        settings = settings_for(
            bench, names, anew=a.tune, needed=bool(a.controllers), file=a.out and a.out / "tuned.json",
            jobs=a.jobs, keep=keep, progress=progress,
        )  # fmt: skip
        if not settings and not a.controllers:
            names = [name for name in names if name not in bench.tuned]
        rows = contenders(bench, names, settings, shipped)
        result = compare(bench, rows, loads, amplitudes, jobs=a.jobs, keep=keep, progress=progress)
        loads = distinct(bench, loads)
        if a.spread:
            from mrdamp.compare.spread import with_spread

            assert isinstance(bench, FrameBench)
            result = with_spread(bench, result, loads, a.spread, jobs=a.jobs, keep=keep, progress=progress)
        if a.bound is not None:
            result = with_bounds(
                bench, result, loads, starts=a.bound, jobs=a.jobs, keep=keep, progress=progress
            )
        about = _about(bench, result, settings, names)
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
        return to_json(result, bench.command_unit, noted).rstrip()
    at = [k for k, m in enumerate(result.measures, start=1) if m.key in bench.headline]
    heads = [m.title.format(unit=bench.command_unit) for m in result.measures if m.key in bench.headline]
    said = [
        _aligned([("controller", *heads), *((row[0], *(row[k] for k in at)) for row in mean_rows(result))]),
        f"mean (worst) over motions or loads and amplitudes; ratios are over {bench.reference}",
    ]
    if result.others:
        said += [_aligned([spread_columns(result), *spread_rows(result)]), spread_note(result)]
    if result.bounds:
        said += [_aligned([share_columns(result), *share_rows(result)]), share_note(result)]
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


def _keep(out: Path | None) -> Path | None:
    if out is None:
        return None
    out.mkdir(parents=True, exist_ok=True)
    return out / "kept.jsonl"


def _about(bench: Bench, result: Comparison, settings: dict[str, Setting], names: Sequence[str]) -> str:
    amplitudes = ", ".join(f"{x:g}" for x in result.amplitudes)
    text = f"{bench.about()}; {', '.join(result.loads)}; amplitudes {amplitudes}."
    used = {name: s for name, s in settings.items() if any(n.rpartition("=")[2] == name for n in names)}
    if used:
        tuned = ", ".join(f"{name} = {s.spec}" for name, s in used.items())
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
    if a.json:
        print(json.dumps(preset.to_dict(rows, motion), indent=1))
    else:
        print(f"{motion.name}, peak {motion.pga:.3f} m/s2, at five times its speed; damper dyke1996_3kN")
        print(_aligned(preset.text_rows(rows)))
        for row in rows:
            print(f"{row.controller}: mean deviation {row.mean_deviation:.2f} %")
    if a.out:
        _keep(a.out)
        with together():
            write_atomic(a.out / "table.md", preset.markdown(rows, motion))
            preset.page(rows, motion).write(a.out / "index.html")
        if not a.json:
            print(f"page: {a.out / 'index.html'}")
    return 0


def _cable_reference(a: argparse.Namespace) -> int:
    from mrdamp.compare import cable_reference as preset

    with progress_bar() as progress:
        rows = preset.table(jobs=a.jobs, progress=progress)
    if a.json:
        print(json.dumps(preset.to_dict(rows), indent=1))
    else:
        print(
            "RMS motion of a taut cable over that with the best viscous damper; deviation from the reference"
        )
        print(_aligned(preset.text_rows(rows)))
    if a.out:
        _keep(a.out)
        write_atomic(a.out / "table.md", preset.markdown(rows))
        if not a.json:
            print(f"table: {a.out / 'table.md'}")
    return 0


def _aligned(rows: Sequence[Sequence[str]]) -> str:
    """Text in columns: the first flush left, the others flush right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join(
        "  ".join(
            [row[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True))]
        )
        for row in rows
    )
