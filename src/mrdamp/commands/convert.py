"""The command `mrdamp convert`: a rig's own tables as records."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrdamp.commands import add_command
from mrdamp.commands.output import OutFolder, check_written
from mrdamp.errors import InputError

if TYPE_CHECKING:
    from mrdamp.records.conversion import Converted

_HELP = "tables of a rig, with its own column names and units, as records"
_EXAMPLE = (
    'mrdamp convert rig/*.csv --columns "time_s=t [ms]:ms" displacement_m=LVDT:mm command=I:mA force_N=-Load:kN'
    " -o records"
)



def add_to(commands: Any) -> None:
    """Adds convert to the subparsers of an argparse parser."""
    p = add_command(commands, "convert", run_convert, _HELP, _EXAMPLE)
    p.add_argument(
        "files", nargs="+", type=Path, help="one test each: text (also .gz), .xlsx, .mat, .npz or .parquet"
    )
    p.add_argument(
        "--columns",
        nargs="+",
        required=True,
        metavar="CHANNEL=NAME:UNIT",
        help="column and unit of each channel; a minus before NAME changes the sign, a number as the command's NAME is"
        " a constant; columns without a header are 1, 2 ...",
    )
    p.add_argument(
        "--rate", type=float, metavar="HZ", help="resample to this rate; without a time_s column: the files' rate"
    )
    p.add_argument("--skip", action="store_true", help="write the others if files cannot be converted")
    p.add_argument("-o", "--out", type=OutFolder, required=True, help="folder of the records")


def run_convert(a: argparse.Namespace) -> int:
    """Converts all files, then writes them, and prints the range of each channel."""
    from mrdamp.files import together
    from mrdamp.records.checks import warnings_of
    from mrdamp.records.conversion import column, convert

    columns = [column(text) for text in a.columns]
    if twice := sorted({str(path) for path in a.files if a.files.count(path) > 1}):
        raise InputError(f"{', '.join(twice)} is given twice")
    found, faults = [], []
    for path in a.files:
        try:
            found.append(convert(path, columns, a.rate))
        except InputError as error:
            faults.append(str(error))
    if faults and (not a.skip or not found):
        for fault in faults[:-1]:
            print(f"mrdamp: {fault}", file=sys.stderr)
        rest = f"; nothing is written; --skip writes the other {len(found)}" if found else ""
        raise InputError(f"{faults[-1]}{rest}")
    names = [c.record.name for c in found]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"two files would be one record: {', '.join(twice)}")
    written = {a.out / f"{one.record.name}.csv": one.record for one in found}
    check_written(written, a.files)
    a.out.mkdir(parents=True, exist_ok=True)
    with together():
        for path, record in written.items():
            record.save(path)
    for one in found:
        print(_summary(one))
    for check in warnings_of([one.record for one in found]):
        print(f"check: {check}")
    for fault in faults:
        print(f"left out: {fault}")
    print(f"records: {a.out}")
    return 0


def _summary(one: Converted) -> str:
    """A line: length, rate, what was done to the clock, and ranges, by which a wrong unit shows."""
    record = one.record
    text = f"{record.name}: {record.duration:.3g} s at {1 / record.sample_time:.6g} Hz"
    if one.steps is not None:
        text += f" (the file's steps: {1e3 * one.steps[0]:.3g} to {1e3 * one.steps[1]:.3g} ms)"
    ranges = (
        f"{name} {values.min():.3g} to {values.max():.3g}"
        for name, values in record.channels.items()
        if name != "time_s"
    )
    return f"{text}; {', '.join(ranges)}"
