"""`mrdamp diagnose`: what it refuses in a line, the open cases of the shared rig, and gaps against `mrdamp predict`."""

from __future__ import annotations

import ast
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bingham_rig import force, write_case
from modules import CASES, needs
from mrdamp import cli
from mrdamp.diagnosis.case.folder import read_case
from mrdamp.diagnosis.report.sentence import table
from mrdamp.diagnosis.run import diagnose
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records.csv_file import render
from mrdamp.simulation.predict import predict
from record_tables import channels_by_test

DAMPER = [f"open_{k:02d}" for k in range(1, 11)]


def make_case(folder: Path, **changes: Any) -> Path:
    t, tests = 0.004 * np.arange(400), {}
    for name, hz in (("01", 1.0), ("02", 2.0), ("03_repeat", 1.0)):
        x = 0.01 * np.sin(2 * np.pi * hz * t)
        tests[name] = {
            "time_s": t,
            "displacement_m": x,
            "command": np.full(400, 1.0),
            "force_N": 1000 * np.cos(2 * np.pi * hz * t),
        }
    return write_case(folder, tests, **changes)


def spoil(folder: Path, change: Callable[[list[str]], list[str]]) -> None:
    lines = (folder / "01.csv").read_text().splitlines()
    (folder / "01.csv").write_text("\n".join(change(lines)) + "\n")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda folder: (folder / "case.json").unlink(), ("no case", "case.json")),
        (lambda folder: (folder / "02.csv").unlink(), ("02.csv", "no such record")),
        (lambda folder: spoil(folder, lambda lines: [*lines[:9], *lines[14:]]), ("01.csv",)),
        (lambda folder: spoil(folder, lambda lines: [x.rsplit(",", 1)[0] for x in lines]), ("01.csv", "force_N")),
        ({"sample_rate_hz": 500.0}, ("01.csv", "250", "500")),
        ({"records": ["01.csv", "01.csv"]}, ("case.json", "twice")),
        ({"baseline": ["01.csv"]}, ("case.json", "or one of 'records'")),
        ({"baseline": ["no.csv"]}, ("no.csv", "no such")),
        ({"hold": "yes"}, ("hold is 'yes'; allowed: true, false",)),
        ({"holds": True}, ("'holds' is unknown; allowed: name, format",)),
    ],
)
def test_a_bad_case_is_refused_in_a_line(
    change: Callable[[Path], Any] | dict[str, Any],
    words: tuple[str, ...],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    case, out = tmp_path / "case", tmp_path / "out"
    if isinstance(change, dict):
        make_case(case, **change)
    else:
        change(make_case(case))
    assert cli.main(["diagnose", str(case), "-o", str(out)]) == 2
    line = capsys.readouterr().err.strip()
    assert "\n" not in line
    assert all(word in line for word in words), line
    assert not out.exists()


def test_a_case_says_whether_its_command_is_held(tmp_path: Path) -> None:
    assert read_case(make_case(tmp_path / "yes", hold=True)).model.hold is True
    assert read_case(make_case(tmp_path / "open")).model.hold is None


def shrink(name: str, out: Path) -> float:
    """1 - gap of the corrected simulator over that of the nominal one, on tests that the case does not hold."""
    model, before, after = Model.read(out / "corrected.json"), 0.0, 0.0
    for test in channels_by_test(CASES / "open_tests" / f"{name}.npz").values():
        (out / "test.csv").write_text(render({c: test[c] for c in ("time_s", "displacement_m", "command")}))
        force, nominal = test["force_N"][50:], test["nominal_N"][50:]
        found = predict(model, out / "test.csv")["force_N"][50:]
        size = float(np.mean(force**2))
        before += float(np.mean((nominal - force) ** 2)) / size
        after += float(np.mean((found - force) ** 2)) / size
    return 1 - float(np.sqrt(after / before))


def diagnosed(name: str, out: Path, *more: str) -> dict[str, Any]:
    assert cli.main(["diagnose", str(CASES / "open" / name), "-o", str(out), *more]) == 0
    found = json.loads((out / "diagnosis.json").read_text())
    assert isinstance(found, dict)
    return found


def check(name: str, out: Path) -> None:
    label = json.loads((CASES / "open_labels.json").read_text())[name]
    found = diagnosed(name, out)
    wanted = label["label"]
    verdict = (
        "unknown" if wanted.startswith("~") else wanted if wanted in ("none", "parameters") else "effect"
    )
    assert found["verdict"] == verdict
    stages = found["where"]["stages"]
    assert sum(stages.values()) == pytest.approx(1.0)
    gap = found["gap"]
    assert gap["interval"][0] <= gap["corrected"] <= gap["interval"][1]
    assert sum(c["probability"] for c in found["candidates"]) <= 1 + 1e-9
    if verdict == "effect":
        assert {e["name"] for e in found["effects"]} == set(wanted.split("+"))
        assert max(stages, key=lambda s: stages[s]) in label["stages"]
        assert shrink(name, out) > 0.93
        assert gap["corrected"] < 2.0 * gap["noise_floor"]
    else:
        assert found["effects"] == []


@pytest.mark.slow
@needs(CASES)
def test_a_slow_coil_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check("open_03", tmp_path / "out")
    text = capsys.readouterr().out
    assert text.startswith("The gap is due to driver_lag")
    (effect,) = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["effects"]
    assert {r["over"] for r in effect["by_regime"]} == {"command", "speed"}
    for r in effect["by_regime"]:
        assert r["determined"] == (r["gap_without"] > 0.05)  # a steady command does not show a lag
        if r["determined"]:
            assert r["parameters"]["tau"] == pytest.approx(effect["parameters"]["tau"], rel=0.05)
            assert r["gap_with"] < 0.5 * r["gap_without"]
    assert sorted(p.name for p in (tmp_path / "out").iterdir() if p.suffix == ".json") == [
        "corrected.json",
        "diagnosis.json",
    ]


@pytest.mark.slow
@needs(CASES)
@pytest.mark.parametrize("name", [n for n in DAMPER if n != "open_03"])
def test_open_cases(name: str, tmp_path: Path) -> None:
    check(name, tmp_path)


@pytest.mark.slow
@needs(CASES)
@pytest.mark.parametrize("name", ["open_04", "open_frame_05"])
def test_one_worker_and_two_give_the_same_answer(name: str, tmp_path: Path) -> None:
    one, two = (diagnosed(name, tmp_path / jobs, "--jobs", jobs) for jobs in ("1", "2"))
    assert {**one, "seconds": 0} == {**two, "seconds": 0}
    assert (tmp_path / "1" / "corrected.json").read_text() == (tmp_path / "2" / "corrected.json").read_text()


def imported(file: Path) -> set[str]:
    nodes = list(ast.walk(ast.parse(file.read_text())))
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom) and not node.level]
    return {name.split(".")[0] for name in names}


