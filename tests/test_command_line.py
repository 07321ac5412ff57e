"""What goes around the commands: citations, shell completion, plain output."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from mrdamp import sets
from mrdamp.cli import build_parser, main
from mrdamp.commands.completion import script
from mrdamp.commands.output import progress_bar
from mrdamp.model.citations import citation

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("name", sets.names())
def test_a_sets_sources_are_cited_once(name: str) -> None:
    lines, _ = citation(name)
    assert set(sets.load(name).sources) < set(lines)
    dois = [doi for line in lines for doi in re.findall(r"doi:(\S+)", line)]
    assert len(dois) == len(set(dois))


def test_citation_prints_bibtex_and_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["citation", "modified_bouc_wen", "--bibtex"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("@article{spencer1997,\n  author = {Spencer, B. F. and Dyke, S. J.")
    assert text.count("{") == text.count("}")
    assert main(["citation", "narx", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["narx"]["references"][0]["year"] == 2015


def test_citation_file_is_for_this_version() -> None:
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    version = re.search(r'^version = "(.*)"$', (ROOT / "pyproject.toml").read_text(), re.M)
    assert version
    assert f"version: {version[1]}\n" in text
    for key in ("cff-version: 1.2.0", "message:", "title:", "authors:", "license: Apache-2.0"):
        assert key in text


def complete(*words: str) -> list[str]:
    """What bash offers for the last word."""
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("bash is not installed")
    line = "\n".join(script(build_parser(), "bash"))
    array = " ".join(f"'{word}'" for word in ("mrdamp", *words))
    ask = f"{line}\nCOMP_WORDS=({array}); COMP_CWORD={len(words)}; _mrdamp; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    done = subprocess.run([bash, "--norc", "-c", ask], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.slow
def test_bash_completes_commands_options_choices_and_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "model.json").write_text("{}")
    monkeypatch.chdir(tmp_path)
    assert complete("ident") == ["identify"]
    assert {"demo", "sets", "citation"} <= set(complete(""))
    assert complete("citation", "--bib") == ["--bibtex"]
    assert complete("inverse", "model.json", "--command-unit", "") == ["A", "V"]
    assert complete("predict", "mod") == ["model.json"]
    assert complete("completion", "z") == ["zsh"]


def test_zsh_gets_the_same_through_its_bash_mode() -> None:
    lines = list(script(build_parser(), "zsh"))
    assert lines[0] == "autoload -Uz bashcompinit && bashcompinit"
    assert lines[1:] == list(script(build_parser(), "bash"))


def test_every_command_has_an_example() -> None:
    (commands,) = (a for a in build_parser()._actions if hasattr(a, "choices") and a.choices)
    assert isinstance(commands.choices, dict)
    for name, command in commands.choices.items():
        assert (command.epilog or "").startswith(f"example: mrdamp {name}"), name


@pytest.mark.slow
def test_no_color_is_respected() -> None:
    code = (
        "from mrdamp.commands.output import progress_bar\n"
        "with progress_bar() as tell:\n    tell('working', 0.5)\n    tell('working', 1.0)\n"
    )
    colour = re.compile(r"\x1b\[[0-9;]*(3[0-7]|9[0-7]|[34]8;)[0-9;]*m")
    for no_color, coloured in (("1", False), ("", True)):
        environment = {**os.environ, "FORCE_COLOR": "1", "TERM": "xterm-256color", "NO_COLOR": no_color}
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True
        )
        assert "working" in done.stderr
        assert bool(colour.search(done.stderr)) is coloured


def test_progress_without_a_terminal_is_a_line_a_step_and_a_tenth(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar() as tell:
        for share in (0.0, 0.04, 0.11, 0.2, 0.22):
            tell("runs", share)
        tell("page", 0.23)
    assert capsys.readouterr().err.split("\n") == [
        "  0 %  runs",
        " 11 %  runs",
        " 22 %  runs",
        " 23 %  page",
        "",
    ]


@pytest.mark.slow
def test_a_reader_that_goes_leaves_no_traceback() -> None:
    read, write = os.pipe()
    os.close(read)
    call = [sys.executable, "-m", "mrdamp.cli", "sets", "--json"]
    done = subprocess.run(call, stdout=write, stderr=subprocess.PIPE, text=True, timeout=60)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


def test_sets_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sets", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["id"] for row in rows] == list(sets.names())
    assert all(row["sources"] for row in rows)
