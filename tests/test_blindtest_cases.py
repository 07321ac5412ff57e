"""Cases of the blind test: their files, what they are made of, and that the diagnosis knows nothing of them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from modules import ROOT, STUDIES
from mrdamp.model import Model, core, damper_effects
from mrdamp.records import read_record
from studies.blindtest import (
    bench,
    case_sampling,
    causes,
    damper_case,
    dampers,
    excitation,
    frame_case,
    frame_causes,
    recorder,
    unknown,
)
from studies.blindtest.bench import Truth
from studies.blindtest.make import main, make_one
from studies.blindtest.rig import Array, BlownUp
from studies.blindtest.scale import Scale
from studies.blindtest.sizing import Faint, Task, goal, must_show, relative, size_for

SCALE = Scale(force=500.0, power=40.0, stroke=0.005, acceleration=1.0, command=1.0)


def made(task: Task, folder: Path, seed: int) -> tuple[Path, dict[str, dict[str, Array]], dict[str, object]]:
    """Case folder, tests by name and channel, label."""
    maker = damper_case.make if task.rig == "damper" else frame_case.make
    label = maker(task, folder / "case", folder / "tests.npz", np.random.SeedSequence(seed))
    arrays, tests = np.load(folder / "tests.npz"), dict[str, dict[str, Array]]()
    for key in arrays.files:
        test, channel = key.split("/")
        tests.setdefault(test, {})[channel] = arrays[key].astype(float)
    return folder / "case", tests, label


# --- one case ---------------------------------------------------------------------------------
@pytest.mark.slow
def test_damper_case_without_a_gap(tmp_path: Path) -> None:
    case, tests, label = made(Task("x", "damper", "none"), tmp_path, 3)
    model, told = Model.read(case), json.loads((case / "case.json").read_text())
    assert label["gap"] == pytest.approx(0.0, abs=1e-6)
    assert told["rig"] == "damper"
    assert told["records"] == sorted(path.name for path in case.glob("*.csv.gz"))
    for channels in tests.values():  # the plugin agrees with the rig
        force = model.simulate(0.002, channels)["force_N"]
        assert relative(force, channels["nominal_N"]) < 0.01
        assert relative(channels["nominal_N"], channels["force_N"]) < 1e-6
    level = label["noise"]
    assert isinstance(level, float)
    for name in told["records"]:
        record = read_record(case / name)
        assert list(record.channels) == told["channels"]
        assert record.sample_time == pytest.approx(0.002)
    again = read_record(case / told["records"][-1])
    first = read_record(case / next(name for name in told["records"] if "sine_random" in name))
    assert again.command == pytest.approx(first.command)
    difference = again.channel("force_N") - first.channel("force_N")
    size = float(np.sqrt(np.mean(first.channel("force_N") ** 2)))
    assert np.std(difference) / np.sqrt(2) / size == pytest.approx(level, rel=0.6)


@pytest.mark.slow
def test_effect_opens_a_gap(tmp_path: Path) -> None:
    _, tests, label = made(Task("x", "damper", "seal_friction"), tmp_path, 7)
    assert label["stages"] == ["mechanics"]
    assert 0.02 < float(str(label["gap"])) < 0.6
    found = [relative(c["nominal_N"], c["force_N"]) for c in tests.values()]
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(label["gap"], rel=1e-3)


@pytest.mark.slow
def test_frame_case(tmp_path: Path) -> None:
    case, tests, label = made(Task("x", "frame", "storey_stiffness@2"), tmp_path, 2)
    model = Model.read(case)
    assert model.structure is not None
    assert label["stages"] == ["structure"]
    assert 0.02 < float(str(label["gap"])) < 0.8
    for channels in tests.values():
        inputs = {name: channels[name] for name in ("ground_acceleration_m_s2", "command")}
        simulated = model.simulate(0.002, inputs)
        for floor in (1, 2, 3):
            nominal = channels[f"nominal_floor{floor}_acceleration"]
            assert relative(simulated[f"floor{floor}_acceleration_m_s2"], nominal) < 0.05
            truth = channels[f"floor{floor}_acceleration_m_s2"]
            assert relative(nominal, truth) > 0.01
    told = json.loads((case / "case.json").read_text())
    assert [name.split("_", 1)[1].split(".")[0] for name in told["records"]][-1] == "repeat"
    ground = [read_record(case / name).channel("ground_acceleration_m_s2") for name in told["records"][-2:]]
    assert np.array_equal(ground[0], ground[1])


@pytest.mark.slow
def test_wrong_numbers_are_wrong_and_the_form_is_right(tmp_path: Path) -> None:
    case, tests, label = made(Task("x", "damper", "parameters"), tmp_path, 5)
    nominal_parameters = Model.read(case)
    true = label["true_parameters"]
    assert isinstance(true, dict)
    wrong = [name for name, value in true.items() if nominal_parameters.parameters[name] != value]
    assert 3 <= len(wrong) < len(true)
    law = nominal_parameters.law
    for channels in tests.values():
        for parameters, low, high in ((nominal_parameters.parameters, 0.02, 1.0), (true, 0.0, 0.01)):
            # The rig begins every motion at rest: no run-in.
            x, u = channels["displacement_m"], channels["command"]
            force = core.run(law, parameters, 0.002, x, u=u)["force"]
            assert low < relative(force, channels["force_N"]) < high


@pytest.mark.slow
def test_command_line_and_jobs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def run(out: Path, jobs: str) -> bytes:
        only = ["--rig", "frame", "--only", "none"]
        assert main([str(out), "--seed", "3", "--count", "2", "--jobs", jobs, *only]) == 0
        return b"".join(path.read_bytes() for path in sorted(out.rglob("*.csv.gz")))

    assert run(tmp_path / "one", "1") == run(tmp_path / "two", "2")
    assert json.loads((tmp_path / "one" / "labels.json").read_text()).keys() == {"case_001", "case_002"}
    said = capsys.readouterr().out
    assert "case_002: gap" in said
    assert "none" not in said  # the answer is in labels.json alone


# --- what there is to draw ----------------------------------------------------------------------
def test_every_effect_of_the_catalogue_is_there() -> None:
    structure = {"storey_stiffness", "storey_damping", "joint_friction", "floor_mass"}
    assert set(causes.EFFECTS) <= set(damper_effects())
    assert structure < set(frame_causes.PLACED)
    assert all(len(forms) >= 2 for _, forms in causes.EFFECTS.values())
    assert not {f"~{name}" for name in unknown.DAMPER} & set(causes.EFFECTS)


def test_every_cause_grows_from_nothing() -> None:
    """Numbers of the rig exist, and the size moves at least one of them."""
    rng = np.random.default_rng(0)
    forms = [form for _, drawn in causes.EFFECTS.values() for form in drawn]
    for form in [*forms, *(form for _, form in unknown.DAMPER.values())]:
        sized = form(rng, SCALE)
        small, large = sized(0.01), sized(1.0)
        assert small.keys() == large.keys()
        assert any(small[name] != large[name] for name in small)
        Truth({"law": 0.0}).having(large)


def test_sampling_of_cases() -> None:
    tasks = case_sampling.draw(np.random.SeedSequence(4), 200)
    assert len({task.name for task in tasks}) == len(tasks) == 200
    assert Counter(task.rig for task in tasks) == {"damper": 150, "frame": 50}
    labels = Counter(part for task in tasks if task.rig == "damper" for part in task.parts)
    assert set(causes.EFFECTS) <= set(labels)
    assert min(labels[name] for name in causes.EFFECTS) >= 4
    pairs = [task for task in tasks if len(task.parts) == 2]
    assert len(pairs) == 32
    assert {task.label for task in tasks if not task.parts} == {"none", "parameters"}
    outside = [task for task in tasks if task.outside]
    assert len(outside) == 21
    for rig, groups in (("damper", unknown.GROUPS), ("frame", frame_causes.GROUPS)):
        drawn = [task.label.removeprefix("~") for task in outside if task.rig == rig]
        first, second = (sum(name in group for name in drawn) for group in groups)
        assert first + second == len(drawn)
        assert abs(first - second) <= 1
    assert any(task.weak for task in tasks)
    assert case_sampling.draw(np.random.SeedSequence(4), 200) == tasks
    assert case_sampling.draw(np.random.SeedSequence(5), 200) != tasks


def test_pairs_are_of_different_stages() -> None:
    tasks = case_sampling.draw(np.random.SeedSequence(1), 600, "damper")
    for task in tasks:
        if len(task.parts) == 2:
            first, second = (causes.EFFECTS[part][0] for part in task.parts)
            assert first != second


def test_size_is_found() -> None:
    assert 0.4 * size_for(lambda s: 0.4 * s, 0.05) == pytest.approx(0.05, rel=0.16)
    assert 3 * size_for(lambda s: 3 * s**0.5, 0.2) ** 0.5 == pytest.approx(0.2, rel=0.16)
    assert size_for(lambda s: 0.01 * s, 0.2) == 1.0
    rng = np.random.default_rng(0)
    assert all(0.015 <= goal(rng, weak=True, noise=0.01) <= 0.03 for _ in range(50))
    assert all(0.05 <= goal(rng, weak=False, noise=0.01) <= 0.3 for _ in range(50))


# --- causes that show -------------------------------------------------------------------------------
def test_cause_must_show_beyond_the_noise() -> None:
    must_show({"heating": 0.0151, "asymmetry": 0.3}, 0.01)
    with pytest.raises(Faint, match="heating: opens a gap"):
        must_show({"heating": 0.0149, "asymmetry": 0.3}, 0.01)


def test_share_of_a_cause_in_company() -> None:
    """Two factors of the force: without one of them the error loses what that one adds to the other."""
    rng = np.random.default_rng(3)
    device = dampers.draw(rng)
    plain = Truth(device.numbers)
    test = next(t for t in excitation.damper_tests(rng, device.machine, long=False) if t.kind == "random")
    parts = {"sensor_gain": {"sensor.gain": 0.25}, "nothing": {"sat_form": 1.0, "sat_level": 1e9}}
    shares = damper_case.gaps_of_causes(plain, parts, [test])
    assert shares == pytest.approx({"sensor_gain": 0.25 / 1.25, "nothing": 0.0}, abs=1e-4)
    alone = damper_case.gaps_of_causes(plain, {"sensor_gain": {"sensor.gain": 0.25}}, [test])
    assert alone["sensor_gain"] == pytest.approx(0.2, abs=1e-4)
    late = damper_case.gaps_of_causes(plain, {"channel_shift": {"reading.shift": 0.01}}, [test])
    assert late["channel_shift"] > 0.01


def test_dropouts_that_hit_no_command_do_not_show() -> None:
    rng = np.random.default_rng(4)
    device = dampers.draw(rng, frame=True)
    storey = {"mass": 100.0, "stiffness": 4e5, "damping": 50.0}
    plain = Truth(device.numbers, {}, False, [storey] * 3)
    tests = excitation.frame_tests(rng, device.machine.command)
    parts = {"dropouts": {"command.dropouts": 1.0}}
    off, on = (next(t for t in tests if t.kind == kind) for kind in ("quake_off", "quake_on"))
    assert frame_case.gaps_of_causes(plain, parts, [off])["dropouts"] == pytest.approx(0.0, abs=1e-9)
    hit = next(
        replace(on, seed=k)
        for k in range(20)
        if (
            bench.driven(plain.having(parts["dropouts"]), on.fine(on.command), np.random.default_rng(k)) == 0
        ).mean()
        > 0.1
    )
    assert frame_case.gaps_of_causes(plain, parts, [hit])["dropouts"] > 0.02


def test_faint_case_is_drawn_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From another seed, as one that blows up is; in the end the last error stands."""
    seeds: list[tuple[int, ...]] = []

    def maker(task: Task, case: Path, tests: Path, seed: np.random.SeedSequence) -> dict[str, object]:
        seeds.append(seed.spawn_key)
        if len(seeds) < 3:
            raise (Faint, BlownUp)[len(seeds) - 1]("no")
        return {"label": task.label}

    monkeypatch.setattr(damper_case, "make", maker)
    task = Task("x", "damper", "heating")
    assert make_one(task, tmp_path, tmp_path, np.random.SeedSequence(1)) == {"label": "heating"}
    assert seeds == [(), (0,), (1,)]
    seeds.clear()
    monkeypatch.setattr(damper_case, "make", lambda *_: must_show({"heating": 0.0}, 0.01))
    with pytest.raises(Faint):
        make_one(task, tmp_path, tmp_path, np.random.SeedSequence(1))


