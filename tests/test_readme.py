"""The README's code runs as it stands; its commands and links are checked with the other pages, in test_docs."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README.read_text(encoding="utf-8"), re.S)


def test_the_damper_in_ones_own_mjcf(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (xml,), (python,) = blocks("xml"), blocks("python")
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
