"""What goes wrong in a diagnosis is told in a line; what is handed over loads in MuJoCo."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from frame_case import DT, believed, records
from mrdamp import cli
from mrdamp.commands import diagnosis as command
from mrdamp.diagnosis.case.audit import of_frame
from mrdamp.diagnosis.case.folder import read_case
from mrdamp.diagnosis.fits import table
from mrdamp.diagnosis.fits.final import AGREEMENT
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.report.handover import hand_over
from mrdamp.diagnosis.report.result import Diagnosis, Gap, Where
from mrdamp.diagnosis.run import diagnose
from mrdamp.model import Effect, Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.checks import check_frame_sign
from mrdamp.records.csv_file import render
from refusals import refuses

LAW = {"c0a": 700.0, "c0b": 800.0, "fya": 70.0, "fyb": 620.0, "v_ref": 0.03}
NONE = Limits(singles=0, forms=0, depth=1, polished=0)  # no effect is fitted


def bingham(x: Array, u: Array, dt: float, **changed: float) -> Array:
    """N, as the law's equation has it: dry friction of the field and a dashpot."""
    p = LAW | changed
    v = np.gradient(x, dt)
    return np.asarray((p["fya"] + p["fyb"] * u) * np.tanh(v / p["v_ref"]) + (p["c0a"] + p["c0b"] * u) * v)


def write(folder: Path, offset: float = 0.0, **changed: float) -> Path:
    """Three tests and a repeat, at constant and at changing commands."""
    folder.mkdir()
    rng, dt = np.random.default_rng(6), 0.002
    t: Array = np.linspace(0, 699 * dt, 700)
    tests = [
        (1.0, np.full(700, 0.2)),
        (2.2, np.full(700, 0.8)),
        (1.6, 0.5 + 0.4 * np.sin(9 * t)),
        (2.2, np.full(700, 0.8)),
    ]
    names = ["1_low.csv", "2_high.csv", "3_both.csv", "4_repeat.csv"]
    for name, (hz, u) in zip(names, tests, strict=True):
        x = 0.008 * np.sin(2 * np.pi * hz * t)
        force = bingham(x, u, dt, **changed) + offset + 3 * rng.standard_normal(700)
        columns: dict[str, Array] = {
            "time_s": t,
            "displacement_m": np.asarray(x),
            "command": u,
            "force_N": force,
        }
        (folder / name).write_text(render(columns))
    case: dict[str, Any] = {
        "name": "small", "format": 1, "rig": "damper", "sample_rate_hz": 500.0,
        "nominal": {"law": "bingham", "parameters": LAW},
        "channels": ["time_s", "displacement_m", "command", "force_N"], "records": names,
    }  # fmt: skip
    (folder / "case.json").write_text(json.dumps(case))
    return folder


def test_a_repeat_at_a_constant_command_belongs_to_the_test_with_that_command(tmp_path: Path) -> None:
    """Two tests with one motion at two commands: the repeat is of the one with its command."""
    folder = write(tmp_path / "case")
    low, high = (folder / name for name in ("1_low.csv", "2_high.csv"))
    t: Array = np.linspace(0, 1.398, 700)
    x = 0.008 * np.sin(2 * np.pi * 2.2 * t)
    force = bingham(x, np.full(700, 0.2), 0.002)
    low.write_text(
        render({"time_s": t, "displacement_m": np.asarray(x), "command": np.full(700, 0.2), "force_N": force})
    )
    assert high.is_file()
    assert [k for _, k in read_case(folder).repeats] == [1]


def test_a_parameter_at_the_end_of_its_range_is_told(tmp_path: Path) -> None:
    found = diagnose(read_case(write(tmp_path / "case", fyb=620.0 * 12)), limits=NONE)
    assert any(n.startswith("fyb is at a limit of its range") for n in found.notes), found.notes
    low, high = found.intervals["fyb"]
    assert high == pytest.approx(8 * 620.0)
    assert low <= high


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fyb", "c0b"])
def test_a_number_may_be_further_off_than_its_range(tmp_path: Path, name: str) -> None:
    """Where free numbers leave little else, those that stand at an end of their range go on."""
    found = diagnose(read_case(write(tmp_path / "case", **{name: 9 * LAW[name]})))
    assert found.verdict == "parameters"
    assert found.corrected.parameters[name] == pytest.approx(9 * LAW[name], rel=0.05)


def test_a_fit_that_fails_is_told_and_the_others_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(problem: Problem, hypothesis: Hypothesis, *a: Any, **more: Any) -> Fit:
        if "trapped_gas" in hypothesis.causes:
            raise np.linalg.LinAlgError("singular matrix")
        return fit(problem, hypothesis, *a, **more)

    monkeypatch.setattr(table, "fit", fails)
    found = diagnose(
        read_case(write(tmp_path / "case", offset=60.0)), limits=Limits(singles=20, forms=1, depth=1)
    )
    failed = [n for n in found.notes if "failed" in n]
    assert failed
    for note in failed:
        assert note.startswith("trapped_gas")
        assert note.endswith("the fit failed (singular matrix)")
    assert found.gap.corrected < 0.2 * found.gap.nominal