def test_run_differs_by_its_seed_alone() -> None:
    machine = dampers.draw(np.random.default_rng(0)).machine
    tests = excitation.damper_tests(np.random.default_rng(1), machine, long=True)
    assert len({test.seed for test in tests}) == len(tests)
    assert tests[0].rng.random() == tests[0].rng.random()
    assert excitation.again(tests[0]).rng.random() != tests[0].rng.random()
    held_out = excitation.held_out_damper_tests(np.random.default_rng(1), machine, long=True)
    assert [test.duration for test in held_out.values()] == [10, 8, 8, 24]


def test_noise_is_as_stated() -> None:
    rng = np.random.default_rng(0)
    written = recorder.Noise(2.0, 0.9).onto(np.zeros(40_000), rng)
    assert np.std(written) == pytest.approx(2.0, rel=0.05)
    assert np.corrcoef(written[1:], written[:-1])[0, 1] == pytest.approx(0.9, abs=0.02)
    stepped = recorder.Noise(0.0, step=0.5).onto(np.array([0.2, 0.3, 1.1]), rng)
    assert list(stepped) == [0.0, 0.5, 1.0]


# --- apart -------------------------------------------------------------------------------------------
def fresh(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def test_rig_shares_no_code_with_the_plugin() -> None:
    names = sorted(path.stem for path in (STUDIES / "blindtest").glob("*_forms.py"))
    assert len(names) == 4
    names += "rig bench causes unknown frame_causes damper_case frame_case dampers case_sampling recorder make".split()
    imports = "; ".join(f"import studies.blindtest.{name}" for name in names)
    loaded = fresh(
        f"import sys; {imports}; print(*(m for m in sys.modules if m.startswith('mrdamp.')))"
    ).split()
    allowed = tuple(
        f"mrdamp.{name}"
        for name in (
            *("sets", "errors", "files", "interrupts", "library", "registration"),
        )
    )
    assert [m for m in loaded if not m.startswith(allowed)] == []
    source = (STUDIES / "blindtest" / "rig.c").read_text()
    assert {line for line in source.splitlines() if line.startswith("#include")} == {
        "#include <math.h>",
        "#include <string.h>",
    }
