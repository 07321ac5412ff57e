"""Parameters drawn for every episode: what the engine then holds, what is measured, and what is said and saved."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.linalg import eigh

from env_arguments import OWN
from mrdamp.envs import CableEnv, CarEnv, FrameEnv, StructureEnv, SyntheticMotions
from mrdamp.envs.cable_loads import AmbientLoads
from mrdamp.structures import ShearFrame, dyke1996
from refusals import refuses

engines = pytest.mark.parametrize("engine", ["mujoco", "chain"])


def engine_frequencies(model: mujoco.MjModel) -> np.ndarray:
    """Hz, from the engine's own mass matrix and springs."""
    data, mass = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    springs = np.diag(model.jnt_stiffness.ravel())
    on = np.flatnonzero(model.jnt_stiffness.ravel())  # the table that the ground is on is moved
    found = eigh(springs[np.ix_(on, on)], mass[np.ix_(on, on)], eigvals_only=True)
    return np.asarray(np.sqrt(found) / (2 * math.pi))


def test_the_engine_holds_the_drawn_frame() -> None:
    """Dyke et al. (1996) give 5.46, 15.8 and 23.6 Hz; all go with the root of stiffness over mass."""
    env = FrameEnv(randomise={"stiffness": (0.8, 1.2), "mass": (0.8, 1.2)})
    for seed in range(3):
        drawn = env.reset(seed=seed)[1]["drawn"]
        assert all(0.8 <= value <= 1.2 for value in drawn.values())
        found = engine_frequencies(env.task.rows.of(0).plants.model)
        expected = np.array([5.46, 15.8, 23.6]) * math.sqrt(drawn["stiffness"] / drawn["mass"])
        np.testing.assert_allclose(found, expected, rtol=5e-3)


def test_the_engine_holds_the_drawn_cable_and_car() -> None:
    cable = CableEnv(randomise={"tension": (0.7, 0.9), "mass": (1.1, 1.3)}, loads=AmbientLoads(duration=0.1))
    drawn = cable.reset(seed=1)[1]["drawn"]
    first = math.sqrt(2172 * drawn["tension"] / (0.747 * drawn["mass"])) / (2 * 12.65)
    assert engine_frequencies(cable.task.rows.of(0).plants.model)[0] == pytest.approx(first, rel=1e-3)
    car = CarEnv(randomise={"body": (0.8, 0.9), "wheel": (1.1, 1.2)})
    drawn = car.reset(seed=1)[1]["drawn"]
    np.testing.assert_allclose(
        car.task.rows.of(0).plants.model.body_mass[-2:], [40 * drawn["wheel"], 400 * drawn["body"]], rtol=1e-9
    )


@engines
def test_an_episode_is_that_of_the_frame_built_by_hand(engine: str) -> None:
    """To the last bit, reward and reference included."""
    s, ranges = dyke1996(), {"stiffness": (0.9, 1.1), "mass": (0.9, 1.1)}
    own = ShearFrame(0.93 * s.mass, 1.07 * s.stiffness, s.damping)
    drawn: Any
    by_hand: Any
    drawn, by_hand = FrameEnv(engine=engine, randomise=ranges), FrameEnv(engine=engine, structure=own)
    motion = SyntheticMotions(duration=1.5).draw(np.random.default_rng(3))
    values = {"stiffness": 1.07, "mass": 0.93}
    _, info = drawn.reset(options={"motion": motion, "drawn": values})
    assert info["drawn"] == values
    assert info["reference_drift"] == by_hand.reset(options={"motion": motion})[1]["reference_drift"]
    for k in range(40):
        one, other = (env.step(np.full(1, math.sin(k))) for env in (drawn, by_hand))
        # Scales, which are of the frame as it is named, differ.
        assert one[1] == other[1]
        np.testing.assert_array_equal(drawn.task.measured, by_hand.task.measured)


