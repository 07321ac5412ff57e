"""Loads that a learner meets again and again, and what a base controller does under each of them.

An episode's reward varies more from load to load than from policy to policy. What is known of a load beforehand, how
the base controller fares under it, does not depend on the learner's actions: taking it off the reward, or giving it to
a critic, leaves the policy gradient as it is in the mean and takes most of its variance away (Mao, Venkatakrishnan,
Schwarzkopf and Alizadeh, Variance reduction for reinforcement learning in input-driven environments, ICLR 2019,
arXiv:1807.02264).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.control.policy import Policy
from mrdamp.envs.task import Task
from mrdamp.model.core import Array
from mrdamp.train.evaluate import forces
from mrdamp.train.worlds import World


@dataclass(frozen=True)
class Drawn:
    """A source of loads: one of `loads`, each as likely."""

    loads: Sequence[Any]

    def draw(self, rng: np.random.Generator, *about: Any) -> Any:
        return self.loads[int(rng.integers(len(self.loads)))]


@dataclass(frozen=True)
class Known:
    """A load and the base controller's run under it, T control periods.

    criteria: (T, k) sizes of the world's criteria in each; shares: (T,) of the current; ratios: (k,) the measures;
    measured: (T + 1, names), from the start on.
    """

    load: Any
    criteria: Array
    ratios: Array
    measured: NDArray[np.float32]


def known(world: World, task: Task, loads: Sequence[Any], policy: Policy) -> list[Known]:
    """A policy's runs under `loads` in the order given, on the rows of a task; they are named by their places."""
    named = [replace(load, name=str(k)) for k, load in enumerate(loads)]
    found: list[Known] = []
    for first in range(0, len(named), task.n):
        found += _runs(world, task, named[first : first + task.n], policy)
    return found


def _runs(world: World, task: Task, loads: Sequence[Any], policy: Policy) -> list[Known]:
    policy.reset()
    many, rngs = len(loads), [np.random.default_rng(k) for k in range(task.n)]
    given = [*loads, *[loads[0]] * (task.n - many)]
    observation = np.concatenate([task.reset([k], rngs, {world.option: load})[0] for k, load in enumerate(given)])
    columns = [task.score.NAMES.index(c.measure) for c in world.criteria]
    steps, longest = task.rows.steps[:many].copy(), int(task.rows.steps[:many].max())
    criteria = np.zeros((longest, many, len(columns)))
    measured = np.zeros((longest + 1, many, len(task.rows.names)), np.float32)
    ratios = np.zeros((many, len(columns)))
    measured[0] = task.measured[:many]
    for t in range(longest):
        step = task.drive(policy.commands(observation, forces(task, observation)))
        criteria[t] = world.sizes_of(task.happened)[:many]
        measured[t + 1] = task.measured[:many]
        last = steps == t + 1
        ratios[last] = step.info[:many][last][:, columns]
        observation = step.observation
    return [
        Known(load, criteria[: steps[k], k].copy(), ratios[k], measured[: steps[k] + 1, k].copy())
        for k, load in enumerate(loads)
    ]
