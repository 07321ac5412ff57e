"""The command `mrdamp gap`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from mrdamp.commands import add_command, seed
from mrdamp.commands.output import OutFolder, progress_bar


def add_to(commands: Any) -> None:
    """Adds gap to the subparsers of an argparse parser."""
    p = add_command(
        commands,
        "gap",
        run_gap,
        "what the gap of a measured frame costs a controller, and how much of it a diagnosis recovers",
        "mrdamp gap case/ --controller force-tracking -o out/gap",
    )
    p.add_argument("case", type=Path, help="case folder of a measured frame, for which its corrected simulator stands")
    add_options(p)
    p.add_argument(
        "-o", "--out", type=OutFolder, required=True,
        help="folder for gap.json, diagnosis.txt and corrected.json",
    )  # fmt: skip


def add_options(p: argparse.ArgumentParser) -> None:
    """Those of `Options`, and the number of processes."""
    p.add_argument(
        "--controller",
        default="clipped-optimal",
        help="a kind, tuned in each simulator; one with options; policy:FILE; or a policy trained in each: learned, "
        "learned:algorithm=ppo,timesteps=200000 (default: %(default)s)",
    )
    p.add_argument("--loads", type=int, default=4, help="unseen motions (default: %(default)s)")
    p.add_argument("--seed", type=seed, default=1, help="of random numbers (default: %(default)s)")
    p.add_argument(
        "--jobs", type=int, default=2, metavar="N", help="processes; the answer is the same (default: %(default)s)"
    )


def run_gap(a: argparse.Namespace) -> int:
    """Diagnoses the case, runs the controller in its simulators, prints and writes what the gap costs."""
    from mrdamp.diagnosis.case.folder import read_case
    from mrdamp.gap.measured import of_case, rows
    from mrdamp.gap.scenario import Options

    options = Options(a.controller, a.loads, a.seed)
    case = read_case(a.case)
    with progress_bar() as progress:
        found = of_case(options, case, a.out, jobs=a.jobs, progress=progress)
    for name, value in rows(found):
        print(f"{name:42s} {value}")
    return 0
