"""Writes docs/reference/commands.md from the command line's own parser: `python tools/command_reference.py [--check]`.

With `--check` nothing is written, and the exit code is 1 where the file and the parser disagree. The file has what each
command does, with an example; the site, of which this is a hook (mkdocs.yml), has the options too.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

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
    value = f" {action.metavar}" if action.metavar else ""
    if isinstance(action.metavar, tuple):
        value = " " + " ".join(action.metavar)
    elif action.choices is not None:
        value = " {" + ",".join(map(str, action.choices)) + "}"
    return f"`{', '.join(action.option_strings)}{value}`"


def _long(name: str) -> str:
    """The long option of a name."""
    found = re.search(r"--[\w-]+", name)
    return f"`{found[0]}`" if found else name


def _help(action: argparse.Action) -> tuple[str, str]:
    """What an argument does, and its default in brackets."""
    text = " ".join(((action.help or "") % {"default": action.default, "prog": "mrdamp"}).split())
    said = re.fullmatch(r"(.*?) ?(\(default: [^()]*\))", text)
    if said:
        return said[1], said[2]
    given = action.default not in (None, argparse.SUPPRESS, False, []) and action.option_strings
    return text, f"(default: {action.default})" if given and "default" not in text else ""


def rows(parser: argparse.ArgumentParser) -> Iterator[tuple[str, str, str]]:
    """Of each argument of a command: its name and value, what it does, its default."""
    for action in parser._actions:
        if not isinstance(action, argparse._HelpAction) and action.help is not argparse.SUPPRESS:
            yield _name(action), *_help(action)


def shared_rows(commands: Iterable[argparse.ArgumentParser]) -> dict[tuple[str, str], set[str]]:
    """Defaults of what several commands have alike, by name and what it does."""
    found: dict[tuple[str, str], list[str]] = {}
    for sub in commands:
        for name, text, default in rows(sub):
            found.setdefault((name, text), []).append(default)
    return {key: set(some) for key, some in found.items() if len(some) > 1}


def lines(options: bool = False) -> Iterator[str]:
    """The page, line by line; options: with those of every command."""
    commands = subcommands(build_parser())
    shared = shared_rows(sub for sub, _ in commands.values())
    alike = {key: next(iter(some)) for key, some in shared.items() if len(some) == 1}
    yield "# Commands"
    yield ""
    yield "Bad input gives one line on standard error and exit code 2, an interrupt 130. The same command continues an"
    yield "interrupted run. Options: `mrdamp COMMAND --help`, or this page in the site (`make docs`)."
    if options:
        yield from ("", "## Options of several commands", "")
        yield from (f"- {name}: {text} {alike.get((name, text), '')}".rstrip() for name, text in shared)
    for command, (sub, about) in commands.items():
        yield from ("", f"## mrdamp {command}", "", f"{about[:1].upper()}{about[1:]}.", "")
        if sub.epilog:
            yield from ("```", sub.epilog.removeprefix("example: "), "```")
        if options:
            yield from ("", *_options(sub, shared, alike))


def _options(
    sub: argparse.ArgumentParser, shared: dict[tuple[str, str], set[str]], alike: dict[tuple[str, str], str]
) -> Iterator[str]:
    """The list of a command's options; those that others have alike in its last line."""
    above = []
    for name, text, default in rows(sub):
        if (name, text) in shared:
            above.append(f"{_long(name)} {'' if (name, text) in alike else default}".strip())
        else:
            yield f"- {name}: {text} {default}".strip().removesuffix(":")
    if above:
        yield f"- [shared](#options-of-several-commands): {', '.join(above)}"


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """MkDocs: this page with the options, every other one as it is."""
    return "\n".join(lines(options=True)) if page.file.src_uri == "reference/commands.md" else markdown


def main() -> int:
    text = "\n".join(lines()) + "\n"
    if "--check" in sys.argv[1:]:
        return int(not PAGE.exists() or PAGE.read_text(encoding="utf-8") != text)
    PAGE.parent.mkdir(parents=True, exist_ok=True)
    PAGE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
