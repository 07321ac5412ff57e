"""`mrdamp case`: a folder that `mrdamp diagnose` reads."""

from __future__ import annotations

import gzip
import hashlib
import json
from pathlib import Path

import pytest

from mrdamp.cli import main
from mrdamp.diagnosis.case.folder import read_case
from mrdamp.files import write_atomic
from mrdamp.model import Model
from mrdamp.records import embedded, read_records
from mrdamp.records.csv_file import render


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "records").mkdir()
    for record in embedded().train[:2]:
        write_atomic(tmp_path / "records" / f"{record.name}.csv", render(record.channels))
    return tmp_path / "records"


def another(record: Path) -> str:
    """The text of a record with another last digit."""
    text = record.read_text()
    return text[:-2] + ("1" if text[-2] != "1" else "2") + "\n"


def test_a_case_is_what_went_in(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, again = folder.parent / "case", folder.parent / "again.csv"
    first = min(folder.iterdir())
    again.write_bytes(first.read_bytes())
    assert main(["case", "dyke1996_3kN", str(folder), "--repeat", str(again), "-o", str(out)]) == 2
    assert f"it holds the same samples as {first}" in capsys.readouterr().err
    again.write_text(another(first))
    assert main(["case", "dyke1996_3kN", str(folder), "--repeat", str(again), "-o", str(out)]) == 0
    case = read_case(out)
    assert case.model.law == "modified_bouc_wen"
    assert [r.name for r in case.records] == sorted(r.name for r in embedded().train[:2])
    assert [(r.name, of) for r, of in case.repeats] == [("repeat_again", 0)]


@pytest.mark.parametrize("halves", [False, True])
def test_a_folder_holds_the_same_records_for_every_command(folder: Path, halves: bool) -> None:
    first, second = sorted(folder.iterdir())
    (folder / ".hidden.csv").write_text("no record")
    (folder / "notes.txt").write_text("no record")
    if halves:
        for half, file in (("train", first), ("validation", second)):
            (folder / half).mkdir()
            file.rename(folder / half / file.name.replace(".csv", ".CSV"))
    else:
        first.rename(folder / "B.CSV")
    out = folder.parent / "case"
    assert main(["case", "dyke1996_3kN", str(folder), "-o", str(out)]) == 0
    names = json.loads((out / "case.json").read_text())["records"]
    taken = {name[: -len(".csv")] for name in names}
    assert taken == {r.name for r in read_records(folder)} == {r.name for r in read_records([folder])}
    assert len(taken) == 2


def test_bad_input_leaves_no_folder(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder.parent / "case"
    (folder / "zz.csv").write_text("time_s,displacement_m\n0,0\n1,0\n")
    assert main(["case", "dyke1996_3kN", str(folder), "-o", str(out)]) == 2
    assert "zz.csv" in capsys.readouterr().err
    assert not out.exists()
    out.mkdir()
    (folder / "zz.csv").unlink()
    assert main(["case", "dyke1996_3kN", str(folder), "-o", str(out)]) == 2
    assert list(out.iterdir()) == []


def test_a_case_that_cannot_be_diagnosed_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, short = folder.parent / "case", folder / "zz.csv"
    short.write_text("\n".join(min(folder.iterdir()).read_text().splitlines()[:76]) + "\n")
    assert main(["case", "dyke1996_3kN", str(folder), "-o", str(out)]) == 2
    assert "zz.csv: 75 samples; at least 100 are needed" in capsys.readouterr().err
    assert not out.exists()


def test_a_simulator_in_another_unit_than_the_records_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same dashpot, identified on forces in kN."""
    law = {"c0a": 1.5, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01}
    model, out = folder.parent / "kN.json", folder.parent / "case"
    Model("bingham", law).write(model)
    assert main(["case", str(model), str(folder), "-o", str(out)]) == 2
    assert "are in different units" in capsys.readouterr().err
    assert not out.exists()
    Model("bingham", {**law, "c0a": 1500.0}).write(model)
    assert main(["case", str(model), str(folder), "-o", str(out)]) == 0


def test_baseline_records_stand_apart(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, before = folder.parent / "case", folder.parent / "before"
    before.mkdir()
    first = min(folder.iterdir())
    (before / first.name).write_text(another(first))  # the same name as one of the records
    assert main(["case", "dyke1996_3kN", str(folder), "--baseline", str(before), "-o", str(out)]) == 0
    case = read_case(out)
    assert len(case.records) == 2
    assert [r.name for r in case.baseline] == [f"baseline_{first.name.removesuffix('.csv')}"]
    again = ["case", "dyke1996_3kN", str(folder), "--baseline", str(first), "-o", str(folder.parent / "two")]
    assert main(again) == 2
    assert "--baseline" in capsys.readouterr().err
    assert not (folder.parent / "two").exists()


def test_a_case_knows_the_records_that_its_simulator_was_identified_on(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = sorted(folder.iterdir())
    model = folder.parent / "model.json"
    fit = ["--law", "bingham", "--dependence", "constant", "--starts", "1", "-o", str(model)]
    assert main(["identify", str(first), str(second), *fit]) == 0
    told = json.loads(model.read_text())["identified_on"]
    lines = [line.split() for line in capsys.readouterr().out.splitlines() if " fitted " in line]
    fitted = {line[0] for line in lines if line[1:2] == ["fitted"]}  # the other one is held out
    assert len(fitted) == 1
    expected = {f.name: hashlib.sha256(f.read_bytes()).hexdigest()[:16] for f in (first, second) if f.stem in fitted}
    assert {entry["record"]: entry["sha256"] for entry in told} == expected
    first, second = sorted((first, second), key=lambda f: f.stem not in fitted)

    def question(name: str, *arguments: str) -> tuple[int | None, str]:
        out = folder.parent / name
        assert main(["case", *arguments, "-o", str(out)]) == 0
        case = read_case(out)
        return case.own, case.question

    packed = folder.parent / "packed.csv.gz"  # another name, the same text
    packed.write_bytes(gzip.compress(first.read_bytes()))
    other = folder.parent / "other.csv"
    other.write_text(another(first))
    assert question("same", str(model), str(folder)) == (1, "missed")
    assert question("packed", str(model), str(packed)) == (1, "missed")
    assert question("other", str(model), str(other)) == (0, "either")
    assert question("changed", str(model), str(first), "--baseline", str(second)) == (1, "changed")
    assert question("plain", "dyke1996_3kN", str(folder)) == (None, "either")
    broken = json.loads((folder.parent / "same" / "case.json").read_text()) | {"identified_on": "all"}
    (folder.parent / "same" / "case.json").write_text(json.dumps(broken))
    capsys.readouterr()
    assert main(["diagnose", str(folder.parent / "same"), "-o", str(folder.parent / "answer")]) == 2
    assert "'identified_on' must be a list" in capsys.readouterr().err
