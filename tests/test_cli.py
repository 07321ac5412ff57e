"""The commands: what they write, and how they fail."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrdamp import cli, sets
from mrdamp.demo import run as demo
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.records import embedded, read_record
from mrdamp.simulation.predict import played, write_prediction
from mrdamp.simulation.stepping import drive_rig
from refusals import refuses


@pytest.fixture
def record(tmp_path: Path) -> Path:
    path = tmp_path / "record.csv"
    embedded()["sine_1.0Hz_2.5mm_random_current"].part(0.0, 2.0).save(path)
    return path


@pytest.fixture
def model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    path = tmp_path / "model.json"
    assert cli.main(["sets", "spencer1997_3kN"]) == 0
    path.write_text(capsys.readouterr().out)
    return path


def line(capsys: pytest.CaptureFixture[str]) -> str:
    """What an error wrote: one line."""
    text = capsys.readouterr().err
    assert text.startswith("mrdamp: ")
    assert text.count("\n") == 1
    return text


def test_predict_writes_the_simulated_channels(record: Path, model: Path, tmp_path: Path) -> None:
    out = tmp_path / "pred.csv"
    assert cli.main(["predict", str(model), str(record), "-o", str(out)]) == 0
    written = np.genfromtxt(out, delimiter=",", names=True)
    assert written.dtype.names == ("time_s", "force_N", "reference_force_N")
    factor, sample_time, inputs = played(Model.read(model), read_record(record))
    stepped = drive_rig(Model.read(model), sample_time, inputs)["force_N"][::factor]
    error = np.sqrt(np.mean((written["force_N"] - stepped) ** 2) / np.mean(stepped**2))
    assert error < 0.005


def test_predict_does_not_look_at_the_outputs(record: Path, model: Path, tmp_path: Path) -> None:
    outs = []
    read = read_record(record)
    for k, factor in enumerate((1.0, -3.0)):
        changed = tmp_path / f"changed{k}.csv"
        read.with_channels({**read.channels, "force_N": factor * read.channel("force_N")}).save(changed)
        outs.append(tmp_path / f"pred{k}.csv")
        assert cli.main(["predict", str(model), str(changed), "-o", str(outs[-1])]) == 0
    assert outs[0].read_text() == outs[1].read_text()


def test_a_prediction_holds_no_nan(record: Path, tmp_path: Path) -> None:
    found = sets.load("dyke1996_3kN")
    beyond = Model(found.law, {**found.parameters, "x0": 1e308})
    refuses(lambda: write_prediction(beyond, record, tmp_path / "p.csv"), "force_N is no finite number from sample")
    assert not (tmp_path / "p.csv").exists()


def test_predict_prints_the_error_that_identify_calls_held_out(
    record: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And neither takes a measured velocity for the displacement's, here one that is a tenth too large."""
    one = read_record(record)
    fitted, held = one.part(0.0, 1.3), one.part(1.302, 2.0)
    names = []
    for name, part in (("train/a.csv", fitted), ("validation/b.csv", held)):
        names.append(tmp_path / "set" / name)
        names[-1].parent.mkdir(parents=True)
        part.with_channels({"velocity_m_s": 1.1 * part.velocity()}).save(names[-1])
    out = tmp_path / "fit.json"
    call = ["identify", str(tmp_path / "set"), "--law", "bingham", "--starts", "1", "--json", "-o", str(out)]
    assert cli.main(call) == 0
    (told,) = json.loads(capsys.readouterr().out)["held_out"]["records"]
    assert cli.main(["predict", str(out), str(names[1]), "-o", str(tmp_path / "p.csv")]) == 0
    force = np.genfromtxt(tmp_path / "p.csv", delimiter=",", names=True)["force_N"]
    skip = round(0.02 / held.sample_time)
    by_hand = float(np.sqrt(np.mean((force - held.channel("force_N"))[skip:] ** 2)))
    assert told["rmse_N"] == pytest.approx(by_hand, rel=1e-4)
    assert f"force_N: RMS error {by_hand:.4g}, {told['nrmse']:.3f} of its" in capsys.readouterr().out


