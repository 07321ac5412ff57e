"""The notebook runs from end to end, and is kept without outputs."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pytest
from nbformat import NotebookNode

NOTEBOOK = Path(__file__).parents[1] / "examples" / "whole_way.ipynb"


def read() -> NotebookNode:
    text = NOTEBOOK.read_text(encoding="utf-8")
    notebook: NotebookNode = nbformat.reads(text, as_version=4)  # type: ignore[no-untyped-call]
    return notebook


def test_outputs_are_stripped() -> None:
    notebook = read()
    assert all(not c.outputs and c.execution_count is None for c in notebook.cells if c.cell_type == "code")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of the kernel's own libraries
def test_it_runs() -> None:
    nbclient = pytest.importorskip("nbclient")
    notebook = read()
    nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(NOTEBOOK.parent)}}).execute()
    printed = [o.text for c in notebook.cells if c.cell_type == "code" for o in c.outputs if "text" in o]
    assert any("driver" in text for text in printed)
