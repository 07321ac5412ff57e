"""What the pictures take from a series: its period, its outline, names that fit."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.pictures import series, style

LONG = "a_record_with_a_name_that_goes_on_and_on_for_no_reason_at_all_2.5Hz_10.0mm"
TIME = np.arange(0.0, 4.0, 0.002)


def test_mean_period_of_a_noisy_sine() -> None:
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(TIME))
    assert series.mean_period(TIME, np.sin(2 * np.pi * 2.5 * TIME) + noise + 3) == pytest.approx(0.4, rel=0.1)
    assert series.mean_period(TIME, np.zeros_like(TIME)) == pytest.approx(TIME[-1])


def test_outline_keeps_every_peak() -> None:
    values = np.random.default_rng(2).standard_normal(10_007)
    time, kept = series.outline(np.arange(10_007.0), values, 100)
    assert len(kept) <= 204
    assert (np.diff(time) > 0).all()
    np.testing.assert_array_equal(values[time.astype(int)], kept)
    assert (kept.min(), kept.max()) == (values.min(), values.max())
    same = series.outline(TIME, TIME, len(TIME))
    np.testing.assert_array_equal(same[1], TIME)


def test_elide_keeps_both_ends() -> None:
    short = style.elide(LONG, 120, 9)
    assert style.text_width(short, 9) <= 120
    assert short.startswith("a_rec")
    assert short.endswith("0mm")
    assert "…" in short
    assert style.elide("two\nlines", 300) == "two lines"
