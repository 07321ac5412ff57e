"""Criteria on arrays whose values are known by hand."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from mrdamp.simulation.criteria import Criteria, evaluate
from mrdamp.structures import ShearFrame
from refusals import refuses

FRAME = ShearFrame(np.array([10.0, 20.0]), np.array([1e4, 1e4]), np.array([1.0, 1.0]))
TIME = np.linspace(0.0, 2.0, 2001)


def sine_run(scale: float = 1.0, **others: Any) -> Criteria:
    wave = scale * np.sin(2 * np.pi * TIME)
    drift = np.column_stack([0.01 * wave, -0.03 * wave])
    acceleration = np.column_stack([2.0 * wave, -3.0 * wave])
    return evaluate(FRAME, TIME, drift, acceleration, **others)


def test_peaks_and_norms_of_a_sine() -> None:
    c = sine_run(force=500 * np.cos(2 * np.pi * TIME))
    np.testing.assert_allclose(c.peak_drift, [0.01, 0.03], rtol=1e-6)
    np.testing.assert_allclose(c.rms_drift, np.array([0.01, 0.03]) / np.sqrt(2), rtol=1e-6)
    np.testing.assert_allclose(c.peak_displacement, [0.01, 0.02], rtol=1e-6)
    np.testing.assert_allclose(c.peak_acceleration, [2.0, 3.0], rtol=1e-6)
    np.testing.assert_allclose(c.rms_acceleration, np.array([2.0, 3.0]) / np.sqrt(2), rtol=1e-6)
    # 10 kg x 2 m/s2 - 20 kg x 3 m/s2
    assert c.peak_base_shear == pytest.approx(40.0, rel=1e-6)
    assert c.rms_base_shear == pytest.approx(40.0 / np.sqrt(2), rel=1e-6)
    assert c.peak_force == 500
    assert c.rms_force == pytest.approx(500 / np.sqrt(2), rel=1e-3)
    assert c.peak_stroke == pytest.approx(0.01, rel=1e-6)
    assert c.duration == 2.0
    assert c.weight == pytest.approx(30 * 9.80665)


def test_dissipated_energy() -> None:
    # A dashpot c under x = X sin(w t) takes pi c w X^2 a cycle; a spring takes nothing.
    w, amplitude = 2 * np.pi, 0.01
    x, v = amplitude * np.sin(w * TIME), amplitude * w * np.cos(w * TIME)
    dashpot = sine_run(force=300 * v, stroke=x)
    assert dashpot.dissipated_energy == pytest.approx(2 * np.pi * 300 * w * amplitude**2, rel=1e-5)
    assert sine_run(force=300 * x, stroke=x).dissipated_energy == pytest.approx(0, abs=1e-9)


def test_command_figures() -> None:
    command = np.where(TIME < 0.5, 0.0, 2.0)
    command[TIME >= 1.5] = 1.0
    c = sine_run(command=command)
    # 0 for 0.5 s, 2 for 1 s, 1 for 0.5 s
    assert c.mean_command == pytest.approx(1.25, rel=1e-9)
    assert c.rms_command == pytest.approx(np.sqrt((4 + 0.5) / 2), rel=1e-9)
    # a full and a half swing of 2 in 2 s
    assert c.switching_rate == pytest.approx(0.75)
    assert sine_run(command=command, command_max=4.0).switching_rate == pytest.approx(0.375)
    assert sine_run(command=np.full(len(TIME), 2.0)).switching_rate == 0
    assert sine_run().switching_rate == sine_run().mean_command == sine_run().peak_force == 0


def test_ratios_take_the_largest_storey_and_the_peaks_of_each_run() -> None:
    """Of drifts, accelerations and base shears that are 1 for a second, 3 for three; J11 and J12 of single peaks."""
    time = [0.0, 1.0, 1.0 + 1e-9, 4.0]
    size = np.array([[1.0], [1.0], [3.0], [3.0]])
    before = evaluate(FRAME, time, size * [4.0, 1.0], size * [8.0, 2.0])
    force, stroke = [0.0, 60.0, 0.0, 0.0], [0.0, 1.5, 0.0, 0.0]
    after = evaluate(FRAME, time, size * [1.0, 2.0], size * [1.0, 2.0], force, stroke)
    r = after.relative_to(before)
    assert (r.j1, r.j2, r.j3) == pytest.approx((2 / 4, 2 / 8, 50 / 120))
    assert (r.j4, r.j5, r.j6) == pytest.approx((2 / 4, 2 / 8, 50 / 120))
    assert (r.j11, r.j12) == pytest.approx((60 / (30 * 9.80665), 1.5 / 12))
    rest = evaluate(FRAME, time, 0 * size * [1.0, 1.0], 0 * size * [1.0, 1.0])
    refuses(lambda: after.relative_to(rest), "peak drift of the uncontrolled run is 0")


def test_a_command_counts_by_its_size_and_for_as_long_as_it_is_held() -> None:
    zeros = np.zeros((4, 2))
    c = evaluate(FRAME, [0.0, 1.0, 1.5, 4.0], zeros, zeros, command=[1.0, -3.0, 0.0, 9.0])
    assert c.mean_command == pytest.approx((1.0 * 1 + 3.0 * 0.5) / 4)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"drift": np.zeros((3, 1))}, "drift has shape (3, 1); allowed: (3, 2)"),
        ({"acceleration": np.full((3, 2), np.nan)}, "acceleration has a value that is not finite"),
        ({"force": [1.0, 2.0]}, "force has shape (2,); allowed: (3,)"),
        ({"time": [0.0, 1.0, 1.0]}, "does not increase"),
        ({"time": [[0.0, 1.0]]}, "time has shape (1, 2); allowed: (n,)"),
    ],
)
def test_bad_arrays_get_one_line(change: dict[str, Any], says: str) -> None:
    good = {"time": [0.0, 1.0, 2.0], "drift": np.ones((3, 2)), "acceleration": np.ones((3, 2))}
    refuses(lambda: evaluate(FRAME, **{**good, **change}), re.escape(says))
