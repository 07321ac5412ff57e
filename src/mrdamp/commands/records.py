"""The commands that bring records: `mrdamp convert`, a rig's own tables, and `mrdamp datasets`, public sets."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrdamp.commands import OutFolder, add_command, add_json, check_written, progress_bar
from mrdamp.errors import InputError

if TYPE_CHECKING:
    from mrdamp.records.conversion import Converted

_HELP = "tables of a rig, with its own column names and units, as records"
_EXAMPLE = (
    'mrdamp convert rig/*.csv --columns "time_s=t [ms]:ms" displacement_m=LVDT:mm command=I:mA force_N=-Load:kN'
    " -o records"
)


def add_to(commands: Any) -> None:
    """Adds convert and datasets to the subparsers of an argparse parser."""
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

    p = add_command(
        commands,
        "datasets",
        run_datasets,
        "list the public measured records, and fetch them into the folder of MRDAMP_DATA",
        "mrdamp datasets utfsm --fetch --folder data",
    )
    p.add_argument("name", nargs="?", help="details of this set")
    p.add_argument("--fetch", action="store_true", help="fetch it from its public source, checked by hash")
    p.add_argument("--folder", type=Path, help="folder, in place of MRDAMP_DATA")
    add_json(p)


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
        bridged = f"; {one.missing} samples are missing, lines stand there" if one.missing else ""
        text += f" (the file's steps: {1e3 * one.steps[0]:.3g} to {1e3 * one.steps[1]:.3g} ms{bridged})"
    ranges = (
        f"{name} {values.min():.3g} to {values.max():.3g}"
        for name, values in record.channels.items()
        if name != "time_s"
    )
    return f"{text}; {', '.join(ranges)}"


def run_datasets(a: argparse.Namespace) -> int:
    from mrdamp.datasets import CATALOGUE, data_folder, dataset, fetch, found

    if a.fetch:
        if not a.name:
            raise InputError("--fetch needs the name of a set")
        with progress_bar() as progress:
            path = fetch(dataset(a.name), data_folder(a.folder), progress)
        count = found(a.folder).get(a.name, 0)
        print(f"{path}: {count} records" if count else f"{path / 'source'}: the source's own files")
        return 0
    chosen = [dataset(a.name)] if a.name else list(CATALOGUE.values())
    here = found(a.folder)
    if a.json:
        keys = ("name", "rig", "tests", "licence", "doi", "url", "channels", "command")
        rows = [
            {key: getattr(one, key) for key in keys}
            | {"can_be_fetched": one.source is not None, "records_here": here.get(one.name, 0)}
            for one in chosen
        ]
        print(json.dumps(rows, indent=1))
        return 0
    for one in chosen:
        print(f"{one.name}: {one.rig}")
        print(f"  tests     {one.tests}")
        print(f"  channels  {', '.join(one.channels)}; command: {one.command}")
        print(f"  source    {f'doi:{one.doi}' if one.doi else one.url}, licence {one.licence}")
        way = "`--fetch` gets it" if one.source else "to be fetched by hand"
        print(f"  here      {here[one.name]} records" if one.name in here else f"  here      no; {way}")
    return 0
