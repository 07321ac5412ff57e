"""The table of equations names files and functions that are there, and leaves no law and no numbered equation out."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mrdamp.model.attributes import laws

REPOSITORY = Path(__file__).resolve().parents[1]
PAGE = (REPOSITORY / "docs" / "reference" / "equations.md").read_text(encoding="utf-8")
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
        files = tuple(FILE.findall(" ".join(row)))
        names = NAMES.match(row[3]) if len(row) == 4 else None
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


def test_every_law_and_every_numbered_equation_has_a_row() -> None:
    first = [row[0].strip("`") for row in rows(PAGE)]
    assert set(laws()) <= set(first)
    foam, sensing = (
        PAGE.split("## Self-sensing")[0],
        PAGE.split("## Self-sensing")[1].split("## Force laws")[0],
    )
    for text, last in ((foam, 9), (sensing, 11)):
        numbers = {int(n) for row in rows(text) for n in re.findall(r"^\((\d+)", row[0])}
        assert numbers == set(range(1, last + 1))
