"""Docs: code runs, commands, files and figures exist, generated pages are those of the code; packages form layers."""

from __future__ import annotations

import argparse
import json
import re
import shlex
import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

from modules import ROOT, TOOLS, loaded
from mrdamp.cli import build_parser
from mrdamp.model.attributes import laws

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
PYTHON = [
    # test_api.py runs the first block's functions on less
    pytest.param(page, k, marks=pytest.mark.slow if (page.stem, k) == ("api", 0) else ())
    for page in PAGES
    if page.name not in ELSEWHERE
    for k in range(len(blocks(page, "python")))
]


@pytest.mark.parametrize(("page", "block"), PYTHON, ids=lambda v: v.stem if isinstance(v, Path) else str(v))
def test_python_runs(page: Path, block: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text, names = blocks(page, "python")[block], {"__name__": "__main__"}
    exec(compile(text, str(page), "exec"), names)
    for what, key, shown in re.findall(r'# (\w+\["\w+"\]): \{"(\w+)": ([\d.]+)\.\.\.', text):
        assert str(eval(what, names)[key]).startswith(shown), what


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
            path = (page.parent / target.partition("#")[0]).resolve()
            assert path.exists(), target
            # The site has the files of docs/ alone.
            assert not page.is_relative_to(ROOT / "docs") or path.is_relative_to(ROOT / "docs"), target


def test_command_reference_is_that_of_the_parser() -> None:
    tool = loaded(TOOLS / "command_reference.py")
    assert tool.PAGE.read_text(encoding="utf-8") == "\n".join(tool.lines()) + "\n", f"run: python {tool.__file__}"


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


PAPERS = {
    name: (ROOT / "docs" / "papers" / f"{name}.md").read_text(encoding="utf-8")
    for name in ("foam", "self_sensing")
}
EQUATIONS = (ROOT / "docs" / "reference" / "equations.md").read_text(encoding="utf-8")
PAGE = "\n".join([*PAPERS.values(), EQUATIONS])
GLOSSARY = (ROOT / "docs" / "reference" / "glossary.md").read_text(encoding="utf-8")
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
    texts = [(ROOT / file).read_text(encoding="utf-8") for file in files]
    # A definition: with an argument list, a class or a constant, not a mention in a comment.
    pattern = (
        rf"^[^/#\n]*\b(?:def |class |struct |double |void |LawForce |static |::)?{name}\b(?:\(|\[|:|,| \{{)"
    )
    assert any(re.search(pattern, text, re.MULTILINE) for text in texts), f"{name} is not in {files}"


def test_the_named_files_of_both_pages_are_there() -> None:
    files = {file for page in (PAGE, GLOSSARY) for file in FILE.findall(page)}
    assert len(files) > 30
    assert [file for file in sorted(files) if not (ROOT / file).is_file()] == []


def test_the_pages_hold_the_figures_of_the_results(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(TOOLS)  # it imports a tool beside it
    tool = loaded(TOOLS / "paper_pages.py")
    results = tool.Results(json.loads((ROOT / "docs" / "papers" / "results.json").read_text(encoding="utf-8")))
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


tool = loaded(TOOLS / "mutants.py")


def test_every_mutant_changes_one_place_of_its_file() -> None:
    texts: dict[str, str] = {}
    for number, mutant in enumerate(tool.MUTANTS, start=1):
        text = texts.setdefault(mutant.file, (ROOT / mutant.file).read_text())
        changed = mutant.applied(text, number)  # ValueError where it does not stand there once
        assert changed != text
        texts[mutant.file] = changed if mutant.cpp else text
        assert all((ROOT / file).is_file() for file in mutant.tests), mutant.name


DIAGNOSIS = ROOT / "src" / "mrdamp" / "diagnosis"


@pytest.fixture(scope="module")
def layers() -> ModuleType:
    found = loaded(TOOLS / "architecture_picture.py")
    vars(found)["graph"] = cache(found.graph)
    return found


def test_no_module_or_group_imports_itself_by_a_detour(layers: ModuleType) -> None:
    assert len(layers.graph()) > 150  # CycleError otherwise
    groups = layers.group_imports()
    assert set(groups) == set(layers.BOXES)
    assert groups["shared"] == set()


def test_no_circle_goes_through_imports_within_functions(layers: ModuleType) -> None:
    """But for the diagnosis, whose run for frames and whose run for dampers call each other."""
    outside = {a: {b for b in bs if ".diagnosis." not in b} for a, bs in layers.graph(later=True).items()}
    assert tuple(layers.TopologicalSorter(outside).static_order())


def test_every_listed_module_exists(layers: ModuleType) -> None:
    present = {name.split(".")[1] for name in layers.graph() if "." in name}
    listed = [name for names in layers.GROUPS.values() for name in names]
    assert sorted(listed) == sorted(set(listed))
    assert set(listed) == present


def test_the_folders_of_the_diagnosis_import_one_way_only(layers: ModuleType) -> None:
    """As its data flows; what is not in a folder (constants aside) stands after them all."""
    flow = (
        "signatures", "case", "hypotheses", "channels", "problem", "fits", "evidence", "attribution", "report", "run",
    )  # fmt: skip
    found = {path.parent.name for path in DIAGNOSIS.glob("*/*.py")}
    assert found == {*flow[:-1], "injection"}

    def rank(module: str) -> int:
        folder = module.split(".")[2]
        if folder in {"run", "frame_run", "damper_run", "searched", "answer", "injection", "form"}:
            return len(flow)
        return -1 if folder == "constants" else flow.index(folder)

    inside = {a: bs for a, bs in layers.graph(later=True).items() if a.startswith("mrdamp.diagnosis.")}
    assert len(inside) > 50
    imports = [(a, b) for a, bs in inside.items() for b in bs if b.startswith("mrdamp.diagnosis.")]
    assert [(a, b) for a, b in imports if rank(b) > rank(a)] == []
