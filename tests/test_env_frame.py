"""The frame's environment: its physics against SciPy and by its energy, its contract, its arguments."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv

import mrdamp.envs
from env_arguments import needed
from excitation import Array
from frame_reference import solve
from mrdamp.control import clipped_optimal
from mrdamp.envs import FrameEnv, FramePlant, FrameReward, RecordedMotions, SyntheticMotions
from mrdamp.envs.reward import reference_run
from mrdamp.model import Effect, Model
from mrdamp.motions import embedded_motion, kanai_tajimi
from mrdamp.simulation import stepping
from mrdamp.structures import ShearFrame, dyke1996
from test_env_chain import off
from test_env_view import can_draw

SHORT = SyntheticMotions(duration=4.0)  # 0.8 s as it is played
STRONG = kanai_tajimi(3, duration=12.0, pga=5.0).compressed(5.0)


def commands(n: int) -> Array:
    return np.repeat(np.random.default_rng(4).choice([0.0, 0.7, 2.25], n // 6 + 1), 6)[:n]


@pytest.mark.parametrize("floor", [1, 2])
def test_the_frame_agrees_with_scipy(floor: int) -> None:
    """Held commands, a motion that changes within the control period; peaks at the engine's steps."""
    motion = kanai_tajimi(3, duration=7.0, pga=5.0).compressed(5.0)
    seen_by = ("displacement_3", "acceleration_1", "force", "current")
    env = FrameEnv(damper_between=(floor - 1, floor), signals=seen_by)
    env.reset(options={"motion": motion})
    n = 270
    u = commands(n)
    wanted = solve(lambda t: float(np.interp(t, motion.time, motion.acceleration)), u, 5e-3, 5e-4, floor)
    scales = np.array(env.task.observer.scales)
    seen: list[Array] = []
    info: dict[str, Any] = {}
    for value in u:
        observation, _, _, _, info = env.step(np.array([2 * value / 2.25 - 1], np.float32))
        seen.append(observation[:4] * scales)
    found = np.array(seen)
    channels = wanted["displacement"][:, 2], wanted["acceleration"][:, 0], wanted["force"], wanted["current"]
    for k, channel in enumerate(channels):
        assert off(found[:, k], channel[10::10]) < 0.01, k
    drift = np.abs(np.diff(wanted["displacement"], axis=1, prepend=0.0)).max()
    assert info["peak_drift"] == pytest.approx(drift, rel=3e-3)
    assert info["peak_acceleration"] == pytest.approx(np.abs(wanted["acceleration"]).max(), rel=0.01)
    assert info["dissipated_energy"] == pytest.approx(wanted["energy"][-1], rel=5e-3)
    assert info["mean_current"] == pytest.approx(wanted["current"][:-1].mean(), rel=5e-3)


@pytest.mark.parametrize("between", [[(0, 1)], [(0, 1), (1, 3), (3, 2)]])
def test_the_input_is_kinetic_strain_and_dissipated_energy(between: list[tuple[int, int]]) -> None:
    """Relative to the ground (Uang and Bertero 1990), at every step, within 0.5 % of the largest input."""
    plant = FramePlant(damper_between=between)
    plant.reset(STRONG)
    rows, s = plant.rows, dyke1996()
    record = [
        rows.plants.advance(np.full((1, len(between)), u))[0]["sensordata"][0].copy() for u in commands(480)
    ]
    data, h = np.concatenate(record), rows.plants.timestep
    at = rows.plants.sensors

    def columns(name: str, count: int) -> Array:
        start = at[name].start
        return data[:, start : start + count]

    drift, rate = columns("drift_1", 3), columns("drift_velocity_1", 3).copy()
    force, speed = columns("true_force", len(between)), columns("stroke_velocity", len(between)).copy()
    for velocity in (rate, speed):  # the engine's stand half a step before its positions
        velocity[:-1] = (velocity[:-1] + velocity[1:]) / 2
    v = rate.cumsum(axis=1)
    ground = np.interp(h * np.arange(len(data)), STRONG.time, STRONG.acceleration, right=0.0)
    given = h * np.cumsum(-(v @ s.mass) * ground)
    held = 0.5 * (v**2 @ s.mass + drift**2 @ s.stiffness)
    lost = h * np.cumsum(rate**2 @ s.damping + (force * speed).sum(axis=1))
    assert np.abs(given - held - lost).max() < 0.005 * given.max()
    assert held.max() > 0.05 * given.max()


