"""The command `mrdamp sensitivity`: which effects a diagnosis would find in a case's records, from which size."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from mrdamp.commands import add_command, seed
from mrdamp.commands.output import OutFolder, progress_bar
from mrdamp.errors import InputError


def add_to(commands: Any) -> None:
    """Adds `sensitivity`."""
    p = add_command(
        commands,
        "sensitivity",
        run_sensitivity,
        "detection limits of a diagnosis on your rig, from effects of several sizes injected into its records",
        "mrdamp sensitivity case/ -o out/sensitivity --jobs 2",
    )
    p.add_argument("case", type=Path, help="folder with a case.json and its records (rig damper)")
    p.add_argument(
        "-o", "--out", type=OutFolder, required=True, help="folder to write; an interrupted run continues"
    )
    p.add_argument("--effects", nargs="+", default=[], metavar="NAME", help="of the catalogue (default: all)")
    p.add_argument(
        "--sizes",
        nargs="+",
        type=float,
        metavar="SHARE",
        help="change of the simulator's residual over the RMS force (default: 0.02 0.05 0.15 0.4)",
    )
    p.add_argument(
        "--jobs", type=int, default=1, metavar="N", help="processes; the answer is the same (default: %(default)s)"
    )
    p.add_argument(
        "--seed", type=seed, default=0, help="of the effects' signs and shapes (default: %(default)s)"
    )


def run_sensitivity(a: argparse.Namespace) -> int:
    """Diagnoses every trial that has no answer yet; the page and the JSON are renewed after each."""
    from mrdamp.diagnosis.case.folder import read_case
    from mrdamp.diagnosis.injection.page import page
    from mrdamp.diagnosis.injection.sensitivity import SIZES, Study, run_study
    from mrdamp.diagnosis.injection.summary import sentence, table, to_dict
    from mrdamp.files import together, write_atomic

    if a.jobs < 1 or a.seed < 0:
        raise InputError("--jobs must be at least 1 and --seed not negative")
    study = Study.of(read_case(a.case), a.effects, a.sizes or SIZES, a.seed)
    answers, largest = [], max(t.size for t in study.trials)
    first = sum(t.size in (0.0, largest) for t in study.trials)
    with progress_bar() as progress:
        for answers in run_study(study, a.out, a.jobs, progress):
            with together():
                write_atomic(a.out / "sensitivity.json", json.dumps(to_dict(study, answers), indent=1) + "\n")
                page(study, answers).write(a.out / "index.html")
            if len(answers) == first:
                print(f"from the largest size alone: {sentence(study, answers)}", file=sys.stderr, flush=True)
    print(sentence(study, answers))
    print(table(study, answers))
    print(f"page: {a.out / 'index.html'}")
    return 1 if any(found.error for found in answers) else 0
