"""Rewards by hand, and what they are measured by: oscillators without damping under a load that sets in at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from env_arguments import dashpot
from mrdamp.envs import AmbientLoads, CableEnv, FrameEnv
from mrdamp.envs.cable import CableReward, free_run
from mrdamp.envs.car import CarReward, linear_run
from mrdamp.envs.frame import FrameReward, reference_run
from mrdamp.envs.structure import Score, Weights
from mrdamp.model import Model
from mrdamp.motions import kanai_tajimi
from mrdamp.structures import ShearFrame
from mrdamp.structures.cables import StayCable
from mrdamp.structures.lumped import QuarterCar

STRONG = kanai_tajimi(3, duration=12.0, pga=5.0).compressed(5.0)
NOTHING = {"c0a": 0.0, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01}


def test_a_storey_swings_to_twice_its_static_drift() -> None:
    """x = (m a / k)(1 - cos w t): drift 2 m a / k, absolute acceleration 2 a, strain energy 2 (m a)^2 / k."""
    mass, stiffness, ground = 100.0, 1e5, 1.5
    frame = ShearFrame(np.array([mass]), np.array([stiffness]), np.array([1e-6]))
    found = reference_run(Model("bingham", NOTHING, (), "frame", frame), np.full(2000, ground), 5e-4)
    assert found.drift == pytest.approx(2 * mass * ground / stiffness, rel=1e-3)
    assert found.acceleration == pytest.approx(2 * ground, rel=1e-3)
    assert found.strain_energy == pytest.approx(2 * (mass * ground) ** 2 / stiffness, rel=2e-3)


def test_a_free_cable_follows_a_load_along_its_lines() -> None:
    """Against SciPy's integrator, of a load with 60 samples a second that is straight between them."""
    cable, step = StayCable(modes=3, ratio=0.05), 1 / 60
    forces = np.random.default_rng(0).normal(size=(60, 4))
    time, fine = step * np.arange(60), np.linspace(0, 59 * step, 20001)
    squares, energy = np.zeros(2), np.zeros(len(fine))
    for w, force in zip(cable.natural, forces.T, strict=True):

        def rates(t: float, x: np.ndarray, w: float = w, force: np.ndarray = force) -> list[float]:
            return [x[1], np.interp(t, time, force) - 2 * cable.ratio * w * x[1] - w * w * x[0]]

        solved = solve_ivp(rates, (0, time[-1]), [0, 0], t_eval=fine, rtol=1e-9, atol=1e-12, max_step=step / 20).y
        acceleration = [rates(t, x)[1] for t, x in zip(fine, solved.T, strict=True)]
        squares += [np.mean(solved[0] ** 2), np.mean(np.square(acceleration))]
        energy += 0.5 * (solved[1] ** 2 + w * w * solved[0] ** 2)
    motion, shaking, held = free_run(cable, forces, step)
    of = cable.mass * cable.length
    assert (motion * of, shaking * of, held) == pytest.approx((*squares, energy.max()), rel=1e-3)


@pytest.mark.parametrize(
    ("make", "options", "ratios"),
    [
        (FrameEnv, {"motion": STRONG}, ("drift_ratio", "acceleration_ratio")),
        (partial(CableEnv, loads=AmbientLoads(duration=6.0)), {}, ("motion_ratio",)),
    ],
)
def test_a_damper_that_does_nothing_has_ratios_of_one(
    make: Callable[..., Any], options: dict[str, Any], ratios: tuple[str, ...]
) -> None:
    """The structure alone is the reference; it is solved elsewhere, by SciPy."""
    env = make(model=dashpot(0.0), command_max=1.0)
    env.reset(seed=1, options=options)
    total, over = 0.0, False
    info: dict[str, Any] = {}
    while not over:
        _, reward, _, over, info = env.step(np.ones(1, np.float32))
        total += reward
    assert total == pytest.approx(-100, rel=1e-2)
    assert [info[name] for name in ratios] == pytest.approx([1.0] * len(ratios), abs=1e-2)
    assert info["dissipated_energy"] == 0.0


