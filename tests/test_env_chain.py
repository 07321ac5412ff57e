"""The environments on the C++ chain against those in MuJoCo, against SciPy, and as rows of a vector environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import mrdamp.envs  # noqa: F401  (registers the ids)
from dampers import attributes, off
from excitation import Array
from frame_reference import solve
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import FrameBench
from mrdamp.control.passive import Replay
from mrdamp.envs import AmbientLoads, CableTask, FrameReward, FrameTask
from mrdamp.envs.task import Task
from mrdamp.model import Effect, Model, effects_from
from mrdamp.motions import kanai_tajimi
from mrdamp.simulation.stepping import FrameRun, run_frame
from mrdamp.structures import dyke1996
from networks import random_network

MOTION = kanai_tajimi(3, duration=5.0, pga=5.0).compressed(5.0)
OBSERVED, REWARDED = 0.005, 0.01  # RMS of the difference over the RMS
FINE = 1e-4  # s, of both, so that the engine's own step is in neither
LAG = {"driver_lag_tau": 0.005}
BOUC_WEN = {
    "c0a": 900.0, "c0b": 900.0, "alpha_a": 3e4, "alpha_b": 1e5, "gamma": 9e5, "beta": 4e5, "A": 110.0, "n": 2.0,
    "k0": 3000.0, "x0": 0.0,
}  # fmt: skip
# The foam damper is of 12 N; forty of it fit the frame.
_FOAM = {k: v for k, v in attributes("zapateiro_foam_tanh").items() if "command" not in k}
TANH = {k: v if k == "v_ref" else 40.0 * v for k, v in _FOAM.items()}
LAWS: Mapping[str, tuple[Mapping[str, float], float]] = {
    "bingham": ({"c0a": 900.0, "c0b": 500.0, "fya": 60.0, "fyb": 400.0, "v_ref": 0.004}, 1.0),
    "bouc_wen": (BOUC_WEN, 1.0),
    "modified_bouc_wen": ({k: v for k, v in attributes("dyke1996_3kN").items() if "_tau" not in k}, 2.25),
    "hyperbolic_tangent": (TANH, 4.0),
    "narx": ({}, 1.2),
}
#: Those that the structure feels, or that act across its steps; the law's own are those of the plugin's tests.
EFFECTS: Mapping[str, Mapping[str, float]] = {
    "command_delay": {"command_delay_d": 0.008},
    "moving_mass": {"moving_mass_m": 4.0},
    "mount_compliance": {"mount_compliance_k": 8e5},
    "backlash": {"mount_compliance_k": 8e5, "backlash_gap": 1e-4},
    "sensor": {
        "sensor_gain_g": 0.9,
        "sensor_offset_f": 5.0,
        "sensor_lag_tau": 0.003,
        "sensor_leakage_tau": 0.5,
    },
    "channel_shift": {"channel_shift_d": 0.002},
}
PLACED: Mapping[str, tuple[Effect, ...]] = {
    "joint_friction": (Effect("joint_friction", {"coulomb": 20.0}, 2),),
    "structure": (Effect("storey_stiffness", {"e": -0.1}, 1), Effect("floor_mass", {"dm": 9.0}, 3)),
    "floor_sensors": (Effect("sensor_lag", {"tau": 0.004}, 2), Effect("sensor_leakage", {"tau": 0.3}, 1)),
}
SIGNALS = (
    *(f"acceleration_{j}" for j in (1, 2, 3)), "displacement_2", "velocity_3", "drift_2", "stroke", "force",
    "true_force", "current",
)  # fmt: skip


def frame(law: str, more: Mapping[str, float] = LAG, placed: tuple[Effect, ...] = ()) -> Model:
    weights = random_network(4, (6,)).text() if law == "narx" else None
    return Model(
        law, dict(LAWS[law][0]), (*effects_from(more), *placed), "frame", dyke1996(), weights=weights
    )


def run(task: Task, load: Any, option: str, actions: Array) -> tuple[Array, Array, Array]:
    task.reset([0], [np.random.default_rng(0)], {option: load})
    steps = [task.step(action[None]) for action in actions]
    columns = (np.array([getattr(s, name)[0] for s in steps]) for name in ("observation", "reward", "info"))
    seen, reward, info = (c.astype(np.float64) for c in columns)
    return seen, reward, info


def actions(n: int, dampers: int = 1) -> Array:
    return np.repeat(np.random.default_rng(4).uniform(-1, 1, (n // 5 + 1, dampers)), 5, axis=0)[:n]


def agree(
    make: Callable[[str], Task], load: Any, option: str, given: Array, rewarded: float = REWARDED
) -> None:
    engine, chain = (run(make(name), load, option, given) for name in ("mujoco", "chain"))
    apart = [off(chain[0][:, k], engine[0][:, k]) for k in range(engine[0].shape[1])]
    assert max(apart) < OBSERVED, apart
    assert off(chain[1], engine[1]) < rewarded
    for found, wanted in zip(chain[2].T, engine[2].T, strict=True):
        assert off(found, wanted) < rewarded if wanted.any() else not found.any()


def agree_in_the_frame(model: Any, command_max: float, rewarded: float = REWARDED, **arguments: Any) -> None:
    own = {"model": model, "command_max": command_max, "timestep": FINE, "signals": SIGNALS, **arguments}
    # energy among the weights: every part of the reward is compared.
    own["reward"] = FrameReward(energy=0.3, power=0.1, drift_peak=2.0, acceleration_peak=2.0)
    many = len(arguments.get("damper_between", [0]))
    agree(lambda engine: FrameTask(1, engine=engine, **own), MOTION, "motion", actions(190, many), rewarded)


@pytest.mark.parametrize("law", LAWS)
def test_every_law_in_the_frame(law: str) -> None:
    agree_in_the_frame(frame(law), LAWS[law][1])


@pytest.mark.parametrize("effect", EFFECTS)
def test_effects_of_the_damper(effect: str) -> None:
    agree_in_the_frame(frame("bouc_wen", {**LAG, **EFFECTS[effect]}), 1.0)


@pytest.mark.parametrize("effect", PLACED)
def test_effects_of_the_structure(effect: str) -> None:
    agree_in_the_frame(frame("bouc_wen", LAG, PLACED[effect]), 1.0)


def test_commands_that_act_at_once() -> None:
    """Where a force jumps the engine's acceleration is the mean of both sides, the chain's that behind the jump: the
    rewards for peaks differ by that sample, whatever the step."""
    agree_in_the_frame(frame("bouc_wen", {}), 1.0, rewarded=0.02)


def test_several_dampers() -> None:
    agree_in_the_frame([frame("bouc_wen"), frame("bingham")], 1.0, damper_between=[(0, 1), (1, 3)])


def test_the_cable() -> None:
    """The damper sticks: the engine, of first order there, takes small steps to get to accelerations beside it."""
    load = AmbientLoads(duration=0.6).draw(np.random.default_rng(0), 12.65)
    steps = {"mujoco": 5e-6, "chain": 2e-5}
    signals = (
        "acceleration_1",
        "acceleration_2",
        "displacement_2",
        "velocity_2",
        "stroke",
        "force",
        "current",
    )

    def make(engine: str) -> CableTask:
        return CableTask(1, engine=engine, timestep=steps[engine], signals=signals)

    agree(make, load, "load", actions(100))


@pytest.mark.parametrize("floor", [1, 2])
def test_the_frame_agrees_with_scipy(floor: int) -> None:
    """Held commands, a motion that changes within the control period; peaks at the engine's steps."""
    motion, n = kanai_tajimi(3, duration=7.0, pga=5.0).compressed(5.0), 270
    signals = ("displacement_3", "acceleration_1", "force", "current")
    u = np.repeat(np.random.default_rng(4).choice([0.0, 0.7, 2.25], n // 6 + 1), 6)[:n]
    wanted = solve(lambda t: float(np.interp(t, motion.time, motion.acceleration)), u, 5e-3, 5e-4, floor)
    columns = (wanted["displacement"][:, 2], wanted["acceleration"][:, 0], wanted["force"], wanted["current"])
    drift = np.diff(wanted["displacement"][:-1], axis=1, prepend=0.0)
    for engine, observed in (("mujoco", 0.01), ("chain", OBSERVED)):
        task = FrameTask(
            1, engine=engine, timestep=5e-4, damper_between=(floor - 1, floor), signals=signals,
            action_in_observation=False,
        )  # fmt: skip
        seen, _, info = run(task, motion, "motion", (2 * u / 2.25 - 1)[:, None])
        for k, (scale, true) in enumerate(zip(task.observer.scales, columns, strict=True)):
            assert off(seen[:, k] * scale, true[10::10]) < observed, (engine, signals[k])
        last = dict(zip(task.score.NAMES, info[-1], strict=True))
        assert last["peak_drift"] == pytest.approx(np.abs(drift).max(), rel=OBSERVED)
        assert last["peak_acceleration"] == pytest.approx(np.abs(wanted["acceleration"][:-1]).max(), rel=REWARDED)
        assert last["dissipated_energy"] == pytest.approx(wanted["energy"][-1], rel=OBSERVED)
        assert last["mean_current"] == pytest.approx(np.abs(wanted["current"][:-1]).mean(), rel=OBSERVED)


def test_peaks_of_a_run_are_scipys() -> None:
    """After jumps of the command the first floor's acceleration peaks between whole milliseconds, and far from the
    controller's own 5 ms."""
    motion, n = kanai_tajimi(3, duration=7.0, pga=5.0).compressed(5.0), 270
    u = np.repeat(np.random.default_rng(4).choice([0.0, 0.7, 2.25], n // 6 + 1), 6)[:n]
    wanted = solve(lambda t: float(np.interp(t, motion.time, motion.acceleration)), u, 5e-3, 2.5e-4)
    until = slice(round(motion.duration / 2.5e-4) + 1)
    drift = np.diff(wanted["displacement"], axis=1, prepend=0.0)[until]
    true = [np.abs(x[until]).max(axis=0) for x in (wanted["acceleration"], wanted["force"])]

    def off_peaks(run: FrameRun) -> float:
        peaks = [np.abs(x).max(axis=0) for x in (run.drift, run.acceleration, run.force)]
        ratios = [one / other for one, other in zip(peaks, [np.abs(drift).max(axis=0), *true], strict=True)]
        return float(np.abs(np.hstack(ratios) - 1).max())

    controller, benches = Replay(u, 5e-3, "given"), [FrameBench(frame_model(), engine=e) for e in ("mujoco", "chain")]
    for bench in benches:
        assert off_peaks(replace(bench, compression=1.0).driven(controller, motion, 1.0)) < 0.005
    assert off_peaks(run_frame(frame_model(), motion, controller)) < 0.02


@pytest.mark.parametrize("engine", ["mujoco", "chain"])
def test_peaks_of_two_dampers_are_those_of_finer_steps(engine: str) -> None:
    class Both(Replay):
        def command(self, t: float, y: Mapping[str, float]) -> Any:
            k = round(t / self.period)
            return [2.25 * (k // 37 % 2), 1.0 if k // 53 % 2 else 0.2]

    model = replace(frame_model(), structure=replace(dyke1996(), others=((1, 2),)))
    bench = FrameBench(model, engine=engine, compression=1.0)
    controller = Both(np.zeros(1), 1e-3, "both")
    usual, fine = (replace(bench, timestep=h).driven(controller, MOTION, 1.0) for h in (2.5e-4, 2.5e-5))
    for one, other in zip((usual.acceleration, usual.force), (fine.acceleration, fine.force), strict=True):
        np.testing.assert_allclose(np.abs(one).max(axis=0), np.abs(other).max(axis=0), rtol=0.003)


@pytest.mark.parametrize(
    "given", [{"engine": "mujoco"}, {"engine": "chain"}, {"engine": "chain", "randomise": {"mass": (0.99999, 1.00001)}}]
)
def test_noise_hangs_on_the_seed(given: dict[str, Any]) -> None:
    """By rows: of two seeds, and of the first one again."""

    def read(level: float) -> Array:
        task = FrameTask(3, noise={"force": level}, signals=["force"], action_in_observation=False, **given)
        # Rows may be numbers of NumPy's, as `np.flatnonzero` gives them.
        task.reset([*np.arange(3)], [np.random.default_rng(k) for k in (0, 7, 0)], {"motion": MOTION})
        rows = [task.step(np.zeros((3, 1))).observation[:, 0] * task.observer.scales[0] for _ in range(60)]
        return np.array(rows).T

    one, other, again = read(2.0) - read(0.0)
    np.testing.assert_array_equal(one, again)
    assert [one.std(), other.std()] == pytest.approx([2.0, 2.0], rel=0.25)
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.5