@engines
def test_drawn_driver_and_sensor(engine: str) -> None:
    """A first-order lag by hand, and a reading that is the force times its gain."""
    ranges = {"driver_lag_tau": (0.02, 0.05), "sensor_gain_g": (0.5, 0.8)}
    env: Any = CarEnv(engine=engine, randomise=ranges, signals=["current", "force", "true_force"])
    drawn = env.reset(seed=4)[1]["drawn"]
    for _ in range(6):
        env.step(np.ones(1))
    names, values = env.task.rows.names, env.task.measured[0]
    measured = dict(zip(names, values, strict=True))
    assert measured["current"] == pytest.approx(2.0 * (1 - math.exp(-0.03 / drawn["driver_lag_tau"])), rel=2e-2)
    assert measured["force"] == pytest.approx(drawn["sensor_gain_g"] * measured["true_force"], rel=1e-6)


@pytest.mark.parametrize("tau", [0.05, 0.5])
def test_a_drawn_lag_acts_on_a_structure_of_ones_own(tau: float) -> None:
    """A step of the command: the mean of u (1 - exp(-t / tau)) over the episode."""
    env: Any = StructureEnv(OWN, engine="chain", randomise={"driver_lag_tau": (0.01, 1.0)})
    info = env.reset(seed=3, options={"drawn": {"driver_lag_tau": tau}})[1]
    duration, over = info["duration"], False
    while not over:
        _, _, _, over, info = env.step(np.ones(env.action_space.shape, np.float32))
    mean = env.task.command_max[0] * (1 - tau / duration * (1 - np.exp(-duration / tau)))
    assert info["mean_current"] == pytest.approx(mean, rel=5e-3)


@pytest.mark.parametrize(
    "given", [{"randomise": {"stiffness": (0.9, 1.1)}}, {"noise": {"force": 5.0}, "engine": "chain"}]
)
def test_a_seed_has_one_load(given: dict[str, Any]) -> None:
    plain, other = (FrameEnv(**some).reset(seed=1)[1] for some in ({}, given))
    assert (other["motion"], other["pga"]) == (plain["motion"], plain["pga"])


@pytest.mark.parametrize(
    ("make", "ranges", "message"),
    [
        (FrameEnv, {"stifness": (0.9, 1.1)}, "'stifness' is unknown.*nearest: stiffness"),
        (FrameEnv, {"mass": (1.1, 0.9)}, r"mass is \(1.1, 0.9\)"),
        (FrameEnv, {"mass": (0.0, 1.0)}, "mass is .*factors > 0"),
        (FrameEnv, {"mass": 0.1}, "mass is 0.1"),
        (FrameEnv, {"driver_lag_tau": (-1.0, 0.0)}, "driver_lag_tau"),
        (FrameEnv, {"sensor_gain_g_4": (0.9, 1.0)}, "place 4"),
        (FrameEnv, 3, "randomise is 3"),
        (CableEnv, {"modes": (1, 2)}, "'modes' is unknown"),
        (CableEnv, {"damper_at": (1.0, 60.0)}, "cable"),
    ],
)
def test_ranges_are_checked_when_the_environment_is_made(make: Any, ranges: Any, message: str) -> None:
    refuses(lambda: make(randomise=ranges), message)


@pytest.mark.parametrize("engine", ["mujoco", "chain"])
@pytest.mark.parametrize("value", [math.nan, math.inf, 0.0, -1.0, "1", None])
def test_a_given_value_that_is_none_is_blamed_by_its_name(engine: str, value: Any) -> None:
    env = FrameEnv(engine=engine, randomise={"mass": (0.9, 1.1), "driver_lag_tau": (0.004, 0.007)})
    refuses(lambda: env.reset(options={"drawn": {"mass": value}}), "drawn: mass is .*; allowed: a factor > 0")
    if value not in (0.0, -1.0):
        message = "drawn: driver_lag_tau is .*; allowed: a number"
        refuses(lambda: env.reset(options={"drawn": {"driver_lag_tau": value}}), message)


def test_what_is_drawn_can_be_given_where_it_is_randomised() -> None:
    refuses(lambda: FrameEnv().reset(options={"drawn": {"mass": 1.0}}), "drawn is .*with randomise")
    env = FrameEnv(randomise={"mass": (0.9, 1.1)})
    refuses(lambda: env.reset(options={"drawn": {"stiffness": 1.0}}), "'stiffness' is not randomised")
