"""The command `mrdamp case`: a model and records as a folder for `mrdamp diagnose`."""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path
from typing import Any

from mrdamp.commands import HOLD, add_command, named_model
from mrdamp.commands.output import OutFolder
from mrdamp.errors import InputError


def add_to(commands: Any) -> None:
    """Adds case to the subparsers of an argparse parser."""
    p = add_command(
        commands,
        "case",
        run_case,
        "put a model and the records that it should match into a folder for `mrdamp diagnose`",
        "mrdamp case model.json records/*.csv -o case",
    )
    p.add_argument("model", help="a model file, or the name of a parameter set")
    p.add_argument("records", type=Path, nargs="+", help="record files, or folders of them")
    p.add_argument("--repeat", type=Path, nargs="*", default=[], help="records that repeat an earlier test")
    p.add_argument(
        "--baseline",
        type=Path,
        nargs="*",
        default=[],
        help="records of the rig before the change, or folders of them",
    )
    p.add_argument(
        "--hold",
        choices=HOLD,
        help="hold the command between samples, or interpolate linearly (default: the model's, else found)",
    )
    p.add_argument("-o", "--out", type=OutFolder, required=True, help="folder to write; it must not exist")


def run_case(a: argparse.Namespace) -> int:
    """Reads everything first, then writes the folder."""
    from mrdamp.diagnosis.case.folder import read_case
    from mrdamp.identify.provenance import IDENTIFIED_ON
    from mrdamp.records import read_record, record_files
    from mrdamp.records.checks import warnings_of
    from mrdamp.records.division import refuse_copies
    from mrdamp.simulation.predict import INPUTS

    if a.out.exists():
        raise InputError(f"{a.out}: there is one already; give another folder")
    model = named_model(a.model)
    required = INPUTS[model.rig]
    files = [f for path in a.records for f in record_files(path)]
    names = {file: file.name for file in files}
    for file in a.repeat:
        names[file] = file.name if "repeat" in file.name.lower() else f"repeat_{file.name}"
    untouched = {f: f"baseline_{f.name}" for path in a.baseline for f in record_files(path)}
    if both := [str(f) for f in untouched if f in names]:
        raise InputError(f"case: --baseline: {', '.join(both)} is among the records too")
    names |= untouched
    if len(set(names.values())) < len(names):
        raise InputError("case: two records have the same file name; rename one of them")
    records = {file: read_record(file, required=required) for file in names}
    refuse_copies(list(records.values()))
    shared = [
        c for c in next(iter(records.values())).channels if all(c in r.channels for r in records.values())
    ]
    rates = {round(1 / r.sample_time, 6) for r in records.values()}
    body = model.to_dict()["model"]
    data: dict[str, Any] = {"name": a.out.name, "format": 1, "rig": model.rig}
    if len(rates) == 1:
        data["sample_rate_hz"] = rates.pop()
    hold = HOLD.get(a.hold, model.hold)
    if hold is not None:
        data["hold"] = hold
    data |= {
        "nominal": body,
        "channels": shared,
        "records": [n for f, n in names.items() if f not in untouched],
    }
    if IDENTIFIED_ON in model.extra:
        data[IDENTIFIED_ON] = model.extra[IDENTIFIED_ON]
    if untouched:
        data["baseline"] = list(untouched.values())
    a.out.mkdir(parents=True)
    try:
        for file, name in names.items():
            shutil.copyfile(file, a.out / name)
        (a.out / "case.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
        read_case(a.out)  # what `mrdamp diagnose` would refuse is refused here
    except BaseException:
        shutil.rmtree(a.out, ignore_errors=True)
        raise
    for check in warnings_of(list(records.values())):
        print(f"check: {check}")
    print(a.out / "case.json")
    return 0
