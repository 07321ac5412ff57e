"""The command `mrdamp citation`."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from typing import Any

from mrdamp.commands import add_command
from mrdamp.errors import InputError

_HELP = "what to cite for a force law or a published parameter set"
_EXAMPLE = "mrdamp citation modified_bouc_wen --bibtex"



def add_to(commands: Any) -> None:
    """Adds citation to the subparsers of an argparse parser."""
    p = add_command(commands, "citation", run_citation, _HELP, _EXAMPLE)
    p.add_argument("name", nargs="?", help="law or parameter set (default: every law)")
    p.add_argument("--bibtex", action="store_true", help="the law's sources as BibTeX")
    p.add_argument("--json", action="store_true", help="print JSON; text goes to stderr")


def run_citation(a: argparse.Namespace) -> int:
    """Prints it."""
    from mrdamp.model.citations import citation, references

    if a.bibtex and a.json:
        raise InputError("--bibtex and --json exclude each other")
    names = [a.name] if a.name else list(references())
    found = {name: citation(name) for name in names}
    if a.json:
        out = {
            name: {"cite": lines, "references": [asdict(r) for r in sources]}
            for name, (lines, sources) in found.items()
        }
        print(json.dumps(out, indent=1))
    elif a.bibtex:
        unique = {r.key: r for _, sources in found.values() for r in sources}
        print("\n\n".join(reference.bibtex() for reference in unique.values()))
    else:
        for name, (lines, _) in found.items():
            print(f"{name}:")
            for line in lines:
                print(f"  {line}")
    return 0