def test_mjcf_writes_a_model_that_loads(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import mujoco

    assert cli.main(["mjcf", str(model), "-o", str(tmp_path / "rig")]) == 0
    scene = capsys.readouterr().out.strip()
    loaded = mujoco.MjModel.from_xml_path(scene)
    assert loaded.actuator("damper").id == 0
    assert cli.main(["mjcf", "vrths_2022", "-o", str(tmp_path / "other")]) == 0


def test_identify_writes_a_model(record: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "fit.json"
    assert cli.main(["identify", str(record), "--law", "bingham", "--starts", "1", "-o", str(out)]) == 0
    assert "held-out records" in capsys.readouterr().out
    assert Model.read(out).law == "bingham"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "empty"),
        ("time_s,displacement_m\n0,0\n1,0\n2,0\n", "command"),
        ("time_s,displacement_m,command\n0,0,0\n0.1,nan,0\n0.2,0,0\n", "displacement_m"),
        ("time_s,displacement_m,command\n0,0,0\n0.1,0,0\n0.5,0,0\n0.6,0,0\n", "time_s"),
        ("time_s,displacement_m,command\n0,0,0\n0.1,0,0\n", "2 samples"),
        ("time_s,displacement_mm,command\n0,0,0\n0.1,0,0\n0.2,0,0\n", "displacement_m"),
    ],
)
def test_a_bad_record_is_one_line_and_leaves_nothing(
    content: str, said: str, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad, out = tmp_path / "bad.csv", tmp_path / "pred.csv"
    bad.write_text(content)
    assert cli.main(["predict", str(model), str(bad), "-o", str(out)]) == 2
    text = line(capsys)
    assert "bad.csv" in text
    assert said in text
    assert not out.exists()


def test_a_truncated_gz_is_one_line(
    record: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    packed = tmp_path / "packed.csv.gz"
    read_record(record).save(packed)
    packed.write_bytes(packed.read_bytes()[:200])
    assert cli.main(["predict", str(model), str(packed), "-o", str(tmp_path / "p.csv")]) == 2
    assert "packed.csv.gz" in line(capsys)


def test_a_model_that_is_none_is_one_line(
    record: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["predict", str(tmp_path), str(record), "-o", str(tmp_path / "p.csv")]) == 2
    assert "case.json" in line(capsys)
    assert cli.main(["sets", "ghost"]) == 2
    assert "spencer1997_3kN" in line(capsys)
    assert cli.main(["view", str(tmp_path / "ghost.xml")]) == 2
    assert "ghost.xml" in line(capsys)


def test_view_without_a_display_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert cli.main(["view", "frame3"]) == 2
    assert "DISPLAY" in line(capsys)


def test_plugin_path_names_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["plugin-path"]) == 0
    assert Path(capsys.readouterr().out.strip()).is_file()


@pytest.mark.slow
def test_the_demo_runs_and_goes_on_where_it_was(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    records = embedded()
    for half in ("train", "validation"):
        (tmp_path / "set" / half).mkdir(parents=True)
    for r in records.train[1:4]:
        r.part(0.0, 2.0).save(tmp_path / "set" / "train" / f"{r.name}.csv")
    for r in records.validation[:2]:
        r.part(0.0, 2.0).save(tmp_path / "set" / "validation" / f"{r.name}.csv")
    arguments = ["demo", "--data", str(tmp_path / "set"), "--law", "bouc_wen", "-o", str(tmp_path / "out")]
    assert cli.main(arguments) == 0
    said = capsys.readouterr().out
    for controller in ("no damper", "passive-off", "passive-on", "clipped-optimal"):
        assert controller in said
    page = (tmp_path / "out" / "index.html").read_text()
    assert page.count("<figure") >= 6
    kept = json.loads((tmp_path / "out" / "fit.json").read_text())
    assert len(kept["held_out"]) == 2

    def fail(*_: object, **__: object) -> None:
        raise AssertionError("the fit that is there must be taken")

    monkeypatch.setattr(demo, "identify", fail)
    assert cli.main(arguments) == 0
    assert capsys.readouterr().out.splitlines()[:2] == said.splitlines()[:2]
    assert Model.read(tmp_path / "out" / "frame" / "model.json").rig == "frame"


@pytest.mark.parametrize("where", ["here.json", "here.json/below"])
def test_a_folder_that_cannot_be_made_is_one_line(
    where: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "here.json"
    found = sets.load("dyke1996_3kN")
    Model(found.law, dict(found.parameters)).write(model)
    assert cli.main(["mjcf", str(model), "-o", str(tmp_path / where)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "here.json" in said


def test_a_negative_seed_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(["identify", "records", "--seed", "-1"])
    assert "allowed: 0 or more" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"effects": [{"name": "driver_lag", "parameters": {"tau": 0.01}}] * 2}, "driver_lag stands there twice"),
        ({"structure": {"mass_kg": [1.0]}}, "allowed: rig 'frame'"),
        ({"parameters": {"c0a": 10**400}}, "allowed: a finite number"),
    ],
)
def test_a_model_file_that_says_two_things(change: dict[str, Any], said: str) -> None:
    found = sets.load("dyke1996_3kN")
    data = Model(found.law, dict(found.parameters)).to_dict()
    data["model"] |= change
    with pytest.raises(InputError, match=said):
        Model.from_dict(data)


@pytest.mark.slow
@pytest.mark.parametrize("module", ["gymnasium", "argparse"])
def test_an_interrupt_while_modules_are_imported_is_one_line(module: str, tmp_path: Path) -> None:
    interrupt = "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(5)\n"
    (tmp_path / f"{module}.py").write_text(interrupt)
    done = subprocess.run(
        [sys.executable, "-m", "mrdamp", "sets"],
        env={**os.environ, "PYTHONPATH": str(tmp_path)}, capture_output=True, text=True, check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background job ignores it
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (130, "mrdamp: interrupted\n")
