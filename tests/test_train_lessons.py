"""The reward that a learner is paid, and what its critic is told, against the score that a policy is judged by."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")

from mrdamp.control.networks import Network
from mrdamp.control.observe import Observer
from mrdamp.control.policy import Policy
from mrdamp.envs.sb3 import PlantVecEnv
from mrdamp.envs.task import Task
from mrdamp.simulation.roads import iso8608
from mrdamp.train.lessons import Drawn, Known, Lessons, known
from mrdamp.train.worlds import World, world

FRAME, CABLE, CAR = "mrdamp/Frame-v0", "mrdamp/Cable-v0", "mrdamp/QuarterCar-v0"
PLAIN: dict[str, dict[str, Any]] = {
    FRAME: {"period": 2e-3, "duration": 1.5},
    CABLE: {"timestep": 5e-4},
    CAR: {},
}
#: Shares of the largest command: of the base, and of another that is near enough for a linear law.
BASE, OTHER = 0.3, 0.33


def constant(task: Task, share: float) -> Policy:
    """A share of the largest command, whatever is seen."""
    size = task.observer.size
    net = Network(((np.zeros((1, size)), np.array([2.0 * share - 1.0])),))
    fresh = Observer.from_dict(task.observer.to_dict())
    return Policy("c", task.rows.period, fresh, np.eye(size), net, float(task.command_max[0]))


def pooled(environment: str, count: int = 3) -> tuple[World, Task, list[Known]]:
    chosen = world(environment, PLAIN[environment])
    rng = np.random.default_rng(1)
    roads = [iso8608("C", 15.0, 2.0, seed) for seed in range(count)]
    loads = roads if environment == CAR else chosen.structure.some(rng, count)
    task = chosen.task(2)
    runs = known(chosen, task, loads, constant(task, BASE))
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
    other = known(chosen, chosen.task(2), [r.load for r in runs], constant(task, OTHER))
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
    chosen, task, runs = pooled(FRAME)
    lessons = Lessons(PlantVecEnv(task), chosen, task, runs, 8.0, scale=1.0)
    free = paid(lessons, OTHER, runs)
    dear = paid(Lessons(PlantVecEnv(task), chosen, task, runs, 8.0, price=0.5, scale=1.0), OTHER, runs)
    assert [free[k] - dear[k] for k in free] == pytest.approx([0.5 * OTHER] * len(runs), rel=0.02)
    lessons.renew(known(chosen, chosen.task(2), [r.load for r in runs], constant(task, OTHER)))
    assert all(abs(v) < 2e-5 < abs(free[k]) for k, v in paid(lessons, OTHER, runs).items())


def test_what_goes_wrong_costs_along_the_tangent() -> None:
    chosen, task, runs = pooled(FRAME)
    p, knee = 16.0, 1.1
    found = paid(Lessons(PlantVecEnv(task), chosen, task, runs, p, scale=1.0), 0.0, runs)
    released = known(chosen, chosen.task(2), [r.load for r in runs], constant(task, 0.0))
    shares, worse = chosen.shares, 0
    for k, (run, moved) in enumerate(zip(runs, released, strict=True)):
        x, b = (r.criteria / run.criteria.max(axis=0) for r in (moved, run))
        straight = np.where(x < knee, x**p, knee**p + p * knee ** (p - 1) * (x - knee))
        share = shares * run.ratios / p / (b**p).sum(axis=0)
        assert found[k] == pytest.approx(float(((b**p - straight) * share).sum()), rel=1e-3)
        worse += bool((x > knee).any())
    assert worse


def test_the_critic_is_told_of_base_time_and_size() -> None:
    chosen, task, runs = pooled(FRAME)
    lessons = Lessons(PlantVecEnv(task), chosen, task, runs, 8.0)
    width, names = task.observer.size, len(task.rows.names)
    seen = lessons.reset()
    off = slice(width + 2 * names, width + 3 * names)
    left = width + lessons.extra - 2
    for t in range(1, 60):
        assert seen.shape == (2, width + lessons.extra)
        assert np.abs(seen[:, off]).max() < 1e-2  # on the base's own way
        seen, _, _, _ = lessons.step(np.full((2, 1), 2 * BASE - 1))
        length = np.array([len(runs[k].criteria) for k in lessons._load])
        assert seen[:, left] == pytest.approx(np.minimum((length - t) / 200, 1), abs=1e-6)
    for _ in range(40):
        seen, _, _, _ = lessons.step(np.ones((2, 1)))
    assert np.abs(seen[:, off]).max() > 1e-2
    sizes = {int(k): float(s) for k, s in zip(lessons._load, seen[:, -1], strict=True)}
    order = sorted(sizes, key=lambda k: float(runs[k].criteria.max()))
    assert [sizes[k] for k in order] == sorted(sizes.values())
