"""The frame's environment, checkers, and parameters drawn for every episode."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scipy.linalg import eigh

import mrdamp.envs
from env_arguments import OWN, dashpot, needed
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import FrameBench
from mrdamp.envs import (
    CableEnv,
    CableTask,
    CarEnv,
    CarTask,
    FrameEnv,
    FramePlant,
    FrameTask,
    RecordedMotions,
    StructureEnv,
    SyntheticMotions,
)
from mrdamp.envs.frame import reference_run
from mrdamp.envs.loads import AmbientLoads
from mrdamp.model import Model
from mrdamp.motions import GroundMotion, kanai_tajimi
from mrdamp.structures import ShearFrame, dyke1996
from refusals import refuses

SHORT = SyntheticMotions(duration=4.0)  # 0.8 s as it is played
STRONG = kanai_tajimi(3, duration=12.0, pga=5.0).compressed(5.0)


def test_gymnasiums_checker_has_nothing_to_say() -> None:
    for id in mrdamp.envs.ENVIRONMENTS:
        check_env(gymnasium.make(f"mrdamp:{id}", **needed(id)).unwrapped, skip_render_check=not can_draw())
    check_env(FrameEnv(motions=SHORT, history=3, damper_between=[(0, 1), (1, 2)]), skip_render_check=True)


def test_stable_baselines_checker_has_nothing_to_say() -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="needs the extra train")
    for id in mrdamp.envs.ENVIRONMENTS:
        checker.check_env(gymnasium.make(id, **needed(id)).unwrapped)


def test_the_reference_may_be_that_of_a_constant_command() -> None:
    nothing = dashpot(0.0)
    on = reference_run(Model("bingham", dict(nothing.parameters, c0a=2e4), (), "frame", dyke1996()),
                       STRONG.acceleration.copy(), STRONG.sample_time, "passive-on", 1.0)  # fmt: skip
    free = reference_run(Model("bingham", nothing.parameters, (), "frame", dyke1996()),
                         STRONG.acceleration.copy(), STRONG.sample_time)  # fmt: skip
    assert on.drift < 0.7 * free.drift


def test_a_plant_goes_on_with_its_ground_at_rest() -> None:
    """Past the end of a short motion nothing is left of a longer one that it ran before."""
    short = replace(STRONG, acceleration=STRONG.acceleration[:60].copy())
    used, fresh = FramePlant(), FramePlant()
    used.reset(STRONG)
    used.reset(short)
    fresh.reset(short)
    for _ in range(600):
        assert used.step(1.0) == fresh.step(1.0)
    assert fresh.finished


def test_one_rule_for_the_time_scale_of_a_record(tmp_path: Path) -> None:
    """A file of 20 s lasts 4 s on the frame, whoever plays it, unless another compression is asked for."""
    record = kanai_tajimi(1, duration=20.0)
    file = tmp_path / "record.csv"
    record.save(file)
    env = FrameEnv(motions=RecordedMotions([file]))
    bench = FrameBench(frame_model()).played(record, 1.0)
    drawn, given = env.reset(seed=0)[1], env.reset(options={"motion": file})[1]
    for info in (drawn, given, vars(bench) | {"duration": bench.duration}):
        assert info["duration"] == pytest.approx(4.0, abs=0.01)
        assert info["speed"] == 5.0
    assert env.reset(options={"motion": file, "compression": 1.0})[1]["duration"] == pytest.approx(20, abs=0.05)
    own = GroundMotion("own", 0.01, np.sin(np.arange(101.0)))
    assert env.reset(options={"motion": own})[1]["duration"] == pytest.approx(1.0)
    refuses(lambda: env.reset(options={"motion": 3}), "motion is 3")


@pytest.mark.parametrize(("make", "given"), [(FrameTask, {}), (CableTask, {"timestep": 2.5e-4}), (CarTask, {})])
def test_normalised_observations_are_about_one(make: Any, given: Mapping[str, Any]) -> None:
    """RMS of each signal under the default loads and random commands, the stroke's velocity among them."""
    signals = (*make(1).observer.signals, "stroke_velocity")
    task = make(8, engine="chain", signals=signals, normalise=True, **given)
    rngs = [np.random.default_rng(k) for k in range(8)]
    task.reset(range(8), rngs)
    seen = []
    for k in range(950):
        if k % 20 == 0:
            actions = rngs[0].uniform(-1, 1, (8, 1))
        seen.append(task.step(actions).observation[:, : len(signals)])
    rms = np.sqrt(np.mean(np.concatenate(seen) ** 2, axis=0))
    assert ((rms > 0.4) & (rms < 2.5)).all(), dict(zip(signals, rms.tolist(), strict=True))
    refuses(lambda: make(1, normalise=True, observer=task.observer), "normalise is for")


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


def can_draw() -> bool:
    try:
        mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 8, 8).close()
    except Exception:  # each platform's library has an error of its own
        return False
    return True
