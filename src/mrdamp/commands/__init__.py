"""Commands of `mrdamp`, a module each with `add_to(commands)`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from mrdamp.commands.output import check_outputs

Run = Callable[[argparse.Namespace], int]

#: What `--hold` may be, and what it means.
HOLD = {"yes": True, "no": False}


def seed(text: str) -> int:
    """Argparse type of a seed."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{value}; allowed: 0 or more")
    return value


def add_command(commands: Any, name: str, run: Run, text: str, example: str) -> argparse.ArgumentParser:
    """Adds a command to the subparsers of an argparse parser; `run` takes what it parsed, its outputs checked."""
    return _running(commands.add_parser(name, help=text, **_words(text, example)), run)


def command_parser(name: str, run: Run, text: str, example: str) -> argparse.ArgumentParser:
    """The parser of a command that stands alone."""
    return _running(argparse.ArgumentParser(name, **_words(text, example)), run)


def _words(text: str, example: str) -> dict[str, Any]:
    return {
        "description": text,
        "epilog": f"example: {example}",
        "formatter_class": argparse.RawDescriptionHelpFormatter,
    }


def _running(p: argparse.ArgumentParser, run: Run) -> argparse.ArgumentParser:
    def checked(a: argparse.Namespace) -> int:
        check_outputs(a)
        return run(a)

    p.set_defaults(run=checked)
    return p
