"""The functions of the package give what the commands write; the examples show what they say."""

from __future__ import annotations

import inspect
import pydoc
import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from nbformat import NotebookNode

import mrdamp
from command_call import caller
from mrdamp import api
from mrdamp.commands.identify import add_to as add_identify
from mrdamp.records import embedded
from mrdamp.records.csv_file import render
from refusals import refuses


def test_identify_is_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder, records in (("train", embedded().train[:2]), ("validation", embedded().validation[:1])):
        (tmp_path / "set" / folder).mkdir(parents=True)
        for record in records:
            (tmp_path / "set" / folder / f"{record.name}.csv").write_text(render(record.channels))
    fit = mrdamp.identify(tmp_path / "set", "bingham", starts=1)
    out = tmp_path / "model.json"
    assert caller(add_identify)("identify", tmp_path / "set", "--law", "bingham", "--starts", "1", "-o", out) == 0
    assert mrdamp.Model.read(out).parameters == fit.model.parameters
    assert f"held-out records {fit.held_out_nrmse:.3f}" in capsys.readouterr().out
    bars: list[Any] = list(fit.plot().axes[0].patches)
    assert [b.get_width() for b in bars] == pytest.approx([e.nrmse for e in (*fit.held_out, *fit.train)], rel=1e-6)


def test_packages_are_the_functions_of_their_names() -> None:
    """Whatever was imported before: a submodule's import would hide a function of the same name."""
    from mrdamp.compare import comparison  # noqa: F401

    for name in ("identify", "compare", "train"):
        assert getattr(mrdamp, name) is sys.modules[f"mrdamp.{name}"]
        assert callable(getattr(mrdamp, name))
        assert inspect.signature(getattr(mrdamp, name)) == inspect.signature(getattr(api, name))
    refuses(lambda: mrdamp.compare("boat"), "boat")
    assert all(getattr(mrdamp, name) is not None for name in mrdamp.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = mrdamp.nothing
    text = pydoc.plain(pydoc.render_doc(mrdamp))
    for name in ("identify", "predict", "diagnose", "compare", "train"):
        assert f"mrdamp.{name}(" in text
        assert name in dir(mrdamp)


def test_wrong_kinds_are_told_in_a_line() -> None:
    refuses(lambda: mrdamp.identify(3, "bingham"), "records is 3; allowed: records or their files")  # type: ignore[arg-type]
    records = embedded().train[:1]
    refuses(lambda: mrdamp.identify(list(records), "bingham"), "records is a list of Records; allowed: a RecordSet")  # type: ignore[arg-type]
    refuses(lambda: mrdamp.identify("embedded", "bingham", start={"c0": 1.0}), "'c0' is no attribute; nearest: c0")
    refuses(lambda: mrdamp.diagnose("case", jobs=0), "jobs is 0; allowed: 1 or more")
    refuses(lambda: mrdamp.train("mrdamp/Frame-v0", "out", seeds=(0, 0)), "allowed: at least one, each once")
    refuses(lambda: mrdamp.run_frame("model.json", None, None), "takes a Model and a GroundMotion")  # type: ignore[arg-type]
    refuses(lambda: mrdamp.predict(3, "a.csv"), "predict takes a model and a record, or their files")  # type: ignore[arg-type]


def test_a_road_file_is_driven_at_a_speed(tmp_path: Path) -> None:
    """The same waves at twice the speed: twice the frequency, and half the time."""
    place = 0.1 * np.arange(400)
    columns = np.column_stack([place, 0.01 * np.sin(0.3 * place)])
    np.savetxt(tmp_path / "r.csv", columns, delimiter=",", header="position_m,height_m", comments="")
    slow, fast = (
        mrdamp.compare("car", ["passive-off"], [tmp_path / "r.csv"], speed=v, engine="chain") for v in (10.0, 20.0)
    )
    assert (slow.loads, fast.loads) == (("r_36_km_h",), ("r_72_km_h",))
    assert slow.values["passive-off"]["comfort"] != fast.values["passive-off"]["comfort"]
    refuses(lambda: mrdamp.compare("car", ["passive-off"], [tmp_path / "r.csv"], speed=0.0), "speed is 0.0; allowed")


FOLDER = Path(__file__).parents[1] / "examples"
SCRIPTS = sorted(FOLDER.glob("[0-9]*.py"))


@pytest.mark.parametrize(
    ("number", "given", "holds"),
    [
        (1, {"seconds": 1.0}, lambda left: left[1.0] < 0.2 * left[0.0]),
        (3, {"seconds": 1.5}, lambda changes: min(changes.values()) > 0.03 and max(changes, key=changes.get) == "all"),
        (5, {"samples": 1200, "units": 6, "iterations": 30}, lambda errors: max(errors) < 0.35),
        (6, {"steps": 120}, lambda drift: len(drift) == 4 and all(0 < value < 1 for value in drift.values())),
        pytest.param(
            7, {"seconds": 2.0}, lambda t: t[1].relative_error < 0.6 * t[0].relative_error, marks=pytest.mark.slow
        ),
        (8, {"shares": (0.0, 1.0)}, lambda found: found[1.0]["bearings"] < 0.5 * found[0.0]["bearings"] < 0.5),
        (8, {"shares": (0.0, 1.0)}, lambda found: found[1.0]["shaking"] > found[0.0]["shaking"]),
    ],
)
def test_an_example_shows_what_it_says(number: int, given: dict[str, Any], holds: Callable[[Any], bool]) -> None:
    (path,) = FOLDER.glob(f"{number:02d}_*.py")
    found = runpy.run_path(str(path))["main"](**given)
    assert holds(found), found


@pytest.mark.slow
@pytest.mark.parametrize("path", SCRIPTS, ids=[path.stem for path in SCRIPTS])
def test_the_scripts_run_whole(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [str(path)])
    runpy.run_path(str(path), run_name="__main__")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of the kernel's own libraries
def test_it_runs() -> None:
    nbclient = pytest.importorskip("nbclient")
    text = (FOLDER / "whole_way.ipynb").read_text(encoding="utf-8")
    run: NotebookNode = nbformat.reads(text, as_version=4)  # type: ignore[no-untyped-call]
    nbclient.NotebookClient(run, timeout=600, resources={"metadata": {"path": str(FOLDER)}}).execute()
    printed = [o.text for c in run.cells if c.cell_type == "code" for o in c.outputs if "text" in o]
    assert any("driver" in text for text in printed)
