"""Trainings by stable-baselines3: wrappers, export against its own predictions, resume; the reward that a learner is
paid against the score that a policy is judged by."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
pytest.importorskip("sb3_contrib", reason="sb3-contrib is not installed")

import sb3_contrib
import stable_baselines3
import torch

from mrdamp.control.force_levels import ForceLevels
from mrdamp.control.observe import Observer
from mrdamp.control.policy import Network, Policy
from mrdamp.envs.frame import FrameTask
from mrdamp.envs.sb3 import PlantVecEnv
from mrdamp.envs.task import Task
from mrdamp.simulation.roads import iso8608
from mrdamp.train.asymmetric import POLICIES, memory, network
from mrdamp.train.gradient import GradientRun
from mrdamp.train.learn import train
from mrdamp.train.lessons import Drawn, Known, Lessons, PolicyAction, Whitened, known
from mrdamp.train.settings import Options, settings
from mrdamp.train.worlds import World, forces, world

pytestmark = pytest.mark.usefixtures("few_validation_motions")
PERIOD = 4e-3


def frames(n: int = 2) -> tuple[FrameTask, PlantVecEnv]:
    task = FrameTask(n, period=PERIOD, timestep=1e-3, duration=0.4)
    venv = PlantVecEnv(task)
    venv.seed(3)
    return task, venv


def constant(task: Task, action: float, **named: Any) -> Policy:
    size = task.observer.size
    net, fresh = Network(((np.zeros((1, size)), np.array([action])),)), Observer.from_dict(task.observer.to_dict())
    return Policy("p", task.rows.period, fresh, np.eye(size), net, float(task.command_max[0]), **named)


LEVELS = ForceLevels((0.0, 2.25), (100.0, 1100.0))


def test_actions_become_the_commands_of_the_policy() -> None:
    task, venv = frames()
    wrapped = PolicyAction(venv, task, constant(task, 0.0, levels=LEVELS))
    seen = wrapped.reset()
    column = task.observer.signals.index("force")
    for action in (0.5, -0.5, 0.9, -0.05):
        force = seen[:, column] * task.observer.scales[column]
        seen, _, _, _ = wrapped.step(np.full((2, 1), action))
        wanted = action * 1100.0
        expected = [
            2.25 * (abs(wanted) - 100) / 1000 if wanted * f > 0 and abs(wanted) > 100 else 0.0 for f in force
        ]
        assert seen[:, task.observer.width - 1] * 2.25 == pytest.approx(expected, abs=1e-5)


def test_a_learner_corrects_its_teacher_by_its_reach() -> None:
    task, _ = frames()
    rng = np.random.default_rng(0)
    teacher = 0.1 * rng.standard_normal(task.observer.size)
    policy = constant(task, 0.0, levels=LEVELS, teacher=teacher, reach=0.25)
    seen = rng.standard_normal((9, task.observer.size)).astype(np.float32)
    force, actions = forces(task, seen), rng.uniform(-1, 1, 9)
    wanted = 1100.0 * np.clip(seen.astype(float) @ teacher + 0.25 * actions, -1, 1)
    assert policy.driven(actions, seen, force) == pytest.approx(LEVELS.command(wanted, force))
    assert np.abs(policy.driven(actions, seen, force) - policy.commands(seen, force)).max() > 0.05


def test_whitened_observations_are_what_they_say() -> None:
    task, venv = frames()
    matrix = np.random.default_rng(0).standard_normal((3, task.observer.size)).astype(np.float32)
    wrapped = Whitened(venv, matrix)
    _, plain = frames()
    assert wrapped.reset() == pytest.approx(plain.reset() @ matrix.T)
    ended = 0
    while not ended:
        seen, _, done, infos = wrapped.step(np.zeros((2, 1), np.float32))
        raw, _, _, raw_infos = plain.step(np.zeros((2, 1), np.float32))
        for row in np.flatnonzero(done):
            last = matrix @ raw_infos[row]["terminal_observation"]
            assert infos[row]["terminal_observation"] == pytest.approx(last, rel=1e-4, abs=1e-6)
            ended += 1
        assert seen == pytest.approx(raw @ matrix.T, rel=1e-4, abs=1e-6)


#: Short rollouts of each learner.
SHORT = {"n_steps": 8, "batch_size": 8}
LEARNERS: dict[str, dict[str, int]] = {
    "a2c": {"n_steps": 8}, "ddpg": {}, "ppo": SHORT, "recurrent": SHORT, "sac": {}, "td3": {}
}  # fmt: skip


@pytest.mark.parametrize("algorithm", LEARNERS)
def test_the_actor_does_not_see_what_the_critic_is_told(algorithm: str) -> None:
    _, venv = frames()
    size = venv.observation_space.shape[0]
    front, recurrent = size - 2, algorithm == "recurrent"
    maker: Any = sb3_contrib.RecurrentPPO if recurrent else getattr(stable_baselines3, algorithm.upper())
    kwargs = {"front": front, **({"lstm_hidden_size": 8} if recurrent else {})}
    model = maker(POLICIES[algorithm], venv, seed=1, device="cpu", policy_kwargs=kwargs, **LEARNERS[algorithm])
    one = np.random.default_rng(0).standard_normal((1, size)).astype(np.float32)
    other, moved = one.copy(), one.copy()
    other[:, front:] = 5.0
    moved[:, 0] += 1.0

    def acts(seen: Any) -> float:
        return float(model.predict(seen, deterministic=True)[0][0, 0])

    def worth(seen: Any) -> float:
        tensor = model.policy.obs_to_tensor(seen)[0]
        with torch.no_grad():
            if recurrent:
                state = tuple(torch.zeros(model.policy.lstm_hidden_state_shape) for _ in range(2))
                return float(model.policy.predict_values(tensor, state, torch.zeros(1)))
            if hasattr(model.policy, "predict_values"):
                return float(model.policy.predict_values(tensor))
            return float(model.policy.critic(tensor, torch.zeros(1, 1))[0])

    assert acts(one) == acts(other) != acts(moved)
    assert worth(one) != worth(other)
    if not recurrent:
        exported = network(model.policy)(one[:, :front].astype(np.float64))
        assert float(exported[0, 0]) == pytest.approx(acts(one), abs=2e-6)


def test_a_memory_is_exported_with_its_past() -> None:
    task, venv = frames()
    size = task.observer.size
    kwargs = {"lstm_hidden_size": 6, "net_arch": {"pi": [5], "vf": [4]}, "front": size}
    model = sb3_contrib.RecurrentPPO(
        POLICIES["recurrent"], venv, seed=1, n_steps=8, batch_size=8, policy_kwargs=kwargs, device="cpu"
    )
    policy = Policy(
        "p", PERIOD, Observer.from_dict(task.observer.to_dict()), np.eye(size), network(model.policy), 2.0,
        memory=memory(model.policy),
    )  # fmt: skip
    policy = Policy.from_dict(policy.to_dict())
    seen = np.random.default_rng(0).standard_normal((12, 3, size)).astype(np.float32)
    for _ in range(2):  # the second time from a fresh start
        state, first = None, True
        policy.reset()
        found = []
        for row in seen:
            action, state = model.predict(row, state, np.full(3, first), deterministic=True)
            command = policy.commands(row)
            assert command == pytest.approx(np.clip(action[:, 0], -1, 1) + 1, abs=1e-5)
            found.append(command)
            first = False
        assert np.ptp(found) > 1e-3
    again = policy.commands(seen[0])
    assert np.abs(again - found[0]).max() > 1e-5  # it has not forgotten


#: What makes a training of stable-baselines3 take a second or two.
SMALL = (
    "n_envs=4", "pool=6", f"env_kwargs.period={PERIOD}", "env_kwargs.duration=0.4", "normalize=false",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "timesteps", "own"),
    [
        ("ppo", 512, (*SMALL, "n_steps=32", "batch_size=64", "freeze=128", "renew=200")),
        ("recurrent", 512, (*SMALL, "n_steps=16", "batch_size=32", "freeze=0")),
        ("sac", 512, (*SMALL, "learning_starts=64", "buffer_size=1000")),
        ("td3", 512, (*SMALL, "learning_starts=64", "buffer_size=1000")),
        ("adjoint", 30_000, ("loads=2", "policy_kwargs.net_arch=[4]", "env_kwargs.timestep=0.001")),
    ],
)
def test_what_is_stopped_goes_on_as_if_it_had_not(
    algorithm: str, timesteps: int, own: tuple[str, ...], tmp_path: Path
) -> None:
    """The same scores to the last bit, whose weights, loads, noise and memories are the same therefore. It begins at
    its teacher, and what is kept is no worse."""
    options = Options(algorithm=algorithm, timesteps=timesteps, overrides=own, evaluations=4)

    def stop(what: str, share: float) -> None:
        if share > 0.7:
            raise KeyboardInterrupt

    whole = train(options, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        train(options, tmp_path / "stopped", stop)
    assert len(json.loads((tmp_path / "stopped" / "state.json").read_text())["curve"]) < len(whole.curve)
    assert train(options, tmp_path / "stopped").curve == whole.curve
    policies = [(tmp_path / folder / "policy.json").read_text() for folder in ("whole", "stopped")]
    assert policies[0] == policies[1]
    assert whole.best["score"] <= whole.curve[0]["score"] != whole.curve[-1]["score"]
    if algorithm != "adjoint":
        base = GradientRun(options, settings(options), tmp_path / "other", 4)
        base.model = None
        drift = float(base.judge(base.policy())["drift_ratio"].mean())
        assert whole.curve[0]["drift_ratio"] == pytest.approx(drift, rel=2e-3)


FRAME, CABLE, CAR = "mrdamp/Frame-v0", "mrdamp/Cable-v0", "mrdamp/QuarterCar-v0"
PLAIN_KWARGS: dict[str, dict[str, Any]] = {
    FRAME: {"period": 2e-3, "duration": 1.5},
    CABLE: {"timestep": 5e-4},
}
#: Shares of the largest command: of the base, and of another that is near enough for a linear law.
BASE, OTHER = 0.3, 0.33


def pooled(environment: str, count: int = 3) -> tuple[World, Task, list[Known]]:
    chosen = world(environment, PLAIN_KWARGS.get(environment, {}))
    rng = np.random.default_rng(1)
    roads = [iso8608("C", 15.0, 2.0, seed) for seed in range(count)]
    loads = roads if environment == CAR else chosen.structure.some(rng, count)
    task = chosen.task(2)
    runs = known(chosen, task, loads, constant(task, 2 * BASE - 1))
    return chosen, chosen.task(2, "chain", Drawn([run.load for run in runs])), runs


def paid(lessons: Lessons, share: float, runs: list[Known]) -> dict[int, float]:
    """The sum of an episode's rewards at a constant command, by load."""
    lessons.seed(4)
    lessons.reset()
    found: dict[int, float] = {}
    sums = np.zeros(lessons.num_envs)
    while len(found) < len(runs):
        before = lessons._load.copy()
        _, reward, done, infos = lessons.step(np.full((lessons.num_envs, 1), 2 * share - 1))
        sums += reward
        for row in np.flatnonzero(done):
            assert not infos[row]["TimeLimit.truncated"]
            assert len(infos[row]["terminal_observation"]) == lessons.observation_space.shape[0]
            found[int(before[row])], sums[row] = sums[row], 0.0
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("environment", "exponent"), [(FRAME, 16.0), (FRAME, 8.0), (CABLE, 2.0), (CAR, 2.0)])
def test_an_episode_pays_what_the_score_gains(environment: str, exponent: float) -> None:
    """For RMS values to first order, for peaks through their p-norm: the longer the power, the nearer."""
    chosen, task, runs = pooled(environment)
    lessons = Lessons(PlantVecEnv(task), chosen, task, runs, exponent, scale=1.0)
    assert all(abs(v) < 2e-5 for v in paid(lessons, BASE, runs).values())
    gains = paid(lessons, OTHER, runs)
    other = known(chosen, chosen.task(2), [r.load for r in runs], constant(task, 2 * OTHER - 1))
    shares = chosen.shares
    for k, (run, moved) in enumerate(zip(runs, other, strict=True)):
        if chosen.kind.exponent == 2.0:
            expected = float((run.ratios - moved.ratios) @ shares)
        else:
            norms = [(r.criteria**exponent).sum(axis=0) ** (1 / exponent) for r in (run, moved)]
            expected = float((run.ratios * (1 - norms[1] / norms[0])) @ shares)
        assert gains[k] == pytest.approx(expected, rel=0.25, abs=1e-5)
        assert abs(expected) > 1e-5


def test_a_renewed_base_is_worth_nothing_more_and_the_current_has_its_price() -> None:
    chosen, task, runs = pooled(FRAME, 2)
    lessons = Lessons(PlantVecEnv(task), chosen, task, runs, 8.0, scale=1.0)
    free = paid(lessons, OTHER, runs)
    dear = paid(Lessons(PlantVecEnv(task), chosen, task, runs, 8.0, price=0.5, scale=1.0), OTHER, runs)
    assert [free[k] - dear[k] for k in free] == pytest.approx([0.5 * OTHER] * len(runs), rel=0.02)
    lessons.renew(known(chosen, chosen.task(2), [r.load for r in runs], constant(task, 2 * OTHER - 1)))
    assert all(abs(v) < 2e-5 < abs(free[k]) for k, v in paid(lessons, OTHER, runs).items())