def test_a_controller_runs_on_the_plant_as_in_run_frame() -> None:
    motion = kanai_tajimi(0, duration=6.0).compressed(5.0)
    controller = clipped_optimal(dyke1996(), 2.25, period=5e-3)
    plant = FramePlant()
    own = plant.structure.models[0]
    wanted = stepping.run_frame(
        Model(own.law, own.parameters, own.effects, "frame", dyke1996()), motion, controller, timestep=5e-4,
    )  # fmt: skip
    controller.reset()
    y, rows = plant.reset(motion), []
    while not plant.finished:
        rows.append([y["acceleration_3"], y["displacement_1"], y["force"], y["stroke"], plant.time])
        y = plant.step(controller.command(plant.time, y))
    found = np.array(rows)
    np.testing.assert_array_equal(found[:, 0], wanted.acceleration[:, 2])
    np.testing.assert_array_equal(found[:, 1], wanted.drift[:, 0])
    np.testing.assert_array_equal(found[:, 2], wanted.force)
    np.testing.assert_array_equal(found[:, 3], wanted.stroke)
    np.testing.assert_allclose(found[:, 4], wanted.time, atol=1e-12)


def test_gymnasiums_checker_has_nothing_to_say() -> None:
    """Also without a display, with MUJOCO_GL=egl."""
    for id in mrdamp.envs.ENVIRONMENTS:
        check_env(gymnasium.make(f"mrdamp:{id}", **needed(id)).unwrapped, skip_render_check=not can_draw())
    check_env(FrameEnv(motions=SHORT, history=3, damper_between=[(0, 1), (1, 2)]), skip_render_check=True)


def test_stable_baselines_checker_has_nothing_to_say() -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="needs the extra train")
    for id in mrdamp.envs.ENVIRONMENTS:
        checker.check_env(gymnasium.make(id, **needed(id)).unwrapped)


@pytest.mark.slow
def test_spawned_workers_give_the_same_numbers() -> None:
    actions = np.random.default_rng(0).uniform(-1, 1, (40, 2, 1)).astype(np.float32)
    workers = AsyncVectorEnv([_make] * 2, context="spawn")
    try:
        seen, _ = workers.reset(seed=4)
        here = [FrameEnv(motions=SHORT) for _ in range(2)]
        for k, env in enumerate(here):
            np.testing.assert_array_equal(seen[k], env.reset(seed=4 + k)[0])
        for action in actions:
            seen, reward, *_ = workers.step(action)
            for k, env in enumerate(here):
                observation, expected, *_ = env.step(action[k])
                np.testing.assert_array_equal(seen[k], observation)
                assert reward[k] == expected
    finally:
        workers.close()


def _make() -> FrameEnv:
    return FrameEnv(motions=SyntheticMotions(duration=4.0))


def test_the_parts_are_the_reward_and_follow_the_weights() -> None:
    weights = FrameReward(
        drift=1.0, acceleration=2.0, drift_peak=3.0, acceleration_peak=4.0, current=0.5, power=0.25, energy=0.1,
        exponent=3.0,
    )  # fmt: skip
    env = FrameEnv(motions=SHORT, reward=weights)
    _, start = env.reset(seed=3)
    total, peaks = 0.0, np.zeros(2)
    infos: dict[str, Any] = {}
    current = 0.0
    for _ in range(120):
        _, reward, _, _, infos = env.step(np.array([0.5], np.float32))
        parts = [value for name, value in infos.items() if name.startswith("reward_")]
        assert reward == pytest.approx(sum(parts), abs=1e-12)
        total += infos["reward_drift_peak"]
        current += infos["reward_current"]
        now = np.array([infos["drift_ratio"], infos["acceleration_ratio"]])
        assert (now >= peaks).all()
        peaks = now
    assert total == pytest.approx(-300 * peaks[0])
    assert infos["peak_drift"] == pytest.approx(peaks[0] * start["reference_drift"])
    assert infos["peak_acceleration"] == pytest.approx(peaks[1] * start["reference_acceleration"])
    periods = math.floor(start["duration"] / 0.005 + 1e-9) + 1
    assert current == pytest.approx(-50 * 120 / periods * infos["mean_current"] / 2.25)
    assert 0.2 < peaks[0] < 1.0


