"""Commands of `mrdamp`, a module each with `add_to(commands)`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrdamp.commands.output import check_outputs

if TYPE_CHECKING:
    from mrdamp.model import Model

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
    return _described(commands.add_parser(name, help=text), run, text, example)


def command_parser(name: str, run: Run, text: str, example: str) -> argparse.ArgumentParser:
    """The parser of a command that stands alone."""
    return _described(argparse.ArgumentParser(name), run, text, example)


def _described(p: argparse.ArgumentParser, run: Run, text: str, example: str) -> argparse.ArgumentParser:
    def checked(a: argparse.Namespace) -> int:
        check_outputs(a)
        return run(a)

    p.description, p.epilog = text, f"example: {example}"
    p.formatter_class = argparse.RawDescriptionHelpFormatter
    p.set_defaults(run=checked)
    return p


def named_model(text: str) -> Model:
    """A model file, or a parameter set by its name. Raises InputError."""
    from mrdamp import sets
    from mrdamp.model import Model, effects_from

    if not Path(text).exists() and text in sets.names():
        found = sets.load(text)
        return Model(found.law, dict(found.parameters), effects_from(found.attributes()), name=text)
    return Model.read(text)
