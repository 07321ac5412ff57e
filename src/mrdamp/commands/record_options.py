"""What commands that fit to damper records share: which records, what is done to them, and what may be fitted."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mrdamp.commands import seed
from mrdamp.errors import InputError

if TYPE_CHECKING:
    from mrdamp.records import RecordSet


def add_records(p: argparse.ArgumentParser, more: str = "") -> None:
    """Adds the records, the effects fitted along, what follows the command, and the seed."""
    p.add_argument(
        "records",
        nargs="*",
        type=Path,
        help="record files, one folder, or a set of the package: embedded (default), self_sensing, foam",
    )
    about = f"effects fitted along (default: offset; without a name: none){more}"
    p.add_argument("--extras", nargs="*", default=["offset"], help=about)
    p.add_argument(
        "--follows",
        nargs="+",
        metavar="NAME",
        help="the coefficients that follow the command, such as c0 alpha; paper: those of the foam-damper paper"
        " (default: all that can)",
    )
    p.add_argument("--seed", type=seed, default=0, help="of random numbers (default: %(default)s)")


def add_json(p: argparse.ArgumentParser) -> None:
    """Adds `--json`."""
    p.add_argument("--json", action="store_true", help="print JSON; text goes to stderr")


def add_signals(p: argparse.ArgumentParser) -> None:
    """Adds what is done to the measured signals before a fit."""
    p.add_argument(
        "--cutoff", type=float, help="Hz, zero-phase low-pass of the measured displacement (default: none)"
    )
    p.add_argument("--cutoff-force", action="store_true", help="the same low-pass for the force")
    p.add_argument("--zero-mean", action="store_true", help="subtract the means of displacement and force")


def as_recorded(a: argparse.Namespace) -> RecordSet:
    """The records of the parsed arguments as they are. Raises InputError."""
    from mrdamp.records import embedded, read_records

    paths = a.records
    return embedded() if not paths else read_records(paths[0] if len(paths) == 1 else list(paths))


def prepared(a: argparse.Namespace) -> bool:
    """Whether something is done to the measured signals before a fit."""
    return a.cutoff is not None or bool(a.zero_mean)


def read(a: argparse.Namespace) -> RecordSet:
    """The records of the parsed arguments, as they are fitted to. Raises InputError."""
    if a.cutoff_force and a.cutoff is None:
        raise InputError("--cutoff-force needs a --cutoff")
    records = as_recorded(a)
    return records.smoothed(a.cutoff, force=a.cutoff_force, zero_mean=a.zero_mean) if prepared(a) else records


def follows(a: argparse.Namespace) -> Sequence[str] | None:
    """The coefficients that follow the command; None: all that can."""
    from mrdamp.identify.laws import PAPER_FOLLOWS

    return PAPER_FOLLOWS.get(a.law) if a.follows == ["paper"] else a.follows
