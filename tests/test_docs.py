"""Docs: their code runs, their commands exist, generated pages are those of the code, links lead somewhere."""

from __future__ import annotations

import argparse
import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from modules import TOOLS, loaded
from mrdamp.cli import build_parser

ROOT = Path(__file__).parents[1]
PAGES = sorted([*(ROOT / "docs").glob("**/*.md"), ROOT / "README.md", *ROOT.glob("models_xml/*/README.md")])


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^ *```{language}\n(.*?)^ *```", page.read_text(encoding="utf-8"), re.S | re.M)


def commands(page: Path) -> Iterator[str]:
    """Lines of shell blocks that call mrdamp, their continuation lines joined, without comments."""
    for block in blocks(page, r"(?:sh|console)?"):
        for line in block.replace("\\\n", " ").splitlines():
            words = re.sub(r"\s#.*", "", line).strip()
            if re.match(r"(\w+=\S+ )*mrdamp ", words):
                yield re.sub(r"^(\w+=\S+ )*mrdamp ", "", words)


#: What needs an extra is run by tests/test_warp.py.
ELSEWHERE = ("README.md", "gpu.md")
PYTHON = [(page, k) for page in PAGES if page.name not in ELSEWHERE for k in range(len(blocks(page, "python")))]


@pytest.mark.parametrize(("page", "block"), PYTHON, ids=lambda v: v.stem if isinstance(v, Path) else str(v))
def test_python_runs(page: Path, block: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(blocks(page, "python")[block], str(page), "exec"), {"__name__": "__main__"})


class _Refused(Exception):
    pass


@pytest.mark.parametrize(
    "page", [p for p in PAGES if list(commands(p))], ids=lambda p: str(p.relative_to(ROOT))
)
def test_commands_are_understood(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: argparse.ArgumentParser, message: str) -> None:
        raise _Refused(f"{self.prog}: {message}")

    monkeypatch.setattr(argparse.ArgumentParser, "error", refuse)
    for line in commands(page):
        words = line.split(" > ")[0]
        build_parser().parse_args(shlex.split(words))


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#][^)]*)\)", page.read_text(encoding="utf-8")):
        if not re.match(r"[a-z]+:", target):
            assert (page.parent / target.partition("#")[0]).exists(), target


def test_command_reference_is_that_of_the_parser() -> None:
    tool = loaded(TOOLS / "command_reference.py")
    assert tool.PAGE.read_text(encoding="utf-8") == "\n".join(tool.lines()) + "\n", f"run: python {tool.__file__}"


def test_hooks_call_what_there_is() -> None:
    text = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    entries = re.findall(r"entry: (.*)", text)
    assert len(entries) == 4
    assert "://" not in text  # nothing is fetched
    for words in map(str.split, entries):
        tool = words[1] if words[0].endswith("python") else None
        assert words[0].startswith(".venv/bin/")
        assert tool is None or (ROOT / tool).is_file(), tool


def test_every_page_is_in_the_site() -> None:
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n", 1)[1]
    listed = set(re.findall(r"[\w/-]+\.md", nav))
    assert listed == {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").glob("**/*.md")}


def test_the_readmes_damper_in_ones_own_mjcf(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (xml,), (python,) = (blocks(ROOT / "README.md", language) for language in ("xml", "python"))
    (tmp_path / "damper.xml").write_text(xml)
    shutil.copy(ROOT / "models_xml" / "dampers" / "dyke1996_3kN.xml", tmp_path)
    monkeypatch.chdir(tmp_path)
    exec(compile(python, "README.md", "exec"), {})
    force, unit = capsys.readouterr().out.split()
    assert float(force) < 0  # it resists the motion
    assert unit == "N"


def test_figures_beside_the_alternatives_stand_on_the_pages_they_link() -> None:
    page = ROOT / "docs" / "alternatives.md"
    table = page.read_text(encoding="utf-8").split("\n## ")[0]
    checked = 0
    for row in (line for line in table.splitlines() if line.startswith("| ")):
        measured = row.split("|")[3]
        links = re.findall(r"\]\(([^)]*)\)", measured)
        for figure in re.findall(r"\d+\.\d+ ?[x%]", measured.split("(")[0]):
            assert any(figure in (page.parent / link).read_text(encoding="utf-8") for link in links), figure
            checked += 1
    assert checked >= 10