@pytest.mark.parametrize("exponent", [1.0, 2.0, 3.0])
@pytest.mark.parametrize(
    ("weights", "reference", "period", "raised", "others", "info"),
    [
        (
            FrameReward(drift=2.0, acceleration=3.0, drift_peak=5.0, acceleration_peak=7.0, current=0.5, power=0.25,
                        energy=11.0),
            [0.01, 4.0, 8.0], [0.004, 2.0, 0.6, 0.5, 1.2, 0.4], {-4: 0.4, -6: 0.5},
            [-500 * 0.4, -700 * 0.5, -1 * 0.6, -0.5 * 0.5, 1100 * 0.4 / 8],
            {"peak_drift": 0.004, "acceleration_ratio": 0.5},
        ),
        (
            CableReward(motion=2.0, acceleration=3.0, current=0.5, power=0.25, energy=11.0),
            [1e-4, 4.0, 8.0], [2.5e-5, 0.36, 0.6, 0.5, 1.2, 0.4], {-4: 0.5, -6: 0.3},
            [-1 * 0.6, -0.5 * 0.5, 1100 * 0.4 / 8],
            {"motion_ratio": 0.5, "rms_motion": 5e-3},
        ),
        (
            CarReward(comfort=2.0, holding=3.0, stroke=5.0, airborne=7.0, current=0.5, power=0.25),
            [4.0, 0.04, 1e-4], [1.0, 0.0036, 4.9e-5, 0.05, 0.2, 0.6, 0.5, 1.2, 0.4], {-4: 0.5, -6: 0.3, -10: 0.7},
            [-14 * 0.2, -1 * 0.6, -0.5 * 0.5],
            {"weighted_acceleration": 1.0, "load_ratio": 0.3, "rms_stroke": 7e-3, "stroke_ratio": 0.7,
             "peak_stroke": 0.05, "airborne": 0.2},
        ),
    ],
)  # fmt: skip
def test_each_part_of_a_reward(
    weights: Weights, reference: list[float], period: list[float], raised: dict[int, float], others: list[float],
    info: dict[str, float], exponent: float,
) -> None:  # fmt: skip
    """By hand over 50 periods, a hundred times the weight: costs are negative, the energy taken in is not."""
    parts = [weight * ratio**exponent for weight, ratio in raised.items()] + others
    for one in (False, True):
        score = Score(replace(weights, exponent=exponent), 1)
        score.start(0, reference, 50)
        reward, found = score.of_one(period) if one else score.of(np.array([period]))
        named = found if isinstance(found, dict) else dict(zip(score.NAMES, found[0], strict=True))
        np.testing.assert_allclose([named[f"reward_{part.name}"] for part in weights.table], parts)
        np.testing.assert_allclose(reward, sum(parts))
        expected = {**info, "mean_current": 1.2, "mean_power": 0.5, "dissipated_energy": 0.4}
        assert {name: named[name] for name in expected} == pytest.approx(expected)


def test_a_peak_counts_by_its_rise() -> None:
    score = Score(FrameReward(drift_peak=5.0, acceleration_peak=7.0, drift=0.0, acceleration=0.0), 1)
    score.start(0, [0.01, 4.0, 8.0], 50)
    score.of_one([0.004, 2.0, 0.6, 0.5, 1.2, 0.4])
    reward, info = score.of_one([0.006, 1.0, 0.0, 0.0, 0.0, 0.0])
    assert reward == pytest.approx(-500 * 0.2)
    assert (info["peak_drift"], info["acceleration_ratio"]) == pytest.approx((0.006, 0.5))
    assert (info["mean_current"], info["dissipated_energy"]) == pytest.approx((0.6, 0.4))


def test_the_cars_criteria_are_over_a_dashpot_of_three_tenths_of_critical() -> None:
    """The stroke on a harmonic road, from the two equations of motion in complex amplitudes."""
    car, w, step = QuarterCar(), 2 * np.pi * 1.5, 1e-3
    c, ct = 0.3 * 2 * math.sqrt(car.stiffness * car.body), car.tyre_damping
    strut, tyre = car.stiffness + 1j * w * c, car.tyre_stiffness + 1j * w * ct
    body, wheel = np.linalg.solve(
        [[strut - car.body * w**2, -strut], [-strut, strut + tyre - car.wheel * w**2]], [0.0, 0.01 * tyre]
    )
    _, _, stroke = linear_run(car, 0.01 * np.sin(w * step * np.arange(20_000)), step)
    last = stroke[-2000:]  # three whole periods
    assert np.sqrt(2 * np.mean(last * last)) == pytest.approx(abs(body - wheel), rel=2e-3)
