"""What the audit of records says of processing, against SciPy's own filters and a measured rig."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import butter, resample_poly, sosfilt, sosfiltfilt

from mrdamp.diagnosis.case.audit import processing
from mrdamp.model.core import Array
from mrdamp.records import read_record
from test_natural_gaps import DATA

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
