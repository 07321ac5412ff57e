"""Outputs replace no input, device or pipe and are checked before any work; work over processes."""

from __future__ import annotations

import argparse
import os
import resource
import stat
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info  # type: ignore[import-untyped]

from mrdamp.cli import build_parser, main
from mrdamp.commands import OutFile
from mrdamp.files import together, write_atomic
from mrdamp.motions import embedded_motion
from mrdamp.parallel import mapped
from mrdamp.records import embedded
from refusals import refuses


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
        "predict m.json r.csv -o ./set/../r.csv",
        "identify r.csv -o r.csv",
        "identify set -o set/b.csv",
        "identify set -o set/case.json",
        "convert r.csv --columns displacement_m=displacement_m -o .",
        "mjcf m.json -o .",
        "demo --data set -o set",
        "identify r.csv -o x.svg --picture x.svg",
        "predict m.json r.csv -o /dev/full",
        "predict m.json r.csv -o /dev/stdout",
        "predict m.json r.csv -o pipe",
        "predict m.json r.csv -o set",
        "mjcf m.json -o r.csv/below",
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
