"""Writes docs/reference/commands.md from the command line's own parser: `python tools/command_reference.py [--check]`.

With `--check` nothing is written, and the exit code is 1 where the file and the parser disagree.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from mrdamp.cli import build_parser

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "commands.md"


def subcommands(parser: argparse.ArgumentParser) -> dict[str, tuple[argparse.ArgumentParser, str]]:
    """Parser and help line of every command, in the order of `mrdamp --help`."""
    (action,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    texts = {a.dest: a.help or "" for a in action._choices_actions}
    return {name: (sub, texts.get(name, "")) for name, sub in action.choices.items()}


def _name(action: argparse.Action) -> str:
    if not action.option_strings:
        return f"`{action.metavar or action.dest}`"
    value = "" if action.nargs == 0 else f" {action.metavar or (action.dest.upper())}"
    if isinstance(action.metavar, tuple):
        value = " " + " ".join(action.metavar)
    elif action.choices is not None:
        value = " {" + ",".join(map(str, action.choices)) + "}"
    return f"`{', '.join(action.option_strings)}{value}`"


def _help(action: argparse.Action) -> str:
    text = (action.help or "") % {"default": action.default, "prog": "mrdamp"}
    given = action.default not in (None, argparse.SUPPRESS, False, []) and action.option_strings
    if given and "default" not in text:
        text += f" (default: {action.default})"
    return " ".join(text.split())


def lines() -> Iterator[str]:
    """The page, line by line."""
    yield "# Commands"
    yield ""
    yield "Bad input gives one line on standard error and exit code 2, an interrupt 130. The same command continues an"
    yield "interrupted run. Written by `tools/command_reference.py`."
    for name, (sub, text) in subcommands(build_parser()).items():
        yield from ("", f"## mrdamp {name}", "", f"{text[:1].upper()}{text[1:]}.", "")
        if sub.epilog:
            yield from ("```", sub.epilog.removeprefix("example: "), "```", "")
        rows = [
            a
            for a in sub._actions
            if not isinstance(a, argparse._HelpAction) and a.help is not argparse.SUPPRESS
        ]
        if rows:
            yield from (f"- {_name(a)}: {_help(a)}".removesuffix(": ") for a in rows)


def main() -> int:
    text = "\n".join(lines()) + "\n"
    if "--check" in sys.argv[1:]:
        return int(not PAGE.exists() or PAGE.read_text(encoding="utf-8") != text)
    PAGE.parent.mkdir(parents=True, exist_ok=True)
    PAGE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
