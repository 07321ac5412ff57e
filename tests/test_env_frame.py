"""The frame's environment, checkers, parameters drawn for every episode; rewards, and what they are measured by."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scipy.integrate import solve_ivp
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
from mrdamp.envs.cable import CableReward, free_run
from mrdamp.envs.car import CarReward, linear_run
from mrdamp.envs.frame import FrameReward, reference_run
from mrdamp.envs.loads import AmbientLoads
from mrdamp.envs.structure import Score, Weights
from mrdamp.model import Model
from mrdamp.motions import GroundMotion, kanai_tajimi
from mrdamp.structures import ShearFrame, dyke1996
from mrdamp.structures.cables import StayCable
from mrdamp.structures.lumped import QuarterCar
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
