"""Cases of the blind test: their files, what they are made of, and that the diagnosis knows nothing of them."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from modules import STUDIES, WITHOUT_PHYSICS, package_modules
from mrdamp.model import Model, core, damper_effects
from mrdamp.records import read_record
from studies.blindtest import (
    case_sampling,
    causes,
    commissioning,
    frame_causes,
    misfit_case,
    run,
    score,
    unknown,
)
from studies.blindtest.make import make_one
from studies.blindtest.rig import Array
from studies.blindtest.sizing import OWN, Task, relative

Made = tuple[Path, Path, dict[str, Any]]


def made(folder: Path, rig: str, label: str, seed: int, *, misfit: bool = False) -> Made:
    """Case folder, file of its tests, label."""
    task = Task("case_001", rig, label, misfit=misfit)
    told = make_one(task, folder / "cases", folder / "tests", np.random.SeedSequence(seed))
    return folder / "cases" / "case_001", folder / "tests" / "case_001.npz", told


def each_test(path: Path) -> list[dict[str, Array]]:
    arrays, tests = np.load(path), dict[str, dict[str, Array]]()
    for key in arrays.files:
        test, channel = key.split("/")
        tests.setdefault(test, {})[channel] = arrays[key].astype(float)
    return list(tests.values())


# --- one case of the simulator's law -------------------------------------------------------------------
@pytest.mark.slow
def test_damper_case_without_a_gap(tmp_path: Path) -> None:
    case, tests, label = made(tmp_path, "damper", "none", 3)
    model, told = Model.read(case), json.loads((case / "case.json").read_text())
    assert label["gap"] == pytest.approx(0.0, abs=1e-6)
    for channels in each_test(tests):  # the plugin agrees with the rig
        assert relative(model.simulate(0.002, channels)["force_N"], channels["nominal_N"]) < 0.01
        assert relative(channels["nominal_N"], channels["force_N"]) < 1e-6
    first, again = (
        read_record(case / next(name for name in reversed(told["records"]) if kind in name))
        for kind in ("sine_random", "repeat")
    )
    assert again.command == pytest.approx(first.command)
    difference = again.channel("force_N") - first.channel("force_N")
    size = float(np.sqrt(np.mean(first.channel("force_N") ** 2)))
    assert np.std(difference) / np.sqrt(2) / size == pytest.approx(label["noise"], rel=0.6)


@pytest.mark.slow
def test_frame_case(tmp_path: Path) -> None:
    case, tests, label = made(tmp_path, "frame", "storey_stiffness@2", 2)
    model = Model.read(case)
    assert label["stages"] == ["structure"]
    assert 0.02 < label["gap"] < 0.8
    for channels in each_test(tests):
        inputs = {name: channels[name] for name in ("ground_acceleration_m_s2", "command")}
        simulated = model.simulate(0.002, inputs)
        for floor in (1, 2, 3):
            nominal = channels[f"nominal_floor{floor}_acceleration"]
            assert relative(simulated[f"floor{floor}_acceleration_m_s2"], nominal) < 0.05
            assert relative(nominal, channels[f"floor{floor}_acceleration_m_s2"]) > 0.01
    told = json.loads((case / "case.json").read_text())
    ground = [read_record(case / name).channel("ground_acceleration_m_s2") for name in told["records"][-2:]]
    assert np.array_equal(ground[0], ground[1])


@pytest.mark.slow
def test_wrong_numbers_are_wrong_and_the_form_is_right(tmp_path: Path) -> None:
    case, tests, label = made(tmp_path, "damper", "parameters", 5)
    nominal, true = Model.read(case), label["true_parameters"]
    wrong = [name for name, value in true.items() if nominal.parameters[name] != value]
    assert 3 <= len(wrong) < len(true)
    for channels in each_test(tests):
        for parameters, low, high in ((nominal.parameters, 0.02, 1.0), (true, 0.0, 0.01)):
            # The rig begins every motion at rest: no run-in.
            x, u = channels["displacement_m"], channels["command"]
            force = core.run(nominal.law, parameters, 0.002, x, u=u)["force"]
            assert low < relative(force, channels["force_N"]) < high


# --- one case of another law ----------------------------------------------------------------------------
@pytest.fixture(scope="module")
def gained(tmp_path_factory: pytest.TempPathFactory) -> Made:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(misfit_case, "BASELINE", 1.0)  # every case has records of the rig before the cause
        return made(tmp_path_factory.mktemp("gained"), "damper", "sensor_gain", 1, misfit=True)


@pytest.fixture(scope="module")
def control(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return made(tmp_path_factory.mktemp("control"), "damper", OWN, 2, misfit=True)


@pytest.fixture(scope="module")
def framed(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return made(tmp_path_factory.mktemp("framed"), "frame", "floor_mass@2", 3, misfit=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gained", "control", "framed"])
def test_simulator_leaves_three_to_fifteen_percent(name: str, request: pytest.FixtureRequest) -> None:
    """Without the cause; what the label calls its base is the same in the shared scorer's terms."""
    case, tests, label = request.getfixturevalue(name)
    counted = len(each_test(tests)) * (3 if label["rig"] == "frame" else 1)
    assert commissioning.MISFIT[0] <= label["misfit"] <= commissioning.MISFIT[1]
    assert label["base"] == pytest.approx(label["misfit"] * np.sqrt(counted), rel=1e-9)
    model = Model.read(case)
    before, after = score.gaps(tests, lambda inputs: run.predicted(model, inputs))
    assert [after, label["gap"]] == pytest.approx([before, before], rel=1e-3)  # the nominal simulator's
    assert label["gap"] == label["base"] if name == "control" else label["gap"] > 1.05 * label["base"]