def test_nothing_of_the_diagnosis_knows_the_rig_that_makes_blind_cases() -> None:
    import mrdamp

    package = Path(mrdamp.__file__).parent
    for file in package.rglob("*.py"):
        assert "studies" not in imported(file), file
    for file in (*(package / "diagnosis").rglob("*.py"), package / "commands" / "diagnosis.py"):
        text = file.read_text()
        assert "labels" not in text, file
        assert "blindtest" not in text, file


#: s, sample time; m, step of the encoder.
DT, STEP = 0.004, 2e-5


def encoded(seed: int, amplitude: float, hz: float, u: float) -> dict[str, Array]:
    """A sine whose displacement is read in steps, with noise of the force."""
    t = DT * np.arange(800)
    angle = 2 * np.pi * hz * t
    v = amplitude * 2 * np.pi * hz * np.cos(angle)
    command = np.full(len(t), u)
    noise = np.random.default_rng(seed).normal(0, 2.0, len(t))
    steps = STEP * np.round(amplitude * np.sin(angle) / STEP)
    return {"time_s": t, "displacement_m": steps, "command": command, "force_N": force(v, command) + noise}


def by_hand(simulator: Path, records: list[Path], folder: Path) -> float:
    """RMS over records of the error over the force, without the first tenth of a second and the last eight samples."""
    squares = []
    for record in records:
        written = folder / "predicted.csv"
        assert cli.main(["predict", str(simulator), str(record), "-o", str(written)]) == 0
        made, true = (np.genfromtxt(f, delimiter=",", names=True)["force_N"] for f in (written, record))
        kept = slice(round(0.1 / DT), -8)
        squares.append(np.mean((made - true)[kept] ** 2) / np.mean(true[kept] ** 2))
    return float(np.sqrt(np.mean(squares)))


def test_what_is_not_fitted_has_one_figure_on_the_records_and_on_the_baseline(tmp_path: Path) -> None:
    """An encoder's steps are half of the file's gap; a search smoothes them away."""
    tests = [(0.01, 1.0, 0.0), (0.008, 1.4, 1.0), (0.005, 2.0, 0.5)]
    names = [f"{part}_{k}.csv" for part in ("now", "before") for k in range(3)]
    made = {name[:-4]: encoded(k, *tests[k % 3]) for k, name in enumerate(names)}
    folder = write_case(tmp_path / "case", made, records=names[:3], baseline=names[3:])
    halves = ([folder / name for name in some] for some in (names[:3], names[3:]))
    now, before = (by_hand(folder / "case.json", half, tmp_path) for half in halves)
    found = diagnose(read_case(folder))
    assert found.verdict == "none"
    assert found.gap.recalibrated < 0.7 * now
    assert found.gap.baseline == pytest.approx(before, rel=1e-4)
    assert found.gap.nominal == found.gap.corrected == found.gap.left_out == pytest.approx(now, rel=1e-4)
    assert {s.gap for s in found.waterfall if s.name in ("nominal", "unchanged")} == {found.gap.nominal}
    assert found.waterfall[0].interval == found.gap.interval
    assert [c.heldout_gap for c in found.candidates if not c.causes] == [found.gap.nominal]
    said = f"{100 * now:.1f} % on these records and {100 * before:.1f} % on the baseline's"
    assert said in found.sentence
    assert table(found).count(f"{100 * now:.1f} %") >= 3
