"""`python -m studies.gap`: the loss of a controller on frames that differ from its simulator."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from functools import partial
from pathlib import Path

from mrdamp.cli import main as run
from mrdamp.commands import OutFolder, Parser, described, progress_bar, save_picture
from mrdamp.commands.diagnosis import add_options
from mrdamp.files import together, write_atomic
from mrdamp.model import Model
from studies.gap.page import COLUMNS, errors, gap_rows, page, score_rows, scores, ways
from studies.gap.real import EFFECTS, NONE
from studies.gap.study import Options, study


def parser() -> argparse.ArgumentParser:
    p = described(
        Parser("python -m studies.gap"),
        run_gap,
        "loss of a controller on a frame that differs from its simulator, and how much of it a diagnosis recovers",
        "python -m studies.gap --effects driver_lag storey_stiffness@1 -o out/gap",
    )
    p.add_argument(
        "--model",
        type=Path,
        help="nominal simulator: a frame of three storeys without effects (default: Dyke et al.)",
    )
    p.add_argument("--effects", nargs="+", help="effects of the real frames (default: all that the rig has)")
    p.add_argument(
        "--misfit",
        action="store_true",
        help="the real damper has another law than the simulator's, which is identified on its bench records; effect "
        "`none`: the frame without one",
    )
    p.add_argument(
        "--draws", type=int, default=3, help="simulators of a randomised tuning (default: %(default)s)"
    )
    add_options(p)
    p.add_argument(
        "-o", "--out", type=OutFolder, required=True,
        help="folder to write; an interrupted run continues",
    )  # fmt: skip
    return p


def run_gap(a: argparse.Namespace) -> int:
    """Runs the study, writes study.json, index.html and the pictures, prints the tables."""
    every = (NONE, *EFFECTS) if a.misfit else tuple(EFFECTS)
    options = Options(a.controller, a.loads, a.seed, tuple(a.effects or every), a.draws, a.misfit)
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


#: From words, those of the command line by default, to the exit code.
main = partial(run, parser=parser())


if __name__ == "__main__":
    sys.exit(main())