@pytest.mark.slow
def test_effect_is_in_the_records_and_not_in_the_baseline(gained: Made) -> None:
    """A gain of one force channel: its ratio to the load cell of the same record."""
    case, _, label = gained
    told = json.loads((case / "case.json").read_text())
    assert {path.name for path in case.glob("*.csv.gz")} == {*told["baseline"], *told["records"]}
    wanted = label["size"]["sensor.gain"]
    assert abs(wanted) > 0.02
    for name in (*told["baseline"], *told["records"]):
        record = read_record(case / name)
        own, cell = (record.channel(c)[100:] for c in ("force_N", "reference_force_N"))
        gain = float(own @ cell / (cell @ cell)) - 1
        assert gain == pytest.approx(0.0 if name in told["baseline"] else wanted, rel=0.2, abs=0.01)


# --- what there is to draw ------------------------------------------------------------------------------


def test_sampling_of_cases() -> None:
    """A quarter frames; every effect of the catalogue; pairs of different stages; both groups of unknown causes."""
    assert set(causes.EFFECTS) <= set(damper_effects())
    tasks = case_sampling.draw(np.random.SeedSequence(4), 200)
    assert len({task.name for task in tasks}) == len(tasks) == 200
    assert Counter(task.rig for task in tasks) == {"damper": 150, "frame": 50}
    labels = Counter(part for task in tasks if task.rig == "damper" for part in task.parts)
    assert min(labels[name] for name in causes.EFFECTS) >= 4
    pairs = [task.parts for task in tasks if len(task.parts) == 2]
    assert len(pairs) == 32
    assert all(
        causes.EFFECTS[a][0] != causes.EFFECTS[b][0] for a, b in pairs if {a, b} <= causes.EFFECTS.keys()
    )
    assert {task.label for task in tasks if not task.parts} == {"none", "parameters"}
    for rig, groups in (("damper", unknown.GROUPS), ("frame", frame_causes.GROUPS)):
        drawn = [task.label.removeprefix("~") for task in tasks if task.outside and task.rig == rig]
        first, second = (sum(name in group for name in drawn) for group in groups)
        assert first + second == len(drawn)
        assert abs(first - second) <= 1
    assert case_sampling.draw(np.random.SeedSequence(4), 200) == tasks
    assert case_sampling.draw(np.random.SeedSequence(5), 200) != tasks


# --- apart -------------------------------------------------------------------------------------------
def test_rig_shares_no_code_with_the_plugin() -> None:
    names = sorted(path.stem for path in (STUDIES / "blindtest").glob("*_forms.py"))
    names += "rig bench causes unknown frame_causes damper_case frame_case dampers case_sampling recorder make".split()
    used = package_modules("; ".join(f"import studies.blindtest.{name}" for name in names))
    assert [name for name in used if not name.startswith(("sets", *WITHOUT_PHYSICS))] == []
    source = (STUDIES / "blindtest" / "rig.c").read_text()
    included = {line for line in source.splitlines() if line.startswith("#include")}
    assert included == {"#include <math.h>", "#include <string.h>"}
