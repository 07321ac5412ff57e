"""Bootstrap intervals: right size, the same for any number of workers, and a word where records show nothing."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.errors import InputError
from mrdamp.identify import Fit, identify
from mrdamp.identify.intervals import channel_findings, intervals
from mrdamp.records import Record
from sine_records import bingham_record, grid, straight, viscous


@pytest.fixture(scope="module")
def fitted() -> tuple[Fit, list[Record]]:
    train = grid(straight)
    return identify("bingham", train, starts=1), train


def test_intervals_hold_the_truth_and_shrink_with_the_noise(fitted: tuple[Fit, list[Record]]) -> None:
    rows = {row.name: row for row in intervals(*fitted, seed=1)}
    for name, true in {"c0a": 400.0, "c0b": 250.0, "fya": 40.0, "fyb": 300.0, "gas_spring_f0": 12.0}.items():
        row = rows[name]
        width = row.high - row.low
        assert row.low - 0.5 * width < true < row.high + 0.5 * width, row
        assert row.low <= row.value <= row.high
        assert not row.word
    assert rows["fya"].unit == "N"
    # 8000 samples with 2 N of noise: the mean is known to about 2 / sqrt(8000) N.
    offset = rows["gas_spring_f0"]
    assert 0.3 < (offset.high - offset.low) / (2 * 1.96 * 2 / np.sqrt(8000)) < 2.5


@pytest.mark.slow
def test_a_fit_of_each_resample_agrees_with_one_step_and_any_number_of_workers(
    fitted: tuple[Fit, list[Record]],
) -> None:
    one, two = (intervals(*fitted, resamples=24, refit=True, seed=3, block=0.5, workers=n) for n in (1, 2))
    assert one == two
    quick = intervals(*fitted, resamples=24, seed=3, block=0.5)
    for a, b in zip(one, quick, strict=True):
        assert a.name == b.name
        assert b.high - b.low == pytest.approx(a.high - a.low, rel=0.25)


def test_what_the_records_do_not_show_gets_a_word() -> None:
    # At one velocity amplitude far above v_ref and a square-like motion, viscous and dry friction are one number.
    t = 0.002 * np.arange(1000)
    v = 0.05 * np.tanh(40 * np.sin(2 * np.pi * 2 * t))
    x = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2) * 0.002])
    force = 400.0 * v + 100.0 * np.tanh(v / 0.01) + np.random.default_rng(0).normal(0, 2.0, len(t))
    channels = {"displacement_m": x, "velocity_m_s": v, "command": 0 * t, "force_N": force}
    train = [Record("square", None, 0.002, channels)]
    words = {row.name: row.word for row in intervals(identify("bingham", train, starts=1), train)}
    assert "only together with" in words["c0a"]
    assert "only together with" in words["fya"]


def test_offset_and_delay_left_in_a_record_are_found(fitted: tuple[Fit, list[Record]]) -> None:
    fit, _ = fitted
    shown = bingham_record("late", 0.004, 2.0, 0.4, viscous, straight, 77)
    force = np.roll(shown.channel("force_N"), 1) + 5.0  # one sample late, 5 N more
    late = shown.with_channels({"force_N": force}).part(0.1, 1.9)
    left = channel_findings(fit, [late, shown])
    assert left[0].delay == pytest.approx(0.002, rel=0.15)
    assert left[0].offset == pytest.approx(5.0, abs=0.6)
    assert abs(left[1].delay) < 0.0002
    assert abs(left[1].offset) < 0.6


def test_bad_requests_are_told(fitted: tuple[Fit, list[Record]]) -> None:
    fit, train = fitted
    with pytest.raises(InputError, match="too few"):
        intervals(fit, train[:3], block=100.0)
    with pytest.raises(InputError, match="no search space"):
        intervals(Fit(fit.model, (), (), 1, 1), train)
