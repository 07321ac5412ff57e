"""Episodes of many rows at once: what a policy, or a command, comes to under given loads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.control.policy import Policy
from mrdamp.envs.task import Task
from mrdamp.errors import InputError
from mrdamp.model.core import Array
from mrdamp.train.worlds import World

Act = Callable[[NDArray[np.float32]], Array]


def begun(task: Task, loads: Sequence[Any]) -> NDArray[np.float32]:
    """Observations (n, size) at the start of the n rows of a task, row k under loads[k]."""
    rngs = [np.random.default_rng(k) for k in range(task.n)]
    return np.concatenate([task.reset([k], rngs, {task.structure.option: load})[0] for k, load in enumerate(loads)])


def episodes(task: Task, world: World, loads: Sequence[Any], act: Act) -> tuple[dict[str, Array], int]:
    """The world's measures (n,) of the n rows of a task, row k under loads[k], and the control periods of all rows.

    act: commands (n,), or (n, dampers), A or V, from observations (n, size).
    """
    observation = begun(task, loads)
    alive, periods = np.ones(task.n, dtype=np.bool_), 0
    columns = [task.score.NAMES.index(name) for name in world.measures]
    found = np.zeros((task.n, len(columns)))
    while alive.any():
        step = task.drive(act(observation))
        ended = step.over & alive
        found[ended] = step.info[ended][:, columns]
        periods += int(alive.sum())
        alive &= ~step.over
        observation = step.observation
    return dict(zip(world.measures, found.T, strict=True)), periods


def forces(task: Task, observation: NDArray[np.float32]) -> Array:
    """(n,) N, the damper's, as observations (n, size) hold it; zero where they do not."""
    return task.observer.measured(observation, "force")


class Judge:
    """Runs policies on loads, all at once. worlds: one or several, that take the loads in turn; their observer must be
    that of the policies. Raises InputError where a world has no load."""

    def __init__(self, worlds: World | Sequence[World], loads: Sequence[Any]) -> None:
        several = list(worlds) if isinstance(worlds, Sequence) else [worlds]
        if len(several) > len(loads):
            raise InputError(f"{len(several)} models for {len(loads)} loads; allowed: a load each at least")
        parts = [list(loads[k :: len(several)]) for k in range(len(several))]
        self._parts = [(w, part, w.judging(len(part))) for w, part in zip(several, parts, strict=True)]

    def __call__(self, policy: Policy | float) -> dict[str, Array]:
        """(loads,) for each of the world's measures, world by world; a number is a constant command."""
        found = [self._one(policy, *part) for part in self._parts]
        return {name: np.concatenate([f[name] for f in found]) for name in found[0]}

    def _one(
        self, policy: Policy | float, world: World, loads: Sequence[Any], task: Task
    ) -> dict[str, Array]:
        if isinstance(policy, Policy):
            policy.reset()

        def act(observation: NDArray[np.float32]) -> Array:
            if isinstance(policy, Policy):
                return policy.commands(observation, forces(task, observation))
            return np.full(len(observation), policy)

        return episodes(task, world, loads, act)[0]
