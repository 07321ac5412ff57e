"""The commands: what they write, how they fail, and that outputs replace no input; work over processes."""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import stat
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info  # type: ignore[import-untyped]

from mrdamp import cli, demo, sets
from mrdamp.cli import build_parser, main, script
from mrdamp.commands import OutFile
from mrdamp.files import together, write_atomic
from mrdamp.model import Model
from mrdamp.motions import embedded_motion
from mrdamp.parallel import mapped
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


@pytest.mark.parametrize(
    ("call", "said"),
    [
        ("predict {model} {bad} -o {out}", "bad.csv: missing channel command"),
        ("predict {here} {record} -o {out}", "case.json"),
        ("sets ghost", "spencer1997_3kN"),
        ("view frame3", "DISPLAY"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_leaves_nothing(
    call: str,
    said: str,
    record: Path,
    model: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    bad, out = tmp_path / "bad.csv", tmp_path / "out.csv"
    bad.write_text("time_s,displacement_m\n0,0\n1,0\n2,0\n")
    words = call.format(model=model, record=record, bad=bad, out=out, here=tmp_path).split()
    assert cli.main(words) == 2
    text = capsys.readouterr().err
    assert text.startswith("mrdamp: ")
    assert text.count("\n") == 1
    assert said in text
    assert not out.exists()


@pytest.mark.parametrize(
    ("call", "said"),
    [
        ("identify records --seed -1", "--seed: -1; allowed: 0 or more; see mrdamp identify --help"),
        ("train", "required: environment, -o/--out; see mrdamp train --help"),
        ("damp", "invalid choice: 'damp'"),
    ],
)
def test_wrong_arguments_are_told_in_a_line(call: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(call.split()) == 2
    text = capsys.readouterr().err
    assert said in text
    assert text.count("\n") == 1


def test_a_list_that_is_given_again_goes_on() -> None:
    (commands,) = (a for a in build_parser()._actions if isinstance(a, argparse._SubParsersAction))
    lists = [
        (command, action)
        for command in commands.choices.values()
        for action in command._actions
        if action.option_strings and action.nargs in ("+", "*")
    ]
    assert len(lists) > 12
    for command, action in lists:
        given = argparse.Namespace(**{action.dest: action.default})
        for values in (["a"], ["b", "c"]):
            action(command, given, values, action.option_strings[0])
        assert getattr(given, action.dest) == ["a", "b", "c"], (command.prog, action.dest)


@pytest.mark.slow
def test_the_demo_runs_and_goes_on_where_it_was(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for half, records in (("train", embedded().train[1:4]), ("validation", embedded().validation[:2])):
        (tmp_path / "set" / half).mkdir(parents=True)
        for r in records:
            r.part(0.0, 2.0).save(tmp_path / "set" / half / f"{r.name}.csv")
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


def complete(*words: str) -> list[str]:
    """What bash offers for the last word."""
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("bash is not installed")
    line = "\n".join(script(cli.build_parser(), "bash"))
    array = " ".join(f"'{word}'" for word in ("mrdamp", *words))
    ask = f"{line}\nCOMP_WORDS=({array}); COMP_CWORD={len(words)}; _mrdamp; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    done = subprocess.run([bash, "--norc", "-c", ask], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.slow
def test_bash_completes_commands_options_choices_and_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "model.json").write_text("{}")
    monkeypatch.chdir(tmp_path)
    assert complete("ident") == ["identify"]
    assert {"demo", "sets", "citation"} <= set(complete(""))
    assert complete("citation", "--bib") == ["--bibtex"]
    assert complete("inverse", "model.json", "--command-unit", "") == ["A", "V"]
    assert complete("predict", "mod") == ["model.json"]
    assert complete("completion", "z") == ["zsh"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "set").mkdir()
    record, other = (embedded().train[k].part(0.0, 1.0) for k in (0, 1))
    for name in ("r.csv", "r.csv.gz", "set/a.csv"):
        record.save(tmp_path / name)
    other.save(tmp_path / "set" / "b.csv")
    (tmp_path / "set" / "case.json").write_text("{}")
    (tmp_path / "m.json").write_text('{"model": {"law": "bingham", "parameters": {"c0a": 500, "c0b": 0, "fya": 300,'
                                     ' "fyb": 0, "v_ref": 0.1}}}')  # fmt: skip
    monkeypatch.chdir(tmp_path)
    return tmp_path


def outputs() -> Iterator[tuple[str, argparse.ArgumentParser, argparse.Action]]:
    (commands,) = (a for a in build_parser()._actions if isinstance(a, argparse._SubParsersAction))
    for name, command in commands.choices.items():
        for action in command._actions:
            if action.dest in ("out", "picture", "page"):
                yield name, command, action


@pytest.mark.parametrize(
    "call",
    [
        "predict m.json r.csv.gz -o r.csv.gz",
        "identify r.csv -o r.csv",
        "identify set -o set/b.csv",
        "convert r.csv --columns displacement_m=displacement_m -o .",
        "mjcf m.json -o .",
        "demo --data set -o set",
        "identify r.csv -o x.svg --picture x.svg",
        "predict m.json r.csv -o /dev/full",
        "predict m.json r.csv -o pipe",
        # a link to an input
        "convert r.csv --columns time_s=time_s displacement_m=displacement_m command=command force_N=force_N -o there",
    ],
)
def test_an_output_that_would_replace_something_is_refused(
    call: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo("pipe")
    Path("there").mkdir()
    Path("there/r.csv").symlink_to("../r.csv")
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    assert main(call.split()) == 2
    said = capsys.readouterr().err
    assert said.startswith("mrdamp: ")
    assert said.count("\n") == 1
    assert {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before
    assert stat.S_ISCHR(Path("/dev/full").stat().st_mode)
    assert stat.S_ISFIFO(Path("pipe").stat().st_mode)


def test_every_command_looks_at_its_outputs_before_any_work() -> None:
    """The arguments are empty: a command that began to work would fail in another way."""
    seen = list(outputs())
    assert len(seen) > 15
    for name, command, action in seen:
        assert action.type is not None
        given = argparse.Namespace(**{a.dest: None for a in command._actions})
        nodes = ("/dev/full", "/dev") if action.type is OutFile else ()
        for path in ("/proc/none.svg", f"{__file__}/none.svg", *nodes):
            assert callable(action.type), name
            setattr(given, action.dest, action.type(path))
            refuses(lambda g=given, c=command: c.get_default("run")(g), "cannot be written")  # type: ignore[misc]


def test_files_appear_together_or_not_at_all(tmp_path: Path) -> None:
    (tmp_path / "b").write_text("old")

    def fail() -> None:
        with together():
            write_atomic(tmp_path / "a", "new")
            write_atomic(tmp_path / "b", "new")
            assert (tmp_path / "b").read_text() == "old"
            write_atomic(tmp_path / "none" / "c", "new")

    refuses(fail, "cannot be written")
    assert [p.name for p in tmp_path.iterdir()] == ["b"]
    with together():
        write_atomic(tmp_path / "a", "new")
        write_atomic(tmp_path / "b", "new")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"a": "new", "b": "new"}


@pytest.mark.parametrize(
    "call",
    [
        "predict m.json r.csv -o out/p.csv",
        "mjcf m.json -o out",
        "convert r.csv --columns time_s=time_s displacement_m=displacement_m command=command force_N=force_N -o out",
        "case m.json r.csv -o out/case",
        "identify set --law bingham --starts 1 -o out/model.json --picture out/loops.png",
        pytest.param("calibrate -o out", marks=pytest.mark.slow),
        pytest.param("compare frame --controllers passive-on --motions a.csv --jobs 1 -o out", marks=pytest.mark.slow),
    ],
)
def test_a_full_disk_leaves_no_part_of_a_result(
    call: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A limit on the size of files stands for the disk: the small files of a result fit, its large ones do not."""
    embedded_motion().compressed(10).save(folder / "a.csv")
    out = folder / "out"
    out.mkdir()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1500, before[1]))
    try:
        assert main(call.split()) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("mrdamp: out/")
    assert "File too large" in said
    assert [p for p in out.rglob("*") if p.is_file() and p.name != "kept.jsonl"] == []
    assert main(call.split()) == 0


def threads() -> int:
    np.ones((4, 4)) @ np.ones((4, 4))
    return max((int(pool["num_threads"]) for pool in threadpool_info()), default=1)


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_task_has_one_thread_of_blas(jobs: int) -> None:
    assert list(mapped(threads, [(), ()], jobs)) == [1, 1]
