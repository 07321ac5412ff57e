"""The command `mrdamp completion`: a script for the shell, made from the command line's own parser."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

from mrdamp.commands import add_command

SHELLS = ("bash", "zsh")


def add_to(commands: Any, parser: argparse.ArgumentParser) -> None:
    """Adds completion to the subparsers of `parser`, which is the one that the script is made from."""

    def run_completion(a: argparse.Namespace) -> int:
        print("\n".join(script(parser, a.shell)))
        return 0

    p = add_command(
        commands,
        "completion",
        run_completion,
        "print the shell's completion script; load it with: source <(mrdamp completion bash)",
        "mrdamp completion bash > ~/.local/share/bash-completion/completions/mrdamp",
    )
    p.add_argument("shell", choices=SHELLS)


def script(parser: argparse.ArgumentParser, shell: str) -> Iterator[str]:
    """Lines of the script: commands first, then the command's options, an option's choices, files elsewhere."""
    (commands,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    if shell == "zsh":
        yield "autoload -Uz bashcompinit && bashcompinit"
    yield "_mrdamp() {"
    yield '  local now="${COMP_WORDS[COMP_CWORD]}" before="${COMP_WORDS[COMP_CWORD-1]}" words=""'
    yield "  COMPREPLY=()"
    yield "  if [ $COMP_CWORD -eq 1 ]; then"
    yield f'    words="{" ".join([*commands.choices, *_options(parser)])}"'
    yield '    COMPREPLY=($(compgen -W "$words" -- "$now"))'
    yield "    return"
    yield "  fi"
    yield '  case "${COMP_WORDS[1]}:$before" in'
    for name, command in commands.choices.items():
        for action in command._actions:
            if action.choices and action.option_strings:
                pattern = "|".join(f"{name}:{option}" for option in action.option_strings)
                yield f'    {pattern}) words="{" ".join(map(str, action.choices))}" ;;'
    yield "  esac"
    yield '  if [ -z "$words" ]; then'
    yield '    case "${COMP_WORDS[1]}" in'
    for name, command in commands.choices.items():
        # Names of a positional's choices stand among the options: there is no telling where it comes.
        own = [
            str(c) for action in command._actions if not action.option_strings for c in action.choices or ()
        ]
        yield f'      {name}) words="{" ".join([*_options(command), *own])}" ;;'
    yield "    esac"
    yield '    case "$now" in'
    yield "      -*) ;;"
    yield '      *) COMPREPLY=($(compgen -f -- "$now")) ;;'
    yield "    esac"
    yield "  fi"
    yield '  COMPREPLY+=($(compgen -W "$words" -- "$now"))'
    yield "}"
    yield "complete -o filenames -F _mrdamp mrdamp"


def _options(parser: argparse.ArgumentParser) -> list[str]:
    return [
        option for action in parser._actions for option in action.option_strings if option.startswith("--")
    ]
