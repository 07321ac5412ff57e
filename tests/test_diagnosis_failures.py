"""What goes wrong in a diagnosis, what the audit says of records, and what is handed over."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, resample_poly, sosfilt, sosfiltfilt

from bingham_rig import LAW, force, write_case
from frame_case import DT, believed, records
from modules import DATA, needs
from mrdamp import cli
from mrdamp.cli import main as mrdamp
from mrdamp.diagnosis.case.audit import of_frame, processing, repeated_share
from mrdamp.diagnosis.case.coverage import beyond, within
from mrdamp.diagnosis.case.folder import Case, read_case
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
from mrdamp.records import Record, read_record
from mrdamp.records.checks import check_frame_sign
from refusals import refuses

NONE = Limits(singles=0, forms=0, depth=1, polished=0)  # no effect is fitted


def write(folder: Path, offset: float = 0.0, low_hz: float = 1.0, **changed: float) -> Path:
    rng, t = np.random.default_rng(6), np.linspace(0, 1.398, 700)
    rows: dict[str, tuple[float, Array]] = {
        "1_low": (low_hz, np.full(700, 0.2)),
        "2_high": (2.2, np.full(700, 0.8)),
        "3_both": (1.6, 0.5 + 0.4 * np.sin(9 * t)),
        "4_repeat": (2.2, np.full(700, 0.8)),
    }
    tests = {}
    for name, (hz, u) in rows.items():
        x = 0.008 * np.sin(2 * np.pi * hz * t)
        read = force(np.gradient(x, DT), u, **changed) + offset + 3 * rng.standard_normal(700)
        tests[name] = {"time_s": t, "displacement_m": x, "command": u, "force_N": read}
    return write_case(folder, tests)


def test_a_repeat_at_a_constant_command_belongs_to_the_test_with_that_command(tmp_path: Path) -> None:
    assert [k for _, k in read_case(write(tmp_path / "case", low_hz=2.2)).repeats] == [1]


def test_a_parameter_at_the_end_of_its_range_is_told(tmp_path: Path) -> None:
    found = diagnose(read_case(write(tmp_path / "case", fyb=620.0 * 12)), limits=NONE)
    assert any(n.startswith("fyb is at a limit of its range") for n in found.notes), found.notes
    low, high = found.intervals["fyb"]
    assert high == pytest.approx(8 * 620.0)
    assert low <= high


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fyb", "c0b"])
def test_a_number_may_be_further_off_than_its_range(tmp_path: Path, name: str) -> None:
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


def test_what_is_handed_over_is_a_model_that_loads(tmp_path: Path) -> None:
    model = Model("bingham", LAW, (Effect("driver_lag", {"tau": 0.02}),))
    gap = Gap(0.2, 0.1, 0.01, 0.005, (0.009, 0.011), left_out=0.01)
    found = Diagnosis("x", "damper", "either", "parameters", (), (), (), Where({}), gap, (), {}, model)
    steady, _, changing = read_case(write(tmp_path / "case")).records
    found = hand_over(found, [steady, changing], tmp_path / "mjcf")
    assert [row["record"] for row in found.stepped] == ["3_both", "1_low"]  # the changing command first
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
    bare = {k: v for k, v in sound.channels.items() if not k.endswith("displacement_m")}
    felt = Record("felt", None, DT, bare)  # by accelerations alone; at .1 s a sixth of their later size
    assert [len(list(of_frame([r]))) for r in (felt, felt.part(0.1, 2.4), felt.part(1.0, 2.4))] == [0, 1, 1]
    for changed in (absolute, relative):
        found = list(of_frame([sound.with_channels(changed)]))
        assert [line.split(": ")[1] for line in found] == floors
        assert all("do not belong together" in line for line in found)
    check_frame_sign(sound, (0, 1))
    turned = sound.with_channels({"force_N": -np.asarray(sound.channel("force_N"))})
    refuses(lambda: check_frame_sign(turned, (0, 1)), "steps: force_N: the damper would drive the rig")


@pytest.mark.parametrize(
    ("channel", "change", "told"),
    [
        ("force_N", lambda x, _: -x, "mrdamp: {out}: force_N has the sign opposite to the simulator's"),
        ("floor2_acceleration_m_s2", lambda x, _: -x, "mrdamp: {out}: floor2_acceleration_m_s2 has the sign opposite"),
        ("floor2_acceleration_m_s2", lambda x, _: 1e3 * x, "mrdamp: {out}: floor2_acceleration_m_s2 is .* times that"),
        ("floor2_acceleration_m_s2", lambda x, _: 9.81 * x, "check: floor2_.* times .* simulator: check its unit"),
        ("floor2_acceleration_m_s2", lambda x, ground: x - ground, "^check: floor2_.* relative to the table: .*\n/"),
        ("ground_acceleration_m_s2", lambda x, _: x / 9.81, "check: floor3_.* simulator: check the ground's unit"),
        ("ground_acceleration_m_s2", lambda x, _: 0 * x, "the simulator's .* is 0 with the inputs of the records"),
    ],
)
def test_a_frames_channels_are_held_against_its_simulator(
    channel: str, change: Callable[[Array, Array], Array], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = {k: v for k, v in records()["steps"].channels.items() if not k.endswith("displacement_m")}
    changed = change(kept[channel], kept["ground_acceleration_m_s2"])
    Record("steps", None, DT, kept | {channel: changed}).save(tmp_path / "steps.csv")
    believed().write(tmp_path / "frame.json")
    out = tmp_path / "case"
    failed = cli.main(["case", str(tmp_path / "frame.json"), str(tmp_path / "steps.csv"), "-o", str(out)])
    said = "".join(capsys.readouterr())
    assert re.search(told.format(out=re.escape(str(out))), said)
    assert out.exists() == (failed == 0) == ("check" in told)


def sine(amplitude: float, frequency: float, command: float) -> Record:
    t = np.arange(4000) / 1000
    x = amplitude * np.sin(2 * np.pi * frequency * t)
    return Record("r", None, 1e-3, {"displacement_m": x, "command": np.full(len(t), command), "force_N": x})


BASELINE = (sine(0.005, 2.0, 0.0), sine(0.020, 1.0, 1.0))


@pytest.mark.parametrize(
    ("record", "told"),
    [
        (sine(0.010, 1.5, 0.5), ""),
        (sine(0.002, 4.0, 0.5), "amplitude 2 mm (baseline 5 to 20)"),
        # RMS speeds: 44.4 and 88.9 mm/s of the baseline, 11.1 and 200 of these.
        (sine(0.010, 0.25, 0.5), "RMS speed 11.1 mm/s (baseline 44.4 to 88.9)"),
        (sine(0.015, 3.0, 0.5), "RMS speed 200 mm/s (baseline 44.4 to 88.9)"),
        (sine(0.010, 1.5, 2.1), "command 2.1 (baseline 0 to 1)"),
    ],
)
def test_a_record_is_beyond_from_twice_the_range_on(record: Record, told: str) -> None:
    assert beyond(record, BASELINE) == told


def test_records_beyond_are_left_out_with_their_repeats_unless_all_are() -> None:
    model = Model("bingham", {"c0a": 1.0, "c0b": 0.0, "fya": 1.0, "fyb": 0.0, "v_ref": 0.01})
    inside, outside = sine(0.010, 1.5, 0.5), sine(0.002, 4.0, 0.5)
    far = Record("far", None, 1e-3, dict(outside.channels))
    near = Record("near", None, 1e-3, dict(inside.channels))
    repeats = ((far, 0), (near, 1), (near, None))
    case = Case("c", Path(), model, (far, near), repeats, BASELINE)
    left, how = within(case)
    assert left.records == (near,)
    assert left.repeats == ((near, 0), (near, None))
    assert how == {"far": "amplitude 2 mm (baseline 5 to 20)"}
    alone = Case("c", Path(), model, (far,), (), BASELINE)
    assert within(alone) == (alone, how)
    assert within(Case("c", Path(), model, (far,), ()))[1] == {}


@pytest.mark.slow
@needs(DATA / "utfsm")
def test_no_change_is_named_in_a_sweep_of_an_unchanged_rig_beyond_its_baseline(tmp_path: Path) -> None:
    """Sines of 5 to 25 mm are the baseline, the sweep has 2 mm: a seal friction of 183 N was told."""
    sines = sorted((DATA / "utfsm" / "train").glob("*"))
    (sweep,) = (DATA / "utfsm" / "validation").glob("chirp*")
    fit = ["--law", "bouc_wen", "--dependence", "quadratic", "--extras", "offset", "-o", tmp_path / "m"]
    for run in (
        ["identify", *sines, *fit],
        ["case", tmp_path / "m", sweep, "--baseline", *sines, "-o", tmp_path / "case"],
    ):
        assert mrdamp([str(word) for word in run]) == 0
    answer = diagnose(read_case(tmp_path / "case"))
    assert (answer.verdict, answer.effects) == ("unknown", ())
    assert "leave the regimes of the baseline (amplitude 2.01 mm" in answer.sentence
    assert answer.gap.corrected == pytest.approx(answer.gap.nominal)


FS = 500.0


def low_pass(cutoff_hz: float, filtered: Callable[..., Array] = sosfiltfilt) -> Callable[[Array], Array]:
    return lambda x: filtered(butter(4, cutoff_hz, fs=FS, output="sos"), x)


@pytest.mark.parametrize(
    ("process", "told"),
    [
        (lambda x: x, None),
        (lambda x: np.round(x, 2), None),
        (lambda x: np.convolve(x, np.ones(5) / 5, "same"), "is a moving average over 5 samples"),
        (lambda x: np.convolve(x, np.ones(12) / 12, "same"), "is a moving average over 12 samples"),
        (low_pass(60), "is low-pass filtered or resampled"),
        (low_pass(60, sosfilt), "is low-pass filtered or resampled"),
        (lambda x: resample_poly(x[::2], 2, 1), "is low-pass filtered or resampled"),
        (lambda x: x[:200], None),
    ],
    ids=["raw", "rounded", "mean of 5", "mean of 12", "zero phase", "causal", "resampled", "short"],
)
def test_processing_is_told_by_its_spectrum(process: Callable[[Array], Array], told: str | None) -> None:
    """A force with steps at the turns, and white noise of .5 %."""
    t = np.arange(6000) / FS
    clean = np.sin(2 * np.pi * 2 * t) + 0.3 * np.sign(np.sin(2 * np.pi * 1.3 * t))
    noise = 0.005 * np.random.default_rng(0).standard_normal(len(t))
    assert processing(process(clean + noise)) == told


@needs(DATA)
def test_no_processing_is_told_of_raw_channels() -> None:
    """The owners of these three rigs logged their channels as they are."""
    records = [read_record(p) for rig in ("utfsm", "utfpr", "nees") for p in (DATA / rig).glob("*/*.csv.gz")]
    assert len(records) > 60
    told = [processing(v) for r in records for k, v in r.channels.items() if k not in ("time_s", "command")]
    assert not any(told)


def test_rest_before_and_after_a_motion_is_no_repeated_sample() -> None:
    rest, motion = np.zeros(50), np.array([1.0, 1.0, 2.0, 3.0, 3.0, 4.0])
    assert repeated_share(np.concatenate([rest, motion, rest])) == pytest.approx(2 / 7)  # of 7 steps from rest to rest
