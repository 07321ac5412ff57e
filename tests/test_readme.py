"""The README's code runs as it stands; its commands and links are checked with the other pages, in test_docs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

README = Path(__file__).parents[1] / "README.md"


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README.read_text(encoding="utf-8"), re.S)


def test_the_damper_in_ones_own_mjcf(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (xml,), python = blocks("xml"), blocks("python")
    (tmp_path / "damper.xml").write_text(xml)
    monkeypatch.chdir(tmp_path)
    exec(compile(python[0], "README.md", "exec"), {})
    assert capsys.readouterr().out.endswith(" N\n")


def test_the_identification(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(blocks("python")[1], "README.md", "exec"), {})
    assert "alpha_b" in capsys.readouterr().out


def test_figures_beside_the_alternatives_stand_on_the_pages_they_link() -> None:
    table = README.read_text(encoding="utf-8").split("## Comparison with alternatives")[1].split("\n## ")[0]
    checked = 0
    for row in (line for line in table.splitlines() if line.startswith("| ")):
        measured = row.split("|")[3]
        pages = re.findall(r"\]\((docs/[^)]*)\)", measured)
        for figure in re.findall(r"\d+\.\d+ ?[x%]", measured.split("(")[0]):
            assert any(figure in (README.parent / page).read_text(encoding="utf-8") for page in pages), figure
            checked += 1
    assert checked >= 10


def test_the_environment(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(blocks("python")[2], "README.md", "exec"), {})
    assert "peak_drift" in capsys.readouterr().out
