"""The frame's environment: its physics against SciPy and by its energy, its contract, its arguments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import mrdamp.envs
from env_arguments import dashpot, needed
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import FrameBench
from mrdamp.envs import CableTask, CarTask, FrameEnv, FramePlant, FrameTask, RecordedMotions, SyntheticMotions
from mrdamp.envs.reward import reference_run
from mrdamp.model import Effect, Model
from mrdamp.motions import GroundMotion, kanai_tajimi
from mrdamp.structures import ShearFrame, dyke1996
from refusals import refuses
from test_env_view import can_draw

SHORT = SyntheticMotions(duration=4.0)  # 0.8 s as it is played
STRONG = kanai_tajimi(3, duration=12.0, pga=5.0).compressed(5.0)


def test_gymnasiums_checker_has_nothing_to_say() -> None:
    """Also without a display, with MUJOCO_GL=egl."""
    for id in mrdamp.envs.ENVIRONMENTS:
        check_env(gymnasium.make(f"mrdamp:{id}", **needed(id)).unwrapped, skip_render_check=not can_draw())
    check_env(FrameEnv(motions=SHORT, history=3, damper_between=[(0, 1), (1, 2)]), skip_render_check=True)


def test_stable_baselines_checker_has_nothing_to_say() -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="needs the extra train")
    for id in mrdamp.envs.ENVIRONMENTS:
        checker.check_env(gymnasium.make(id, **needed(id)).unwrapped)


def test_the_uncontrolled_run_is_the_reference() -> None:
    """A damper that does nothing has ratios of one; the frame alone is solved elsewhere, by SciPy."""
    nothing = dashpot(0.0)
    env = FrameEnv(model=nothing, command_max=1.0)
    env.reset(options={"motion": STRONG})
    info: dict[str, Any] = {}
    total, over = 0.0, False
    while not over:
        _, reward, _, over, info = env.step(np.array([1.0], np.float32))
        total += reward
    assert total == pytest.approx(-100, rel=1e-2)
    assert info["drift_ratio"] == pytest.approx(1.0, abs=5e-3)
    assert info["acceleration_ratio"] == pytest.approx(1.0, abs=1e-2)
    assert info["dissipated_energy"] == 0.0
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
    while not fresh.finished:
        assert used.step(1.0) == fresh.step(1.0)
    swings = []
    for _ in range(300):
        y = fresh.step(1.0)
        assert used.step(1.0) == y
        swings.append(abs(y["displacement_3"]))
    assert max(swings[-60:]) < 0.2 * max(swings[:60])


def test_any_model_and_any_frame() -> None:
    tall = ShearFrame(np.full(6, 90.0), np.full(6, 4e5), np.full(6, 80.0))
    tanh = Model("hyperbolic_tangent", {
        "k0a": 500.0, "k0b": 0.0, "k1a": 2e5, "k1b": 1e5, "c0a": 800.0, "c0b": 300.0, "c1a": 500.0, "c1b": 100.0,
        "m0": 0.5, "f0a": 60.0, "f0b": 500.0, "v_ref": 0.004,
    }, (Effect("seal_friction", {"coulomb": 20.0}),))  # fmt: skip
    env = FrameEnv(
        model=[tanh, mrdamp.envs.default_damper()], structure=tall, damper_between=[(0, 1), (2, 4)],
        command_max=[2.0, 1.5], motions=SHORT, full_state=True,
    )  # fmt: skip
    assert env.action_space.shape == (2,)
    assert env.observation_space.shape == (6 * 3 + 2 * 2 + 2,)
    env.reset(seed=0)
    for _ in range(100):
        seen, _, _, _, info = env.step(np.array([1.0, -1.0], np.float32))
    at = env.task.observer.names
    assert seen[at.index("current")] == pytest.approx(1.0)
    assert seen[at.index("current_2")] == pytest.approx(0.0, abs=1e-6)
    assert (seen[-2], seen[-1]) == (1.0, 0.0)
    assert info["mean_current"] == pytest.approx(1.0, rel=1e-3)


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


@pytest.mark.slow
def test_spawned_workers_find_an_environment_by_its_package_and_name() -> None:
    """The worker has imported nothing: the part before the colon is what it imports."""
    library = pytest.importorskip("stable_baselines3.common.env_util", reason="needs the extra train")
    from stable_baselines3.common.vec_env import SubprocVecEnv

    options = {"n_envs": 2, "seed": 3, "vec_env_cls": SubprocVecEnv, "vec_env_kwargs": {"start_method": "spawn"}}
    workers = library.make_vec_env("mrdamp:mrdamp/Frame-v0", **options)
    try:
        here, seen = FrameEnv(), workers.reset()
        np.testing.assert_array_equal(seen[0], here.reset(seed=3)[0])
        for action in np.random.default_rng(0).uniform(-1, 1, (40, 2, 1)).astype(np.float32):
            seen, reward, _, _ = workers.step(action)
            observation, expected, *_ = here.step(action[0])
            np.testing.assert_array_equal(seen[0], observation)
            assert reward[0] == pytest.approx(expected, rel=1e-6)
    finally:
        workers.close()


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
