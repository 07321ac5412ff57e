"""The command `mrdamp diagnose`."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

from mrdamp.commands import add_command
from mrdamp.commands.output import OutFolder, show_progress
from mrdamp.errors import InputError


def add_to(commands: Any) -> None:
    """Adds diagnose to the subparsers of an argparse parser."""
    p = add_command(
        commands,
        "diagnose",
        run_diagnose,
        "why the simulator and the rig differ: where, which cause, and the corrected simulator",
        "mrdamp diagnose case/ -o out/case",
    )
    p.add_argument("case", type=Path, help="folder with a case.json and its records")
    p.add_argument("-o", "--out", type=OutFolder, required=True, help="folder to write")
    p.add_argument(
        "--jobs",
        type=int,
        default=None,
        metavar="N",
        help="processes; the answer is the same (default: all cores)",
    )


def run_diagnose(a: argparse.Namespace) -> int:
    """Diagnoses a case, writes diagnosis.json, corrected.json, its MJCF and a page, prints sentence and table."""
    import numpy as np

    from mrdamp.diagnosis.case.folder import read_case
    from mrdamp.diagnosis.report.handover import hand_over
    from mrdamp.diagnosis.report.page import page
    from mrdamp.diagnosis.report.sentence import table
    from mrdamp.diagnosis.run import diagnose
    from mrdamp.files import together, write_atomic
    from mrdamp.records.csv_file import render

    if a.jobs is not None and a.jobs < 1:
        raise InputError(f"--jobs is {a.jobs}; at least 1")
    case = read_case(a.case)
    a.out.mkdir(parents=True, exist_ok=True)
    found = diagnose(case, jobs=a.jobs or os.cpu_count() or 1, progress=show_progress)
    with together():
        found.corrected.write(a.out / "corrected.json")
        found = hand_over(found, case.records, a.out / "mjcf")
        if found.next_signal is not None:
            write_atomic(a.out / "next_experiment.csv", render(found.next_signal))
        write_atomic(a.out / "arrays.npz", lambda file: np.savez_compressed(file, **found.pictures))
        write_atomic(a.out / "diagnosis.json", json.dumps(found.to_dict(), indent=1) + "\n")
        page(found, case.model, case.records).write(a.out / "index.html")
    print(found.sentence)
    print(table(found))
    print(f"page: {a.out / 'index.html'}")
    return 0
