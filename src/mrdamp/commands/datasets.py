"""The command `mrdamp datasets`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from mrdamp.commands import add_command
from mrdamp.errors import InputError


def add_to(commands: Any) -> None:
    """Adds datasets to the subparsers of an argparse parser."""
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
    p.add_argument("--json", action="store_true", help="print JSON; text goes to stderr")


def run_datasets(a: argparse.Namespace) -> int:
    """Lists, describes or fetches."""
    from mrdamp.commands.output import progress_bar
    from mrdamp.datasets import CATALOGUE, data_folder, fetch, found
    from mrdamp.datasets.catalogue import dataset

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
