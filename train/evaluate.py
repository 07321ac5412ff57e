"""A policy's figures on given loads, all of them at once as the rows of one task."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.control.policy import Policy
from mrdamp.envs.task import Task
from mrdamp.train.worlds import World

Array = NDArray[np.float64]


class Judge:
    """Runs policies on loads. task: as many rows as there are loads, its observer that of the policies."""

    def __init__(self, world: World, loads: Sequence[Any]) -> None:
        self.world, self.loads = world, loads
        self.task: Task = world.judging(len(loads))
        self._names = list(self.task.score.NAMES)

    def __call__(self, policy: Policy | float) -> dict[str, Array]:
        """(loads,) for each of the world's measures; a number is a constant command."""
        task, n = self.task, len(self.loads)
        rngs = [np.random.default_rng(k) for k in range(n)]
        seen = np.concatenate(
            [task.reset([k], rngs, {self.world.option: load})[0] for k, load in enumerate(self.loads)]
        )
        largest = float(task.command_max[0])
        signals = task.observer.signals
        column = signals.index("force") if "force" in signals else None
        alive = np.ones(n, dtype=np.bool_)
        found = {name: np.zeros(n) for name in self.world.measures}
        while alive.any():
            if isinstance(policy, Policy):
                force = 0.0 if column is None else task.observer.scales[column] * seen[:, column].astype(np.float64)
                command = policy.commands(seen, force)
            else:
                command = np.full(n, policy)
            step = task.step(2.0 * command[:, None] / largest - 1.0)
            for row in np.flatnonzero(step.over & alive):
                for name in found:
                    found[name][row] = step.info[row, self._names.index(name)]
            alive &= ~step.over
            seen = step.observation
        return found
