"""Options of `mrdamp identify --law narx`, and of which records are for fitting."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from mrdamp.commands import OutFile, refuse_unused
from mrdamp.errors import InputError

if TYPE_CHECKING:
    from mrdamp.records import RecordSet

_COUNTS = "4000:2000:1500"


def add_narx_options(parser: argparse.ArgumentParser) -> None:
    p = parser.add_argument_group("network", "with --law narx")
    p.add_argument("--page", type=OutFile, help="page to write, HTML: errors, training and pictures")
    p.add_argument("--inputs", help="channels x, v, i, F (default: vF, and viF where the command varies)")
    p.add_argument("--lags", type=int, help="lag space in samples (default: about 8 ms)")
    p.add_argument(
        "--hidden",
        help="tanh units of one or two layers, such as 20 or 10,4"
        " (default: 9, and 20 where the command varies within a record)",
    )
    p.add_argument(
        "--sample-time", type=float, help="s (default: the slowest training record's, at least 0.002)"
    )
    p.add_argument("--initialisations", type=int, default=3, help="random starts (default: %(default)s)")
    p.add_argument(
        "--refined",
        type=int,
        default=1,
        help="how many of them are trained in free run (default: %(default)s)",
    )
    p.add_argument("--one-step-only", action="store_true", help="no training in free run")
    p.add_argument(
        "--select",
        action="store_true",
        help="choose inputs, lags and units on the validation records, with curves",
    )
    p.add_argument(
        "--by", default="free_run", choices=("free_run", "one_step"), help="error that --select goes by"
    )
    p.add_argument(
        "--seeds",
        type=int,
        default=1,
        help="of --select: trainings per candidate, of which the median counts (default: %(default)s)",
    )
    p.add_argument("--max-lags", type=int, default=8, help="of --select (default: %(default)s)")
    p.add_argument("--max-units", type=int, default=25, help="of --select (default: %(default)s)")
    p.add_argument(
        "--prune",
        nargs="?",
        const="surgeon",
        choices=("surgeon", "magnitude", "structure"),
        help="remove weights, or neurons and lags; the smallest network within 10 %% of the best is kept",
    )
    # What only a network takes; the sample time is one of the protocols' too.
    parser.set_defaults(of_networks={o.dest: o.default for o in p._group_actions if o.dest != "sample_time"})


def add_protocol_options(p: argparse.ArgumentParser) -> None:
    """Adds which records are for fitting and which for evaluation, for laws and networks alike."""
    p.add_argument(
        "--protocol",
        default="records",
        choices=("records", "constant", "varying"),
        help="whole records (default), those of one constant command, or one record of varying command cut into"
        " training, validation and test",
    )
    p.add_argument(
        "--command", type=float, help="the constant command (default: the one with the most records)"
    )
    p.add_argument("--record", help="the record of varying command (default: the first long enough)")
    p.add_argument("--counts", default=_COUNTS, help="samples of it, by part (default: %(default)s)")


def protocol_records(a: argparse.Namespace, records: RecordSet) -> RecordSet:
    """The records that a law is fitted to and evaluated by under the given protocol."""
    from mrdamp.narx.data import PROTOCOL_TIME
    from mrdamp.narx.splits import at_constant_command, cut_varying

    if a.protocol == "records":
        return records
    if a.protocol == "constant":
        return at_constant_command(records, a.command)
    return cut_varying(records, a.record, counts_of(a.counts), a.sample_time or PROTOCOL_TIME)


def check_protocol(a: argparse.Namespace) -> None:
    if a.protocol != "constant":
        refuse_unused(a, "is for --protocol constant", command=None)
    if a.protocol != "varying":
        refuse_unused(a, "is for --protocol varying", record=None, counts=_COUNTS)


def counts_of(text: str) -> tuple[int, int, int]:
    try:
        first, second, third = (int(part) for part in text.split(":"))
    except ValueError:
        first = second = third = 0
    if min(first, second, third) < 10:
        raise InputError(
            f"--counts {text}: three whole numbers of 10 or more are needed, such as 4000:2000:1500"
        )
    return first, second, third
