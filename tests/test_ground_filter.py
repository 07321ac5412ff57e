"""The Kalman filter of frame and ground, on motions that SciPy integrates."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from mrdamp.control.ground_filter import Ground
from mrdamp.control.observe import Observer
from mrdamp.control.plant import outputs, plant
from mrdamp.errors import InputError
from mrdamp.motions import kanai_tajimi
from mrdamp.structures import dyke1996

FRAME = dyke1996()
NAMES = ("acceleration_1", "acceleration_2", "acceleration_3", "displacement_1")
PERIOD = 2e-3


def measured(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Measurements (T, 4), force (T,), states (T, 6) and ground acceleration (T,) of a frame under a motion and a
    sine of a force."""
    motion = kanai_tajimi(seed, ground_frequency=10.0, filter_frequency=1.0).compressed(5.0)
    t = np.arange(0.0, motion.duration, PERIOD)
    ground, force = np.interp(t, motion.time, motion.acceleration), 200.0 * np.sin(40.0 * t)
    linear = plant(FRAME)
    c, d = outputs(FRAME, NAMES)
    system = StateSpace(linear.a, np.column_stack([linear.b, linear.e]), np.eye(6), np.zeros((6, 2)))
    states = lsim(system, np.column_stack([force, ground]), t)[1]
    return states @ c.T + np.outer(force, d), force, states, ground


@pytest.mark.parametrize("seed", [3, 4])
def test_states_and_ground_are_estimated(seed: int) -> None:
    y, force, states, ground = measured(seed)
    given = Ground(50.0, 0.5, 1e5, 8e-4)
    filter_ = given.estimator(FRAME, NAMES, PERIOD)
    found = np.array(
        [filter_({**dict(zip(NAMES, row, strict=True)), "force": f}) for row, f in zip(y, force, strict=True)]
    )
    error = np.sqrt(np.mean((found[:, :6] - states) ** 2, axis=0) / np.mean(states**2, axis=0))
    assert error.max() < 0.05
    estimated = 50.0**2 * found[:, 6] + 2 * 0.5 * 50.0 * found[:, 7]
    assert np.corrcoef(estimated, ground)[0, 1] > 0.85
    assert np.sqrt(np.mean((estimated - ground) ** 2) / np.mean(ground**2)) < 0.5


def test_an_observer_has_the_states_behind_its_own() -> None:
    """Scaled: displacements and velocities of a strong motion, and the ground's share of 5 m/s2."""
    y, force, _, _ = measured(5)
    given = Ground(50.0, 0.5, 1e5, 8e-4)
    plain = Observer((*NAMES, "force"), (5.0, 5.0, 5.0, 0.004, 1400.0), 1, False, (2.25,), 1e3)
    own = given.observed(plain, FRAME, PERIOD)
    both = given.observed(own, FRAME, PERIOD)
    assert (own.size, both.size) == (5 + 8, 5 + 16)
    filter_ = given.estimator(FRAME, NAMES, PERIOD)
    w = 2 * np.pi * float(FRAME.frequencies[0])
    scale = np.array([w**2, w**2, w**2, w, w, w, 2500.0, 50.0]) / 5.0
    for row, f in zip(y[:400], force, strict=False):
        given_now = {**dict(zip(NAMES, row, strict=True)), "force": f}
        seen, twice, estimate = own(given_now, 0.0), both(given_now, 0.0), filter_(given_now)
    np.testing.assert_allclose(seen[5:], scale * estimate, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(twice, [*seen, *seen[5:]])


def test_what_cannot_be_a_ground() -> None:
    with pytest.raises(InputError, match="allowed: numbers frequency, damping, noise_ratio, precision"):
        Ground.of({"frequency": 50})
    with pytest.raises(InputError, match="noise_ratio"):
        Ground(50.0, 0.5, 0.0, 1.0)
    with pytest.raises(InputError, match="sees no force"):
        Ground(50.0, 0.5, 1e5, 1.0).observed(Observer(("stroke",), (1.0,)), FRAME, PERIOD)
