"""Reward of a learner and observations of its critic, from a base controller's run under the same load.

    r_t = scale sum_k share_k R_k / p (b_kt^p - c_kt^p) / sum_t b_kt^p

c_kt is the size of criterion k (`World.criteria`) in a control period, b_kt that of the base controller under the same
load at the same time, R_k the base's measure over the uncontrolled one. The sum of the second part over an episode is
the score of the base times its relative change, to first order, for RMS values (p = 2) exactly so and for peaks with a
p-norm in their place; the first part does not depend on what the learner does and is there to lower the variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from mrdamp.envs.task import Task
from mrdamp.train.pool import Known
from mrdamp.train.worlds import World

Single = NDArray[np.float32]

_LIMIT = 20.0  # that the critic's numbers are cut off at
_KNEE = 1.1  # of a criterion over the base's peak, from where on its power grows along the tangent
_AHEAD = (8, 24)  # control periods ahead that the critic is shown the base's measurements at
_WINDOWS = (8, 32, 128)  # control periods: ends of the windows that the base's costs to come are summed over
_FAR = 1 << 30  # to the end
_SHORT = 200.0  # control periods: time left that the critic can tell from more


class Lessons(VecEnvWrapper):
    """Observations (n, k) become (n, k + f), the f last for the critic alone; rewards become those above.

    runs: of the pool that the rows' loads come from, whose names are places in it. price: of the mean current over its
    largest, in the score's unit; scale: of the rewards. privileged: True if the critic observes more than
    the actor.
    """

    def __init__(
        self, venv: VecEnv, world: World, task: Task, runs: Sequence[Known], exponent: float, price: float = 0.0,
        scale: float = 1000.0, privileged: bool = True,
    ) -> None:  # fmt: skip
        self._world, self._task, self._p, self._scale = world, task, exponent, scale
        self._price, self._privileged = price * scale, privileged
        self.renew(runs)
        rms = np.array([np.sqrt(np.mean(np.square(run.measured, dtype=np.float64), axis=0)) for run in runs])
        self._all = np.maximum(np.sqrt(np.mean(rms**2, axis=0)), 1e-12)
        self._own = np.maximum(rms, 1e-3 * self._all)
        self._size = np.log(np.mean(rms / self._all, axis=1))
        self._load: NDArray[np.intp] = np.zeros(venv.num_envs, dtype=np.intp)
        self._t: NDArray[np.intp] = np.zeros(venv.num_envs, dtype=np.intp)
        names = len(task.rows.names)
        self.extra = (3 + len(_AHEAD)) * names + len(_WINDOWS) + 3 if privileged else 0
        width, limit = venv.observation_space.shape[0], float(venv.observation_space.high.max())
        super().__init__(venv, observation_space=Box(-limit, limit, (width + self.extra,), np.float32))

    def renew(self, runs: Sequence[Known]) -> None:
        """Another base controller from now on, under the same loads: a mean of powers is the mean of ratios only near
        the base."""
        shares = self._world.shares
        self._peaks = np.array([np.maximum(run.criteria.max(axis=0), 1e-12) for run in runs])
        powers = [(run.criteria / peak) ** self._p for run, peak in zip(runs, self._peaks, strict=True)]
        ratios = np.array([run.ratios for run in runs])
        sums = np.array([power.sum(axis=0) for power in powers])
        self._factors = self._scale / self._p * shares * ratios / sums
        self._steps = np.array([len(run.criteria) for run in runs])
        # All runs one after the other, T + 1 numbers each: row t of run k stands at first[k] + t.
        self._first = np.concatenate([[0], np.cumsum(self._steps + 1)[:-1]])
        costs = [power @ factor for power, factor in zip(powers, self._factors, strict=True)]
        self._costs = np.concatenate([[*cost, 0.0] for cost in costs])
        self._sums = np.concatenate([[0.0, *np.cumsum(cost)] for cost in costs])
        self._measured = np.concatenate([run.measured for run in runs])

    def reset(self) -> Any:
        observation = self.venv.reset()
        self._begin(range(self.num_envs))
        return self._with(observation)

    def step_wait(self) -> Any:
        observation, _, done, infos = self.venv.step_wait()
        period = self._task.happened
        sizes = self._world.sizes_of(period) / self._peaks[self._load]
        # Straight on behind _KNEE: one episode that goes wrong would drown a batch.
        within = np.minimum(sizes, _KNEE)
        powers = within**self._p + self._p * _KNEE ** (self._p - 1) * (sizes - within)
        cost = (powers * self._factors[self._load]).sum(axis=1)
        base = self._costs[self._first[self._load] + self._t]
        reward = base - cost
        if self._price:
            reward -= self._price * self._world.current_of(period) / self._task.rows.steps
        self._t += 1
        over = np.flatnonzero(done).tolist()
        for (
            row
        ) in over:  # nothing comes after the load: what is left is worth nothing, and is not to be estimated
            last = infos[row]["terminal_observation"]
            infos[row]["terminal_observation"] = np.concatenate([last, np.zeros(self.extra, np.float32)])
            infos[row]["TimeLimit.truncated"] = False
        self._begin(over)
        return self._with(observation), reward.astype(np.float32), done, infos

    def _begin(self, rows: Sequence[int]) -> None:
        for row in rows:
            self._load[row] = int(self.unwrapped.reset_infos[row][self._world.option])
            self._t[row] = 0

    def _with(self, observation: Any) -> Any:
        if not self._privileged:
            return observation
        now, own, first = self._task.measured, self._own[self._load], self._first[self._load]
        last = self._steps[self._load]
        at = [first + np.minimum(self._t + ahead, last) for ahead in (0, *_AHEAD)]
        parts = [now / self._all, now / own, (now - self._measured[at[0]]) / own]
        parts += [self._measured[k] / own for k in at[1:]]
        ends = [self._sums[first + np.minimum(self._t + w, last)] for w in (0, *_WINDOWS, _FAR)]
        parts += [np.diff(np.array(ends), axis=0).T]
        parts += [np.minimum((last - self._t) / _SHORT, 1.0)[:, None], self._size[self._load][:, None]]
        privileged = np.clip(np.concatenate(parts, axis=1), -_LIMIT, _LIMIT).astype(np.float32)
        return np.concatenate([observation, privileged], axis=1)
