"""Rows of a bench are the same after they were written and read; the table's figures are those of the rows."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from modules import STUDIES, loaded
from mrdamp.model import Model
from refusals import refuses
from studies.blindtest import rows_file
from studies.blindtest.score import Row

tool = loaded(STUDIES / "bench_table.py")

LAG = ("driver_lag", None)
RIGHT = Row(
    "case_001", "damper", "driver_lag", ("driver",), False, "effect", frozenset({LAG}),
    (frozenset({"driver_lag", "command_delay"}),), "driver", 0.9, 0.2, 0.1, 20.0, also=frozenset({"saturation"}),
    base=0.1, misfit=0.05,
)  # fmt: skip
PLACED = replace(
    RIGHT, case="case_002", rig="frame", label="floor_mass@2", named=frozenset({("floor_mass", "1")}), after=0.25,
    seconds=40.0, misfit=0.1,
)  # fmt: skip
OWN = replace(RIGHT, case="case_003", label="~own", verdict="unknown", named=frozenset(), misfit=0.1)
FAILED = replace(OWN, case="case_004", verdict="failed", probability=math.nan, after=math.nan, stage=None)
ROWS = [replace(RIGHT, baseline=True), PLACED, OWN, FAILED]


def test_rows_are_read_as_they_were_written(tmp_path: Path) -> None:
    rows_file.write(tmp_path / "rows.json", ROWS)
    assert json.loads((tmp_path / "rows.json").read_text())[3]["after"] is None
    read = rows_file.read(tmp_path / "rows.json")
    np.testing.assert_equal([asdict(row) for row in read], [asdict(row) for row in ROWS])  # NaN equals NaN


@pytest.mark.parametrize("text", ["", "[1]", '[{"case": "a"}]', "{"])
def test_another_file_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "rows.json").write_text(text)
    refuses(lambda: rows_file.read(tmp_path / "rows.json"), "no file of scored rows")


def test_table_counts_by_group() -> None:
    lines = dict(line.strip("| ").split(" | ", 1) for line in tool.table(ROWS).splitlines()[2:])
    assert lines["single effects named"].split(" | ") == [
        "1 of 2 (.50; .09 to .91)", *("1 of 1 (1.00)", "0 of 1 (.00)") * 3
    ]  # fmt: skip
    assert lines["of these, base of 6 % and more"].startswith("0 of 1 (.00")
    assert lines["controls without an invented cause"].startswith("1 of 2 (.50; .09 to .91)")
    assert lines["gap on held-out tests over the base, median and worst"].startswith("1.00, 2.50")
    assert lines["corrected simulator worse than the nominal one on held-out tests"].startswith("2 of 4")
    assert lines["seconds, median and worst"].startswith("20, 40")
    assert "pairs named" not in lines
    assert tool.table([replace(r, misfit=math.nan) for r in ROWS]).startswith("| figure | all |\n")


def test_pairs_count_when_both_are_named() -> None:
    pair = replace(RIGHT, label="driver_lag+backlash", misfit=math.nan)
    both = replace(pair, named=frozenset({LAG, ("backlash", None)}))
    lines = dict(line.strip("| ").split(" | ", 1) for line in tool.table([pair, both]).splitlines()[2:])
    assert lines["pairs named"].startswith("1 of 2")
    assert lines["one of a pair named, nothing else"].startswith("1 of 2")
    assert "single effects named" not in lines


def test_answers_of_a_measured_bench_are_scored(tmp_path: Path) -> None:
    """Two tests of one sample time; the handed-over simulator has half of the rig's yield force, the nominal none."""
    law = {"c0a": 0.0, "c0b": 0.0, "fya": 50.0, "fyb": 0.0, "v_ref": 1e-4}
    t = np.arange(600) * 0.002
    own = {"time_s": t, "displacement_m": 0.01 * np.sin(9 * t), "command": np.ones_like(t)}
    force = 2 * Model("bingham", law).simulate(0.002, own)["force_N"]
    tests = {f"{k}/{n}": v for k in "ab" for n, v in {**own, "force_N": force, "nominal_N": 0 * force}.items()}
    (tmp_path / "tests").mkdir()
    np.savez(tmp_path / "tests" / "c.npz", **tests)
    labels = {"c": {"label": "seal_friction", "stages": ["mechanics"], "gap": 1.0, "base": 0.5}}
    (tmp_path / "labels.json").write_text(json.dumps(labels))
    (tmp_path / "answers" / "c").mkdir(parents=True)
    Model("bingham", law).write(tmp_path / "answers" / "c" / "corrected.json")
    answer = {"verdict": "unknown", "effects": [], "where": {"stages": {"mechanics": 1.0}}, "probabilities": {}}
    (tmp_path / "answers" / "c" / "diagnosis.json").write_text(json.dumps(answer))
    (row,) = tool.of_folder(tmp_path)
    assert (row.verdict, row.right, row.stage_right) == ("unknown", False, True)
    assert row.before == pytest.approx(math.sqrt(2))
    assert row.after == pytest.approx(math.sqrt(2) / 2, rel=1e-3)
    assert row.base == pytest.approx(math.sqrt(2) / 2)
    assert "seconds" not in tool.table([row])


def test_a_folder_without_labels_or_answers_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["bench_table.py", str(tmp_path), "--save", str(tmp_path / "kept.json")])
    assert tool.main() == 2
    assert "labels.json" in capsys.readouterr().err
    (tmp_path / "labels.json").write_text(json.dumps({"a": {"label": "driver_lag"}}))
    assert tool.main() == 2
    assert "no answer (diagnosis.json)" in capsys.readouterr().err
    assert not (tmp_path / "kept.json").exists()