def test_rewards_do_not_depend_on_the_size_of_a_linear_run() -> None:
    """A dashpot in the frame: twice the motion, the same ratios and rewards."""
    dashpot = Model("bingham", {"c0a": 3000.0, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01})
    env = FrameEnv(model=dashpot, command_max=1.0, reward={"drift_peak": 1.0, "energy": 0.2})
    totals = []
    for amplitude in (0.5, 4.0):
        env.reset(options={"motion": STRONG, "amplitude": amplitude})
        totals.append(sum(env.step(np.array([-1.0], np.float32))[1] for _ in range(200)))
    assert totals[0] == pytest.approx(totals[1], rel=1e-6)


def test_the_uncontrolled_run_is_the_reference() -> None:
    """A damper that does nothing has ratios of one; the frame alone is solved elsewhere, by SciPy."""
    nothing = Model("bingham", {"c0a": 0.0, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01})
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


def test_sensors_stand_between_frame_and_observation() -> None:
    base = mrdamp.envs.default_damper()
    placed = (Effect("sensor_gain", {"g": 1.5}, 2), Effect("sensor_offset", {"f": 0.2}, 1))
    on_damper = Effect("sensor_gain", {"g": 0.8})
    model = Model(base.law, base.parameters, (*base.effects, on_damper, *placed), "frame", dyke1996())
    plain, sensed = FramePlant(), FramePlant(model)
    plain.reset(STRONG)
    sensed.reset(STRONG)
    for _ in range(80):
        a, b = plain.step(1.0), sensed.step(1.0)
    assert b["acceleration_2"] == pytest.approx(1.5 * a["acceleration_2"])
    assert b["acceleration_1"] == pytest.approx(a["acceleration_1"] + 0.2)
    assert b["acceleration_3"] == a["acceleration_3"]
    assert b["force"] == pytest.approx(0.8 * a["force"])
    assert b["true_force"] == a["true_force"]


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


def test_a_channel_that_is_late_reads_the_stroke_of_before() -> None:
    base, late = mrdamp.envs.default_damper(), 2e-3
    shift = Effect("channel_shift", {"d": late})
    plain, shifted = FramePlant(), FramePlant(replace(base, effects=(*base.effects, shift)))
    plain.reset(STRONG)
    shifted.reset(STRONG)
    strokes = []
    for _ in range(300):
        a, b = plain.step(1.0), shifted.step(1.0)
        assert a["stroke"] == a["drift_1"] == b["drift_1"]
        assert a["stroke_velocity"] == b["stroke_velocity"] == a["velocity_1"]
        strokes.append((a["stroke"], b["stroke"], a["stroke_velocity"]))
    x, read, v = np.array(strokes).T
    # To first order; the rest is of the second.
    assert np.abs(read - (x - late * v)).max() < 0.1 * late * np.abs(v).max()
    assert np.abs(read - x).max() > 0.9 * late * np.abs(v).max()


def test_noise_has_its_deviation() -> None:
    env = FrameEnv(noise={"acceleration_2": 0.5})
    clean = FrameEnv()
    scale = env.task.observer.scales[1]
    seen = []
    options = {"motion": STRONG}
    env.reset(seed=0, options=options)
    clean.reset(options=options)
    action = np.zeros(1, np.float32)
    for _ in range(400):
        a, b = env.step(action)[0], clean.step(action)[0]
        np.testing.assert_array_equal(np.delete(a, 1), np.delete(b, 1))
        seen.append((a[1] - b[1]) * scale)
    assert np.std(seen) == pytest.approx(0.5, rel=0.12)


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


def test_a_network_may_be_the_damper() -> None:
    text = (
        "mrdamp-narx 1 sample_time 0.002 inputs 3 x:0 v:0 i:0 offset 0 0 0 scale 100 5 1 force 0 600 "
        "hidden 1 2 weight 0.1 0.9 0.0 0.0 0.5 0.4 bias 0 0 weight 0.8 0.4 bias 0 end"
    )
    env = FrameEnv(model=Model("narx", weights=text), command_max=1.0, motions=SHORT)
    env.reset(seed=0)
    rewards = [env.step(np.array([1.0], np.float32))[1] for _ in range(100)]
    assert np.isfinite(rewards).all()


def test_episodes_end_with_the_motion() -> None:
    env = FrameEnv(duration=0.5, motions=RecordedMotions([embedded_motion()], compression=5.0))
    env.reset(seed=0)
    ends = [env.step(np.zeros(1, np.float32))[2:4] for _ in range(101)]
    assert ends[-1] == (False, True)
    assert not any(terminated or truncated for terminated, truncated in ends[:-1])
