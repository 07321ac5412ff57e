"""What the audit says of records: regimes beyond the baseline's, and processing."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, resample_poly, sosfilt, sosfiltfilt

from mrdamp.cli import main as mrdamp
from mrdamp.diagnosis.case.audit import processing
from mrdamp.diagnosis.case.coverage import beyond, within
from mrdamp.diagnosis.case.folder import Case, read_case
from mrdamp.diagnosis.run import diagnose
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record, read_record

DATA = Path(os.environ.get("MRDAMP_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


def sine(amplitude: float, frequency: float, command: float) -> Record:
    """Amplitude (m), frequency (Hz), constant command."""
    t = np.arange(4000) / 1000
    x = amplitude * np.sin(2 * np.pi * frequency * t)
    return Record("r", None, 1e-3, {"displacement_m": x, "command": np.full(len(t), command), "force_N": x})


BASELINE = (sine(0.005, 2.0, 0.0), sine(0.020, 1.0, 1.0))


@pytest.mark.parametrize(
    ("record", "told"),
    [
        (sine(0.010, 1.5, 0.5), ""),
        (sine(0.003, 3.0, 0.0), ""),
        (sine(0.002, 4.0, 0.5), "amplitude 2 mm (baseline 5 to 20)"),
        (sine(0.041, 0.5, 0.5), "amplitude 41 mm (baseline 5 to 20)"),
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
@pytest.mark.skipif(not (DATA / "utfsm").is_dir(), reason="no measured records of utfsm here")
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


@pytest.mark.skipif(not DATA.is_dir(), reason="needs the measured records of ../shared/data")
def test_no_processing_is_told_of_raw_channels() -> None:
    """The owners of these three rigs logged their channels as they are."""
    records = [read_record(p) for rig in ("utfsm", "utfpr", "nees") for p in (DATA / rig).glob("*/*.csv.gz")]
    assert len(records) > 60
    told = [processing(v) for r in records for k, v in r.channels.items() if k not in ("time_s", "command")]
    assert not any(told)
