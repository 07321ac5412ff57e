"""The example scripts and the notebook run as they stand, at a small size, and show what they say."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbformat import NotebookNode

FOLDER = Path(__file__).parents[1] / "examples"
SCRIPTS = sorted(FOLDER.glob("[0-9]*.py"))


def example(number: int) -> Callable[..., Any]:
    (path,) = FOLDER.glob(f"{number:02d}_*.py")
    main: Callable[..., Any] = runpy.run_path(str(path))["main"]
    return main


def test_each_is_numbered_and_a_screen_long() -> None:
    assert [int(path.name[:2]) for path in SCRIPTS] == list(range(1, 9))
    for path in SCRIPTS:
        text = path.read_text(encoding="utf-8")
        assert len(text.splitlines()) <= 62, path.name
        assert f"python examples/{path.name}" in text


def test_1_the_damper_takes_the_motion_out() -> None:
    left = example(1)(seconds=1.0)
    assert left[1.0] < 0.2 * left[0.0]


def test_2_a_law_is_fitted(tmp_path: Path) -> None:
    fit = example(2)(law="bouc_wen", most=2, out=str(tmp_path / "rig"))
    assert fit.held_out_nrmse < 0.2
    assert (tmp_path / "rig" / "scene.xml").is_file()


def test_3_every_effect_changes_the_force() -> None:
    changes = example(3)(seconds=1.5)
    assert min(changes.values()) > 0.03
    assert changes["all"] > max(value for name, value in changes.items() if name != "all")


def test_4_the_damper_helps_the_frame() -> None:
    found = example(4)(seconds=1.5)
    drift = {name: float(c.peak_drift.max()) for name, c in found.items()}
    assert max(drift, key=lambda name: drift[name]) == "no damper"
    assert found["passive-on"].mean_command == pytest.approx(2.25)


def test_5_a_network_runs_free_in_mujoco_as_in_python() -> None:
    free, stepped = example(5)(samples=1200, units=6, iterations=30)
    assert free < 0.3
    assert stepped < 0.35


def test_6_the_environment_runs_under_any_agent() -> None:
    drift = example(6)(steps=120)
    assert len(drift) == 4
    assert all(0 < value < 1 for value in drift.values())


@pytest.mark.slow
def test_7_the_inverse_tracks_better_than_switching() -> None:
    switching, inverse = example(7)(seconds=2.0)
    assert inverse.relative_error < 0.6 * switching.relative_error


@pytest.mark.slow
@pytest.mark.parametrize("path", SCRIPTS, ids=[path.stem for path in SCRIPTS])
def test_the_scripts_run_whole(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [str(path)])
    runpy.run_path(str(path), run_name="__main__")


def test_8_a_damper_trades_bearings_for_shaking() -> None:
    found = example(8)(shares=(0.0, 1.0))
    assert found[1.0]["bearings"] < 0.5 * found[0.0]["bearings"] < 0.5
    assert found[1.0]["shaking"] > found[0.0]["shaking"]


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
