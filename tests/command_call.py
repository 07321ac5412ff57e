"""A command as a user calls it, without the whole command line around it."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any


def caller(*add_to: Callable[[Any], None]) -> Callable[..., int]:
    """Of command modules' `add_to`: a function from a command's words to its exit code; InputError passes."""

    def run(*arguments: str | Path | int) -> int:
        parser = argparse.ArgumentParser()
        commands = parser.add_subparsers()
        for add in add_to:
            add(commands)
        parsed = parser.parse_args([str(a) for a in arguments])
        code: int = parsed.run(parsed)
        return code

    return run
