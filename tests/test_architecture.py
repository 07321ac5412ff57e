"""The packages form layers: no circle of modules or groups, and the ways that the page describes exist."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import pytest

from modules import TOOLS, loaded

TOOL = Path(__file__).resolve().parents[1] / "tools" / "architecture_picture.py"
DIAGNOSIS = TOOL.parents[1] / "src" / "mrdamp" / "diagnosis"


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    found = loaded(TOOLS / "architecture_picture.py")
    vars(found)["graph"] = cache(found.graph)
    return found


def test_no_module_or_group_imports_itself_by_a_detour(tool: ModuleType) -> None:
    assert len(tool.graph()) > 150  # CycleError otherwise
    groups = tool.group_imports()
    assert set(groups) == set(tool.BOXES)
    assert groups["shared"] == set()


def test_no_circle_goes_through_imports_within_functions(tool: ModuleType) -> None:
    """But for the diagnosis, whose run for frames and whose run for dampers call each other."""
    outside = {a: {b for b in bs if ".diagnosis." not in b} for a, bs in tool.graph(later=True).items()}
    assert tuple(tool.TopologicalSorter(outside).static_order())


def test_every_listed_module_exists(tool: ModuleType) -> None:
    present = {name.split(".")[1] for name in tool.graph() if "." in name}
    listed = [name for names in tool.GROUPS.values() for name in names]
    assert sorted(listed) == sorted(set(listed))
    assert set(listed) == present


def test_each_step_of_the_ways_is_an_import(tool: ModuleType) -> None:
    groups = tool.group_imports(later=True)
    for way in (tool.RECORD, tool.COMMAND):
        for a, b in pairwise(way):
            assert b in groups[a] or a in groups[b], (a, b)


def test_the_folders_of_the_diagnosis_import_one_way_only(tool: ModuleType) -> None:
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

    inside = {a: bs for a, bs in tool.graph(later=True).items() if a.startswith("mrdamp.diagnosis.")}
    assert len(inside) > 50
    upward = [
        (a, b)
        for a, bs in inside.items()
        for b in bs
        if b.startswith("mrdamp.diagnosis.") and rank(b) > rank(a)
    ]
    assert not upward


def test_no_import_of_the_diagnosis_is_for_its_types_alone() -> None:
    assert not [p for p in DIAGNOSIS.rglob("*.py") if "TYPE_CHECKING" in p.read_text()]
