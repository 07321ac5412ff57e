"""`mrdamp case` makes a folder that `mrdamp diagnose` reads; `mrdamp sensitivity`: what is
tried, kept and gone on with."""

from __future__ import annotations

import gzip
import hashlib
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bingham_rig import write_case
from mjcf_builders import dashpot
from mrdamp.cli import main
from mrdamp.diagnosis.case.folder import Case, read_case
from mrdamp.diagnosis.injection import summary
from mrdamp.diagnosis.injection.sensitivity import AS_THEY_ARE, Answer, Study, Trial, injected
from mrdamp.files import write_atomic
from mrdamp.model import Model
from mrdamp.records import Record, embedded
from mrdamp.records.csv_file import render


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "records").mkdir()
    for record in embedded().train[:2]:
        write_atomic(tmp_path / "records" / f"{record.name}.csv", render(record.channels))
    return tmp_path / "records"


def another(record: Path) -> str:
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


@pytest.mark.parametrize(
    ("c", "samples", "said"),
    [
        (1500.0, 2, "zz.csv: 2 samples"),
        (1500.0, 75, "zz.csv: 75 samples; at least 100 are needed"),
        (1.5, 2000, "are in another unit"),  # a dashpot identified on forces in kN
    ],
)
def test_bad_input_leaves_no_folder(
    c: float, samples: int, said: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, out, short = folder.parent / "model.json", folder.parent / "case", folder / "zz.csv"
    Model("bingham", dashpot(c)).write(model)
    short.write_text("\n".join(another(min(folder.iterdir())).splitlines()[: samples + 1]) + "\n")
    call = ["case", str(model), str(folder), "-o", str(out)]
    assert main(call) == 2
    assert said in capsys.readouterr().err
    assert not out.exists()
    Model("bingham", dashpot(1500.0)).write(model)
    short.unlink()
    assert main(call) == 0
    assert main(call) == 2  # the folder is there


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


#: Three records of the embedded set at constant commands.
HELD = [r for r in embedded().train if np.ptp(r.command) < 1e-3][:3]


@pytest.fixture
def case(tmp_path: Path) -> Path:
    kept = ("displacement_m", "command", "force_N")
    records = [Record(r.name, None, r.sample_time, {n: r.channel(n) for n in kept}).part(0, 2) for r in HELD]
    return write_case(tmp_path / "case", {r.name: r.channels for r in records})


class Knowing:
    """Stands in for the diagnosis: it knows the records as they were, and names what scaled or moved their force."""

    def __init__(self, folder: Path, least: float) -> None:
        self.before = {r.name: r for r in read_case(folder).records}
        self.least, self.calls = least, 0
        self.stop_at: int | None = None

    def __call__(self, case: Case, **_: Any) -> SimpleNamespace:
        self.calls += 1
        if self.calls == self.stop_at:
            raise KeyboardInterrupt
        change = np.concatenate([r.channel("force_N") - self.before[r.name].channel("force_N") for r in case.records])
        cause = "sensor_offset" if float(np.std(change)) < 1e-6 else "sensor_gain"
        names = [cause] if float(np.sqrt(np.mean(change**2))) > 500 * self.least else []
        return SimpleNamespace(
            verdict="effect" if names else "unknown", effects=[SimpleNamespace(effect=n) for n in names],
            indistinguishable=(), probabilities=dict.fromkeys(names, 0.9), sentence="It is so.",
            gap=SimpleNamespace(nominal=0.3, corrected=0.1),
        )  # fmt: skip


@pytest.fixture
def knowing(case: Path, monkeypatch: pytest.MonkeyPatch) -> Knowing:
    found = Knowing(case, least=0.1)
    monkeypatch.setattr("mrdamp.diagnosis.run.diagnose", found)
    return found


ASKED = ("--effects", "sensor_gain", "sensor_offset", "command_delay", "heating", "--sizes", "0.02", "0.3")


def test_what_is_found_from_which_size_on(
    case: Path, knowing: Knowing, capsys: pytest.CaptureFixture[str]
) -> None:
    out = case.parent / "out"
    assert main(["sensitivity", str(case), "-o", str(out), *ASKED]) == 0
    assert knowing.calls == 5
    told = json.loads((out / "sensitivity.json").read_text())
    assert told["complete"]
    assert {e["effect"]: e["named_from"] for e in told["effects"]} == {"sensor_gain": 0.3, "sensor_offset": 0.3}
    assert told["effects"][0]["parameters"]["g"] != 1
    assert told["effects"][0]["outcomes"] == {"0.02": "unknown", "0.3": "named"}
    assert "constant in every record" in told["never"]["command_delay"]
    assert list(told["not_tried"]) == ["heating"]
    assert told["confusion"]["counts"] == [[1, 0, 1], [0, 1, 1]]
    assert told["confusion"]["columns"] == ["sensor_gain", "sensor_offset", "unknown"]
    printed = capsys.readouterr().out
    assert "Named on these records: sensor_gain from 30 %, sensor_offset from 30 % of the force." in printed
    html = (out / "index.html").read_text()
    assert "Effects that these records cannot show" in html
    assert html.count("<svg") == 2


def test_the_effect_has_the_size_that_was_asked_for(case: Path) -> None:
    study = Study.of(read_case(case), ["sensor_offset", "moving_mass"], [0.1])
    assert study.trials[0] == Trial(AS_THEY_ARE, 0.0)
    for trial in study.trials[1:]:
        made = injected(study, trial)
        assert made is not None
        total = [
            np.mean((new.channel("force_N") - old.channel("force_N"))[50:] ** 2)
            / np.mean(old.channel("force_N")[50:] ** 2)
            for new, old in zip(made[0].records, study.case.records, strict=True)
        ]
        assert np.sqrt(np.mean(total)) == pytest.approx(0.1, rel=0.03)
        again = injected(study, trial)
        assert again is not None
        assert again[1] == made[1]


def answers(*rows: tuple[str, float, str, tuple[str, ...]]) -> list[Answer]:
    return [Answer(effect, size, True, {"p": size}, verdict, named) for effect, size, verdict, named in rows]


def test_only_what_larger_sizes_confirm_counts_as_named() -> None:
    found = summary.findings(
        answers(
            (AS_THEY_ARE, 0.0, "effect", ("channel_shift",)),
            ("sensor_gain", 0.02, "effect", ("sensor_gain", "channel_shift")),
            ("sensor_gain", 0.1, "effect", ("asymmetry", "channel_shift")),
            ("sensor_gain", 0.4, "effect", ("sensor_gain",)),
            ("backlash", 0.1, "effect", ("channel_shift",)),
            ("channel_shift", 0.1, "effect", ("channel_shift",)),
        )
    )
    by_name = {f.effect: f for f in found}
    assert by_name["sensor_gain"].named_from == 0.4
    assert by_name["sensor_gain"].taken_for == ("asymmetry",)
    assert by_name["backlash"].outcomes == {0.1: "none"}  # what the rig has anyway is no answer
    assert by_name["channel_shift"].outcomes == {0.1: "already"}
    assert by_name["channel_shift"].named_from is None


@pytest.mark.slow
def test_a_gain_is_found_beside_the_load_cell(tmp_path: Path) -> None:
    """The real diagnosis, on records that another program made: the corrected simulator has the gain."""
    from mrdamp.identify import identify

    nominal = identify("hyperbolic_tangent", HELD, starts=2).model.to_dict()["model"]
    folder = write_case(tmp_path / "case", {r.name: r.channels for r in HELD}, nominal=nominal)
    out = tmp_path / "out"
    asked = ["--effects", "sensor_gain", "--sizes", "0.3"]
    assert main(["sensitivity", str(folder), "-o", str(out), *asked]) == 0
    told = json.loads((out / "sensitivity.json").read_text())
    (trial,) = (t for t in told["trials"] if t["effect"] == "sensor_gain")
    # Two readings of one force, a factor apart.
    assert trial["gap"]["nominal"] > 1.5 * told["trials"][0]["gap"]["nominal"]
    assert trial["gap"]["corrected"] < 0.6 * trial["gap"]["nominal"]


def test_an_interrupted_run_goes_on_with_its_own_results(case: Path, knowing: Knowing) -> None:
    out = case.parent / "out"
    knowing.stop_at = 4
    assert main(["sensitivity", str(case), "-o", str(out), *ASKED]) == 130
    told = json.loads((out / "sensitivity.json").read_text())
    assert not told["complete"]
    assert len(told["trials"]) == 3
    assert "3 trials done so far, at most 2 to come" in (out / "index.html").read_text()
    knowing.calls, knowing.stop_at = 0, None
    assert main(["sensitivity", str(case), "-o", str(out), *ASKED]) == 0
    assert knowing.calls == 2
    assert json.loads((out / "sensitivity.json").read_text())["complete"]
    (out / "runs" / "sensor_gain_0.3.json").write_text("{")  # of a stopped machine
    for more, calls in (((), 3), (("--seed", "1"), 8)):  # results of other records are void
        assert main(["sensitivity", str(case), "-o", str(out), *ASKED, *more]) == 0
        assert knowing.calls == calls
