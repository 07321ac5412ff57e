"""Between a vector environment and a learner: actions as a policy has them, whitened observations, and lessons.

Lessons are the reward of the learner and observations of its critic, from a base controller's run under the same load.

    r_t = scale sum_k share_k R_k / p (b_kt^p - c_kt^p) / sum_t b_kt^p

c_kt is the size of criterion k (`World.criteria`) in a control period, b_kt that of the base controller under the same
load at the same time, R_k the base's measure over the uncontrolled one. The sum of the second part over an episode is
the score of the base times its relative change, to first order, for RMS values (p = 2) exactly so and for peaks with a
p-norm in their place; the first part does not depend on what the learner does and is there to lower the variance.

An episode's reward varies more from load to load than from policy to policy. What is known of a load beforehand, how
the base controller fares under it, does not depend on the learner's actions: taking it off the reward, or giving it to
a critic, leaves the policy gradient as it is in the mean and takes most of its variance away (Mao, Venkatakrishnan,
Schwarzkopf and Alizadeh, Variance reduction for reinforcement learning in input-driven environments, ICLR 2019,
arXiv:1807.02264). So the loads are of a pool that a learner meets again and again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from mrdamp.control.policy import Policy
from mrdamp.envs.structure import OF_DAMPERS
from mrdamp.envs.task import Task, begun
from mrdamp.model.core import Array
from mrdamp.train.worlds import World, forces

Single = NDArray[np.float32]

_LIMIT = 20.0  # that the critic's numbers are cut off at
_KNEE = 1.1  # of a criterion over the base's peak, from where on its power grows along the tangent
_AHEAD = (8, 24)  # control periods ahead that the critic is shown the base's measurements at
_WINDOWS = (8, 32, 128)  # control periods: ends of the windows that the base's costs to come are summed over
_FAR = 1 << 30  # to the end
_SHORT = 200.0  # control periods: time left that the critic can tell from more


@dataclass(frozen=True)
class Drawn:
    """A source of loads: one of `loads`, each as likely."""

    loads: Sequence[Any]

    def draw(self, rng: np.random.Generator, *about: Any) -> Any:
        return self.loads[int(rng.integers(len(self.loads)))]


@dataclass(frozen=True)
class Known:
    """A load and the base controller's run under it, T control periods.

    criteria: (T, k) sizes of the world's criteria in each; ratios: (k,) the measures; measured: (T + 1, names), from
    the start on.
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
    many = len(loads)
    observation = begun(task, [*loads, *[loads[0]] * (task.n - many)])
    columns = [task.score.NAMES.index(name) for name in world.criteria]
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


class PolicyAction(VecEnvWrapper):
    """Actions are those of a policy's network: `Policy.driven` makes the damper's command of them."""

    def __init__(self, venv: VecEnv, task: Task, policy: Policy) -> None:
        super().__init__(venv)
        self.task, self.policy = task, policy
        self._observation: NDArray[np.float32] = np.zeros((venv.num_envs, task.observer.size), np.float32)

    def reset(self) -> Any:
        self._observation = self.venv.reset()
        return self._observation

    def step_async(self, actions: NDArray[Any]) -> None:
        given = np.clip(np.asarray(actions, dtype=np.float64), -1.0, 1.0)
        each = given if self.policy.dampers > 1 else given.reshape(-1)
        command = self.policy.driven(each, self._observation, forces(self.task, self._observation))
        self.venv.step_async((2.0 * command / self.policy.command_max - 1.0).reshape(given.shape).astype(np.float32))

    def step_wait(self) -> Any:
        observation, reward, done, infos = self.venv.step_wait()
        self._observation = observation
        return observation, reward, done, infos


class Whitened(VecEnvWrapper):
    """Observations times a fixed matrix (k, size), see `mrdamp.train.run.whitening`."""

    def __init__(self, venv: VecEnv, matrix: NDArray[np.float32], limit: float = 1e3) -> None:
        super().__init__(venv, observation_space=Box(-limit, limit, (len(matrix),), np.float32))
        self.matrix = matrix

    def reset(self) -> Any:
        return self.venv.reset() @ self.matrix.T

    def step_wait(self) -> Any:
        observation, reward, done, infos = self.venv.step_wait()
        for row in np.flatnonzero(done).tolist():
            infos[row]["terminal_observation"] = self.matrix @ infos[row]["terminal_observation"]
        return observation @ self.matrix.T, reward, done, infos


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
            share = period[:, OF_DAMPERS.index("share") - len(OF_DAMPERS)]
            reward -= self._price * share / self._task.rows.steps
        self._t += 1
        over = np.flatnonzero(done).tolist()
        for row in over:  # nothing comes after the load: what is left is worth nothing, and is not to be estimated
            last = infos[row]["terminal_observation"]
            infos[row]["terminal_observation"] = np.concatenate([last, np.zeros(self.extra, np.float32)])
            infos[row]["TimeLimit.truncated"] = False
        self._begin(over)
        return self._with(observation), reward.astype(np.float32), done, infos

    def _begin(self, rows: Sequence[int]) -> None:
        for row in rows:
            self._load[row] = int(self.unwrapped.reset_infos[row][self._world.kind.option])
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
