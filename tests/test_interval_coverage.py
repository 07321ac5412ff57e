"""Coverage of the intervals of named causes, from a bench's labels and answers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from modules import TOOLS, loaded

tool = loaded(TOOLS / "interval_coverage.py")


def bench(folder: Path, cases: dict[str, tuple[str, dict[str, float], list[dict[str, Any]]]]) -> Path:
    """A folder of a bench: label, sizes put in, and named effects by case."""
    folder.mkdir()
    labels = {case: {"label": label, "size": size} for case, (label, size, _) in cases.items()}
    (folder / "labels.json").write_text(json.dumps(labels))
    for case, (_, _, effects) in cases.items():
        (folder / "answers" / case).mkdir(parents=True)
        (folder / "answers" / case / "diagnosis.json").write_text(json.dumps({"effects": effects}))
    return folder


def effect(
    name: str, parameter: str, value: float, low: float, high: float, place: int | None = None
) -> dict[str, Any]:
    return {"name": name, "place": place, "parameters": {parameter: value}, "intervals": {parameter: [low, high]}}


def test_right_single_causes_with_a_comparable_parameter_count(tmp_path: Path) -> None:
    out = bench(
        tmp_path / "out",
        {
            # The label of a rig's gain is its change; a place is part of the name.
            "1": ("sensor_gain@2", {"floor2.gain": 0.25}, [effect("sensor_gain", "g", 1.2, 1.15, 1.3, 2)]),
            "2": ("sensor_leakage", {"tau": 0.5}, [effect("sensor_leakage", "tau", 0.4, 0.38, 0.42)]),
            "3": ("sensor_leakage", {"tau": 0.5}, [effect("sensor_gain", "g", 1.2, 1.1, 1.3)]),
            "4": ("sensor_lag", {"tau": 0.5}, [effect("sensor_lag", "tau", 0.5, 0.4, 0.6)]),
            "5": (
                "moving_mass",
                {"m": 8.0},
                [effect("moving_mass", "m", 8.0, 7.0, 9.0), effect("backlash", "gap", 1.0, 0.0, 2.0)],
            ),
        },
    )
    found = list(tool.values(out))
    assert [(v.effect, v.truth, v.inside) for v in found] == [
        ("sensor_gain", 1.25, True),
        ("sensor_leakage", 0.5, False),
    ]
    lines = tool.table(found).splitlines()
    assert lines[2] == "| sensor_gain | 1 of 1 | 4.0 % |"
    assert lines[-1].startswith("| all | 1 of 2 (0.50;")
    assert lines[-1].endswith("| 12.0 % |")


def test_a_folder_without_answers_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["interval_coverage", str(tmp_path)])
    assert tool.main() == 2
    assert "labels.json and answers/ are needed" in capsys.readouterr().err
