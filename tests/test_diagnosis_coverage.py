"""Which records leave the regimes of a baseline; sines whose amplitude and speed are known."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.diagnosis.case.coverage import beyond
from mrdamp.records import Record


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
