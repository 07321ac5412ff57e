"""Equations and papers: named files, functions and tests are there, no law, equation, table or figure is left out."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from modules import TOOLS, loaded
from mrdamp.model.attributes import laws

REPOSITORY = Path(__file__).resolve().parents[1]
PAPERS = {
    name: (REPOSITORY / "docs" / "papers" / f"{name}.md").read_text(encoding="utf-8")
    for name in ("foam", "self_sensing")
}
EQUATIONS = (REPOSITORY / "docs" / "reference" / "equations.md").read_text(encoding="utf-8")
PAGE = "\n".join([*PAPERS.values(), EQUATIONS])
GLOSSARY = (REPOSITORY / "docs" / "reference" / "glossary.md").read_text(encoding="utf-8")
FILE = re.compile(r"`([\w./]+\.(?:h|cc|py|def))`")
#: Names at the start of a cell, and names after their file.
NAMES, OF_FILE = re.compile(r"(?:`[\w:]+`(?:, )?)+"), re.compile(r"`([\w./]+\.(?:h|cc|py|def))`: `(\w+)`")


def rows(text: str) -> list[list[str]]:
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if "---" not in line]


def claims() -> list[tuple[str, tuple[str, ...]]]:
    """Each name with the files that one of which has to define it."""
    found: list[tuple[str, tuple[str, ...]]] = []
    for row in rows(PAGE):
        files = tuple(FILE.findall(" ".join(row[:4])))
        names = NAMES.match(row[3]) if len(row) == 4 or row[0].startswith("(") else None
        if names:
            found += [(name.split("::")[-1], files) for name in re.findall(r"[\w:]+", names[0])]
        found += [(name, (file,)) for cell in row for file, name in OF_FILE.findall(cell)]
    return found


@pytest.mark.parametrize(("name", "files"), claims())
def test_a_named_function_is_in_a_named_file(name: str, files: tuple[str, ...]) -> None:
    texts = [(REPOSITORY / file).read_text(encoding="utf-8") for file in files]
    # A definition: with an argument list, a class or a constant, not a mention in a comment.
    pattern = (
        rf"^[^/#\n]*\b(?:def |class |struct |double |void |LawForce |static |::)?{name}\b(?:\(|\[|:|,| \{{)"
    )
    assert any(re.search(pattern, text, re.MULTILINE) for text in texts), f"{name} is not in {files}"


def test_the_named_files_of_both_pages_are_there() -> None:
    files = {file for page in (PAGE, GLOSSARY) for file in FILE.findall(page)}
    assert len(files) > 30
    assert [file for file in sorted(files) if not (REPOSITORY / file).is_file()] == []


def test_the_pages_hold_the_figures_of_the_results(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(TOOLS)  # it imports a tool beside it
    tool = loaded(TOOLS / "paper_pages.py")
    results = tool.Results(json.loads((REPOSITORY / "docs" / "papers" / "results.json").read_text(encoding="utf-8")))
    for page in PAPERS.values():
        assert results.fill(page) == page
        marks = re.findall(r"<!--\w[^>]*-->", page)
        assert len(marks) == page.count("<!--/-->") > 30
        assert not re.search(r"^ *<!--\w[^>]*-->.", page, re.MULTILINE)  # it would end a list or a paragraph
        stale = re.sub(r"(<!--\w[^>]*-->).*?(?=<!--/-->)", r"\1-", page, flags=re.S)
        assert stale != page
        assert results.fill(stale) == page


def test_every_law_has_a_row() -> None:
    assert set(laws()) <= {row[0].strip("`") for row in rows(EQUATIONS)}


@pytest.mark.parametrize(
    ("name", "equations", "tables", "figures"),
    [("foam", 9, 1, range(7, 13)), ("self_sensing", 11, 2, range(3, 16))],
)
def test_nothing_of_a_paper_is_left_out(name: str, equations: int, tables: int, figures: range) -> None:
    """Equations, tables and figures of data by number, each row with a test that is there."""
    page, found = PAPERS[name], rows(PAPERS[name])
    first = [row[0] for row in found]
    assert {int(n) for cell in first for n in re.findall(r"^\((\d+)", cell)} == set(range(1, equations + 1))
    for number in range(1, tables + 1):
        assert f"Table {number}" in page
    named: set[int] = set()
    for cell in first:
        for text in re.findall(r"Figs?\. ([\d ,toand]+)", cell):
            numbers = [int(n) for n in re.findall(r"\d+", text)]
            named |= set(range(numbers[0], numbers[-1] + 1)) if " to " in text else set(numbers)
    assert set(figures) <= named
    for row in found:
        if len(row) == 5 and row[0] not in ("equation", "item"):
            assert OF_FILE.fullmatch(row[4]), row  # that it is there: see above