def test_an_interrupt_is_one_line_and_leaves_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop(what: str, share: float) -> None:
        if share >= 0.05:
            raise KeyboardInterrupt

    monkeypatch.setattr(command, "show_progress", stop)
    out = tmp_path / "out"
    assert cli.main(["diagnose", str(write(tmp_path / "case")), "-o", str(out), "--jobs", "1"]) == 130
    assert capsys.readouterr().err == "mrdamp: interrupted; run the same command again\n"
    assert list(out.iterdir()) == []


BOUC_WEN = {
    "c0a": 760.0, "c0b": 890.0, "alpha_a": 21e3, "alpha_b": 119e3, "gamma": 1.1e6, "beta": 1.1e6, "A": 155.0,
    "n": 2.0, "k0": 240.0, "x0": 0.0,
}  # fmt: skip


def damper_record() -> Record:
    """A random motion and a stepped command; the force is none of the simulator's."""
    t: Array = np.linspace(0, 1499 * DT, 1500)
    rng = np.random.default_rng(2)
    rows = zip((0.7, 1.9, 4.1), rng.uniform(0, 6, 3), strict=True)
    x = np.sum([0.004 / f * np.sin(2 * np.pi * f * t + p) for f, p in rows], axis=0)
    command = np.where(np.floor(t / 0.35) % 2 < 1, 0.1, 0.9)
    force = 24000 * np.gradient(x, DT) * (0.3 + command)
    return Record(
        "random", None, DT, {"time_s": t, "displacement_m": x, "command": command, "force_N": force}
    )


def diagnosis(model: Model) -> Diagnosis:
    gap = Gap(0.2, 0.1, 0.01, 0.005, (0.009, 0.011))
    return Diagnosis("x", model.rig, "either", "parameters", (), (), (), Where({}), gap, (), {}, model)


def test_what_is_handed_over_is_a_model_that_loads(tmp_path: Path) -> None:
    model = Model("bouc_wen", BOUC_WEN, (Effect("driver_lag", {"tau": 0.02}),))
    still = Record("still", None, DT, {**damper_record().channels, "command": np.zeros(1500)})
    found = hand_over(diagnosis(model), [still, damper_record()], tmp_path / "mjcf")
    assert [row["record"] for row in found.stepped] == ["random", "still"]  # the changing command first
    assert all(abs(row["mujoco_gap"] - row["offline_gap"]) < AGREEMENT for row in found.stepped)
    assert found.to_dict()["mujoco"] == list(found.stepped)
    m = mujoco.MjModel.from_xml_path(str(tmp_path / "mjcf" / "scene.xml"))
    data = mujoco.MjData(m)
    mujoco.mj_step(m, data, 10)
    assert np.isfinite(data.sensordata).all()
    assert "driver_lag_tau" in (tmp_path / "mjcf" / "model.xml").read_text()
    assert Model.read(tmp_path / "mjcf" / "model.json").effects == model.effects


def test_frame_records_that_are_not_as_they_should_be_are_told_of() -> None:
    """SciPy's records of a frame from rest: as they are, cut in motion, with the ground's motion in the displacement,
    with relative accelerations, and with the force turned round."""
    sound = records()["steps"]
    ground = np.asarray(sound.channel("ground_acceleration_m_s2"))
    shaken = cumulative_trapezoid(cumulative_trapezoid(ground, dx=DT, initial=0), dx=DT, initial=0)
    floors = [f"floor{j}" for j in (1, 2, 3)]
    absolute = {f"{f}_displacement_m": sound.channel(f"{f}_displacement_m") + shaken for f in floors}
    relative = {f"{f}_acceleration_m_s2": sound.channel(f"{f}_acceleration_m_s2") - ground for f in floors}
    told = [list(of_frame([r])) for r in (sound, sound.part(1.0, 2.4))]
    assert told[0] == []
    assert len(told[1]) == 1
    assert "begins in motion" in told[1][0]
    for changed in (absolute, relative):
        found = list(of_frame([sound.with_channels(changed)]))
        assert [line.split(": ")[1] for line in found] == floors
        assert all("do not belong together" in line for line in found)
    check_frame_sign(sound, (0, 1))
    turned = sound.with_channels({"force_N": -np.asarray(sound.channel("force_N"))})
    refuses(lambda: check_frame_sign(turned, (0, 1)), "steps: force_N: the damper would drive the rig")


def test_channels_that_a_case_leaves_out_are_told_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    both = records()
    for name in ("off", "steps"):
        above = {"floor4_acceleration_m_s2": both[name].channel("floor3_acceleration_m_s2")}
        kept = {k: v for k, v in both[name].channels.items() if name == "steps" or k != "floor2_displacement_m"}
        Record(name, None, DT, {**kept, **above}).save(tmp_path / f"{name}.csv")
    believed().write(tmp_path / "frame.json")
    call = ["case", "frame.json", "off.csv", "steps.csv", "-o", "made"]
    assert cli.main([str(tmp_path / word) if "." in word or word == "made" else word for word in call]) == 0
    said = [line for line in capsys.readouterr().out.splitlines() if line.endswith("left out")]
    assert said == [
        "check: floor2_displacement_m: not in all records; left out",
        "check: floor4_acceleration_m_s2: the model has 3 storeys; left out",
    ]
