"""The command `mrdamp gap`."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrdamp.commands import add_command, seed
from mrdamp.commands.output import OutFolder, progress_bar, save_picture
from mrdamp.errors import InputError

if TYPE_CHECKING:
    from mrdamp.gap.study import Options


def add_to(commands: Any) -> None:
    """Adds gap to the subparsers of an argparse parser."""
    p = add_command(
        commands,
        "gap",
        run_gap,
        "loss of a controller on a frame that differs from its simulator, and how much of it a diagnosis recovers",
        "mrdamp gap --effects driver_lag storey_stiffness@1 -o out/gap",
    )
    given = p.add_mutually_exclusive_group()
    given.add_argument(
        "--model",
        type=Path,
        help="nominal simulator: a frame of three storeys without effects (default: Dyke et al.)",
    )
    given.add_argument(
        "--case",
        type=Path,
        help="case folder of a measured frame, with the corrected simulator in place of the rig; writes gap.json, "
        "diagnosis.txt and corrected.json",
    )
    p.add_argument(
        "--controller",
        default="clipped-optimal",
        help="a kind, tuned in each simulator; one with options; policy:FILE; or a policy trained in each: learned, "
        "learned:algorithm=ppo,timesteps=200000 (default: %(default)s)",
    )
    p.add_argument("--effects", nargs="+", help="effects of the real frames (default: all that the rig has)")
    p.add_argument(
        "--misfit",
        action="store_true",
        help="the real damper has another law than the simulator's, which is identified on its bench records; effect "
        "`none`: the frame without one",
    )
    p.add_argument("--loads", type=int, default=4, help="unseen motions (default: %(default)s)")
    p.add_argument(
        "--draws", type=int, default=3, help="simulators of a randomised tuning (default: %(default)s)"
    )
    p.add_argument("--seed", type=seed, default=1)
    p.add_argument(
        "--jobs", type=int, default=2, help="processes; the answer is the same (default: %(default)s)"
    )
    p.add_argument(
        "-o", "--out", type=OutFolder, required=True,
        help="folder to write; an interrupted run continues",
    )  # fmt: skip


def run_gap(a: argparse.Namespace) -> int:
    """Runs the study, writes study.json, index.html and the pictures, prints the tables."""
    from mrdamp.files import together, write_atomic
    from mrdamp.gap.page import COLUMNS, errors, gap_rows, page, score_rows, scores, ways
    from mrdamp.gap.real import EFFECTS, NONE
    from mrdamp.gap.study import Options, study
    from mrdamp.model import Model

    every = (NONE, *EFFECTS) if a.misfit else tuple(EFFECTS)
    options = Options(a.controller, tuple(a.effects or every), a.loads, a.draws, a.seed, a.misfit)
    if a.case is not None:
        return _run_case(a, options)
    nominal = None if a.model is None else Model.read(a.model)
    with progress_bar() as progress:
        found = study(options, a.out, nominal=nominal, jobs=a.jobs, progress=progress)
    with together():
        write_atomic(a.out / "study.json", json.dumps(asdict(found), indent=1) + "\n")
        page(found).write(a.out / "index.html")
        save_picture(errors(found), a.out / "errors.png")
        if score_rows(found):
            save_picture(scores(found), a.out / "scores.png")
    widths = (20, 28, 14, 16, 8, 16)
    for row in (COLUMNS, *gap_rows(found)):
        print("  ".join(f"{text:{w}s}" for text, w in zip(row, widths, strict=True)).rstrip())
    rows = score_rows(found)
    if rows:
        print("score on the real frame, tuned on")
        heads = ("", *(text.partition(" on ")[2] for _, text in ways(found)))
        for scored in (heads, *rows):
            print(
                "  ".join(
                    f"{v:.3f}".ljust(32) if isinstance(v, float) else str(v).ljust(32) for v in scored
                ).rstrip()
            )
    print(f"page: {a.out / 'index.html'}")
    return 0


def _run_case(a: argparse.Namespace, options: Options) -> int:
    """The gap of a measured frame."""
    from mrdamp.diagnosis.case.folder import read_case
    from mrdamp.gap.measured import of_case, rows

    if a.effects or a.misfit:
        raise InputError("gap: --effects and --misfit are of simulated frames; not with --case")
    case = read_case(a.case)
    with progress_bar() as progress:
        found = of_case(options, case, a.out, jobs=a.jobs, progress=progress)
    for name, value in rows(found):
        print(f"{name:42s} {value}")
    return 0
