"""The delay of a displacement by the accelerometer: analytic motions, and measured ones that are shifted."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from mrdamp.diagnosis.channels.motion import motion
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Term
from mrdamp.model.core import Array
from mrdamp.records import Record, read_record

DATA = Path(os.environ.get("MRDAMP_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
LATE = Term(
    "channel_shift", "sensor", (Coordinate("channel_shift_d", 0.0, -0.05, 0.05, 1e-3),), ((0.002,), (-0.002,))
)


def record(
    late: float, *, to: float = 20.0, gain: float = 1.0, high_pass: float = 0.0, seed: int = 1
) -> Record:
    """Random motion from 1 Hz on, the displacement late (s), an accelerometer with a gain and a high pass (Hz)."""
    n, dt = 16000, 1e-3
    rng = np.random.default_rng(seed)
    f = np.fft.rfftfreq(n, dt)
    w = 2 * np.pi * np.maximum(f, 1e-9)
    moved = np.where((f >= 1) & (f <= to), np.exp(2j * np.pi * rng.random(len(f))), 0) / w
    x = np.fft.irfft(moved * np.exp(-1j * w * late), n)
    a = np.fft.irfft(-gain * w**2 * moved / (1 - 1j * 2 * np.pi * high_pass / w), n)
    noise = [0.002 * np.std(y) * rng.standard_normal(n) for y in (x, a)]
    return Record("r", None, dt, {"displacement_m": x + noise[0], "acceleration_m_s2": a + noise[1]})


@pytest.mark.parametrize("late", [0.003, -0.0015])
def test_a_late_displacement_is_seen_beside_the_accelerometers_gain_and_high_pass(late: float) -> None:
    (found,) = motion([record(late), record(late, gain=1.07, high_pass=0.05, seed=2)], [LATE], {})
    assert found.cause == "channel_shift"
    assert found.settings is not None
    assert found.settings["channel_shift_d"] == pytest.approx(late, rel=0.03)
    assert found.nats > 10
    known = motion([record(late)], [LATE], {"channel_shift_d": late})
    assert [c.cause for c in known] == [None]  # the simulator has it


def test_channels_in_step_and_single_frequencies_tell_nothing() -> None:
    assert motion([record(0.0)], [LATE], {})[0].agree
    assert motion([record(0.003, to=1.2)], [LATE], {}) == []
    plain = record(0.003)
    without = Record("r", None, 1e-3, {k: v for k, v in plain.channels.items() if k != "acceleration_m_s2"})
    assert motion([plain, without], [LATE], {}) == []


@pytest.mark.skipif(not (DATA / "nees").is_dir(), reason="no measured records with an accelerometer here")
def test_a_measured_displacement_that_is_made_later_is_found_so_much_later() -> None:
    measured = [read_record(f) for f in sorted((DATA / "nees" / "train").glob("*.csv*"))[:2]]

    def later(r: Record, by: float) -> Record:
        x: Array = np.interp(r.time - by, r.time, r.displacement)
        return r.with_channels({"displacement_m": x})

    delays = []
    for by in (0.0, 0.004):
        (found,) = motion([later(r, by) for r in measured], [LATE], {})
        assert found.settings is not None
        delays.append(found.settings["channel_shift_d"])
    assert delays[1] - delays[0] == pytest.approx(0.004, rel=0.02)
