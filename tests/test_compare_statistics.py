"""Means, worst cases and intervals of a comparison against figures by hand and normal theory."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mrdamp.compare.comparison import difference, interval, summarise
from refusals import refuses


def test_intervals_are_those_of_the_normal_theory() -> None:
    rng = np.random.default_rng(3)
    motions = rng.normal(0.5, 0.1, 200)
    values = np.repeat(motions[None, :, None], 3, axis=2)
    low, high = interval(values)
    half = 1.96 * motions.std() / math.sqrt(200)  # the amplitudes of a motion are one draw
    assert (high - low) / 2 == pytest.approx(half, rel=0.08)
    assert (high + low) / 2 == pytest.approx(motions.mean(), abs=0.1 * half)
    seeds = rng.normal(0.0, 0.1, 60)
    low, high = interval(seeds[:, None, None] + np.zeros((1, 5, 1)))
    assert (high - low) / 2 == pytest.approx(1.96 * seeds.std() / math.sqrt(60), rel=0.1)


def test_mean_and_worst() -> None:
    values = np.array([[[0.2, 0.6], [0.4, 1.0]]])
    s = summarise(values)
    assert s.mean == pytest.approx(0.55)
    assert s.worst == 1.0
    assert 0.4 <= s.low < s.mean < s.high <= 0.7
    assert np.isnan(interval(values[:, :1])).all()
    refuses(lambda: summarise(np.ones(3)), "shape")


def test_a_shift_that_is_the_same_everywhere_is_certain() -> None:
    rng = np.random.default_rng(0)
    other = rng.uniform(0.2, 1.0, (1, 6, 3))
    seeds = np.repeat(other, 4, axis=0) - 0.05
    s = difference(seeds, other)
    assert s.low == pytest.approx(-0.05)
    assert s.high == pytest.approx(-0.05)
    assert summarise(seeds).high - summarise(seeds).low > 0.1
    refuses(lambda: difference(seeds[:, :5], seeds), "cannot be paired")


def test_seeds_of_two_trainings_are_drawn_apart_and_motions_together() -> None:
    rng = np.random.default_rng(1)
    motions = rng.uniform(0.2, 1.0, (1, 400, 1))
    mine, others = rng.normal(0.0, 0.1, (40, 1, 1)), rng.normal(0.0, 0.05, (50, 1, 1))
    s = difference(motions + mine, motions + others)
    half = 1.96 * np.sqrt(mine.var() / 40 + others.var() / 50)  # motions are common and cancel out
    assert (s.high - s.low) / 2 == pytest.approx(half, rel=0.08)
    assert s.mean == pytest.approx(mine.mean() - others.mean())
    assert s.worst == pytest.approx(mine.max() - others.min())
    # As many seeds of either: their order has no meaning.
    s = difference(motions + mine, motions + mine)
    assert s.mean == pytest.approx(0.0, abs=1e-12)
    assert (s.high - s.low) / 2 == pytest.approx(1.96 * mine.std() * np.sqrt(2 / 40), rel=0.1)
