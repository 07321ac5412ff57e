"""The floors' accelerometers of the environments against those of the C entry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mrdamp.model import core
from mrdamp.model.core import Array, FrameInput
from mrdamp.simulation.floor_sensors import FloorSensors

PERIOD = 0.004
LAW = dict.fromkeys(("c0a", "c0b", "fya", "fyb", "v_ref"), 0.0)
FRAME = FrameInput(np.array([90.0, 80.0]), np.array([5e5, 4e5]), np.array([90.0, 80.0]), None)
SENSED = {
    "poles": {"acc_lag": [0.0, 0.01], "acc_lag2": [0.0, 0.004], "acc_offset": [0.2, 0.0]},
    "second order": {"acc_lag": [0.012, 0.01], "acc_ratio": [0.7, 0.0], "acc_gain": [1.2, 0.9]},
    "third order": {"acc_lag": [0.012, 0.01], "acc_ratio": [0.7, 0.0], "acc_lag2": [0.006, 0.003]},
    "two leaks": {"acc_leakage": [0.1, 0.0], "acc_leakage_share": [0.3, 0.0], "acc_leakage2": [0.6, 0.0]},
    "settling": {"acc_settle": [0.5, -0.3], "acc_settle_time": [0.4, 0.0], "acc_lag": [0.01, 0.0]},
    "a share that stays": {"acc_leakage": [0.1, 0.2], "acc_leakage_share": [0.3, 0.0]},
}


def accelerations(frame: FrameInput) -> Array:
    """(samples, floors) m/s2."""
    t = PERIOD * np.arange(500)
    ground = 2 * np.sin(2 * np.pi * 3 * t) + np.sin(2 * np.pi * 17 * t + 1)
    out = core.run_frame("bingham", LAW, frame, PERIOD, ground, 0.0)
    return np.column_stack([out["acceleration_1"], out["acceleration_2"]])


@pytest.mark.parametrize("what", SENSED)
def test_readings_are_those_of_the_c_entry(what: str) -> None:
    given = {name: np.array(values) for name, values in SENSED[what].items()}
    frame = replace(FRAME, **({"acc_gain": np.ones(2)} | given))
    true, want = accelerations(FRAME), accelerations(frame)
    sensors = FloorSensors(frame, PERIOD, 3)
    got = [sensors.read(np.repeat(true[:1], 3, axis=0), (0, 1, 2))]
    got += [sensors.read(np.repeat(row[None], 3, axis=0), None) for row in true[1:]]
    for row in range(3):
        np.testing.assert_allclose([g[row] for g in got], want, rtol=1e-9, atol=1e-9)
    assert np.abs(want - true).max() > 0.1  # the sensor changes something


def test_a_row_starts_afresh_and_is_restored_alone() -> None:
    frame = replace(FRAME, acc_lag=np.array([0.012, 0.01]), acc_ratio=np.array([0.7, 0.0]))
    true, sensors = accelerations(FRAME), FloorSensors(frame, PERIOD, 2)
    sensors.read(true[[0, 0]], (0, 1))
    for row in true[1:50]:
        sensors.read(np.repeat(row[None], 2, axis=0), None)
    kept = sensors.save(1)
    np.testing.assert_array_equal(sensors.read(true[:1], (0,)), true[:1])
    sensors.read(np.zeros((2, 2)), None)
    sensors.restore(1, kept)
    again = sensors.read(np.repeat(true[49:50], 2, axis=0), None)[1]
    twin = FloorSensors(frame, PERIOD, 1)
    twin.read(true[:1], (0,))
    for row in true[1:50]:
        twin.read(row[None], None)
    np.testing.assert_allclose(again, twin.read(true[49:50], None)[0], rtol=1e-12)
