"""LQG on a frame: its filters against SciPy, the clipping law, and designs that cannot be."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import StateSpace, lsim

from mrdamp.control import ForceController, clipped_optimal
from mrdamp.control.clipped_optimal import OptimalForce, optimal_force
from mrdamp.control.force_control import clip
from mrdamp.control.lqg import first_order_hold, outputs, plant
from mrdamp.control.observe import Observer
from mrdamp.errors import InputError
from mrdamp.motions import kanai_tajimi
from mrdamp.structures import ShearFrame, dyke1996
from mrdamp.train.imitation import Ground
from refusals import refuses

Array = NDArray[np.float64]
def frame_of(
    mass: list[float], stiffness: list[float], damping: list[float], floors: tuple[int, int]
) -> ShearFrame:
    return ShearFrame(np.array(mass), np.array(stiffness), np.array(damping), floors)


TWO = frame_of([10.0, 10.0], [1e4, 1e4], [5.0, 5.0], (1, 2))


@pytest.mark.parametrize("floors", [(0, 1), (1, 2), (3, 1)])
def test_filter_finds_the_state_of_a_frame_under_a_known_force(floors: tuple[int, int]) -> None:
    # No ground motion: with the force's sign or feedthrough wrong the estimate would not settle.
    frame = frame_of([80.0, 100.0, 120.0], [5e5, 6e5, 4e5], [90.0, 60.0, 30.0], floors)
    aim = optimal_force(frame, period=5e-4)
    inverse, gamma = np.linalg.inv(frame.mass_matrix), np.zeros(4)
    gamma[floors[1]], gamma[floors[0]] = -1, 1

    def acceleration(s: Array, t: float) -> Array:
        force = gamma[1:] * 200 * np.sin(40 * t)
        return np.asarray(inverse @ (force - frame.stiffness_matrix @ s[:3] - frame.damping_matrix @ s[3:]))

    times = np.arange(1001) * 5e-4
    run = solve_ivp(
        lambda t, s: np.concatenate([s[3:], acceleration(s, t)]),
        (0, 0.5),
        [2e-3, -1e-3, 3e-3, 0, 0, 0],
        t_eval=times,
        rtol=1e-9,
        atol=1e-12,
        method="DOP853",
    )
    for t, s in zip(times, run.y.T, strict=True):
        y = {f"acceleration_{i + 1}": float(a) for i, a in enumerate(acceleration(s, t))}
        wanted = aim(float(t), {**y, "displacement_1": float(s[0]), "force": 200 * float(np.sin(40 * t))})
    scale = np.abs(run.y[:, -200:]).max(axis=1)
    assert (np.abs(aim.estimator.estimate - run.y[:, -1]) < 0.01 * scale).all()
    assert wanted == pytest.approx(-float(aim.k @ run.y[:, -1]), rel=0.1)


def test_first_order_hold_is_exact_for_a_ramp() -> None:
    a, b = np.array([[0.0, 1.0], [-900.0, -3.0]]), np.array([[0.0, 2.0], [1.0, -4.0]])
    u0, u1, s0, h = np.array([3.0, -1.0]), np.array([-2.0, 5.0]), np.array([0.4, -0.7]), 0.02
    phi, g0, g1 = first_order_hold(a, b, h)
    run = solve_ivp(lambda t, s: a @ s + b @ (u0 + (u1 - u0) * t / h), (0, h), s0, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(phi @ s0 + g0 @ u0 + g1 @ u1, run.y[:, -1], rtol=1e-8)


@pytest.mark.parametrize(
    ("wanted", "force", "on"),
    [
        (900.0, 300.0, True),  # more of the same sign is wanted
        (300.0, 900.0, False),  # less is wanted
        (-900.0, -300.0, True),
        (-300.0, -900.0, False),
        (-900.0, 300.0, False),  # the other sign is wanted: a damper cannot push
        (900.0, -300.0, False),
        (900.0, 0.0, False),
        (300.0, 300.0, False),
    ],
)
def test_clipping_law(wanted: float, force: float, on: bool) -> None:
    assert clip(wanted, force, 2.25) == (2.25 if on else 0.0)


def test_defaults_follow_the_frame() -> None:
    controller = clipped_optimal(TWO, 1.0, r=1e-8)
    assert isinstance(controller, ForceController)
    assert isinstance(controller.aim, OptimalForce)
    assert controller.aim.estimator.measurements == ("acceleration_1", "acceleration_2", "displacement_1")
    # Less weight on the force: a larger wanted force.
    cheap, dear = (optimal_force(dyke1996(), regulate={"drift_1": 1.0}, r=r).k for r in (1e-14, 1e-10))
    assert np.linalg.norm(cheap) > 10 * np.linalg.norm(dear)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"command_max": 0.0}, "command_max is 0.0; allowed: a finite number > 0"),
        ({"r": -1.0}, "r is -1.0"),
        ({"noise_ratio": float("nan")}, "noise_ratio is nan"),
        ({"period": float("inf")}, "period is inf"),
        (
            {"regulate": {"acceleration_4": 1.0}},
            "measurement 'acceleration_4' is unknown; allowed: stroke, ",
        ),
        ({"regulate": {"drift_1": 0.0}}, "regulate is {'drift_1': 0.0}"),
        ({"measurements": ["speed"]}, "measurement 'speed' is unknown"),
        ({"measurements": []}, "measurements is empty"),
        # A damper between floors 1 and 2 that holds floor 2's acceleration at nothing lets it wander.
        ({"structure": TWO}, "no stable regulator found for r = 1e-17; raise r"),
    ],
)
def test_bad_designs_get_one_line(change: dict[str, Any], says: str) -> None:
    refuses(lambda: clipped_optimal(**{"structure": dyke1996(), "command_max": 2.25, **change}), re.escape(says))


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
    refuses(lambda: Ground(50.0, 0.5, 0.0, 1.0), "noise_ratio")
    with pytest.raises(InputError, match="sees no force"):
        Ground(50.0, 0.5, 1e5, 1.0).observed(Observer(("stroke",), (1.0,)), FRAME, PERIOD)
