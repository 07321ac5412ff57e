"""Vector environments on the engine's `Batch`: rows of one task, with the numbers of single environments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from mrdamp.control.observe import Observation
from mrdamp.envs.cable import Cable
from mrdamp.envs.car import Car
from mrdamp.envs.frame import Frame
from mrdamp.envs.linear import LinearStructure, own_kind
from mrdamp.envs.structure import Structure
from mrdamp.envs.task import Task, divided
from mrdamp.errors import InputError
from mrdamp.simulation.rows import finite

Flags = NDArray[np.bool_]
Result = tuple[Observation, NDArray[np.float64], Flags, Flags, dict[str, Any]]


class PlantVectorEnv(VectorEnv[Observation, NDArray[np.float32], NDArray[Any]]):
    """The rows of a task as a Gymnasium vector environment.

    Observations, rewards and infos are, bit for bit, those of `SyncVectorEnv` over single environments with the same
    seeds. autoreset_mode: `AutoresetMode.NEXT_STEP` (Gymnasium's default), `SAME_STEP` or `DISABLED`.
    """

    def __init__(self, task: Task, autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP) -> None:
        self.task = task
        self.num_envs = task.n
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self.single_observation_space, self.single_action_space = task.observation_space, task.action_space
        self.observation_space = batch_space(task.observation_space, task.n)
        self.action_space = batch_space(task.action_space, task.n)
        self._rngs = [seeding.np_random(None)[0] for _ in range(task.n)]
        self._over: Flags = np.zeros(task.n, dtype=np.bool_)
        self._observation: Observation = np.zeros((task.n, task.observer.size), np.float32)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """All rows at rest, or those of options["reset_mask"] (n,); a seed s gives row k the seed s + k."""
        options = dict(options or {})
        mask = options.pop("reset_mask", None)
        flags = mask is None or (np.shape(mask) == (self.num_envs,) and np.isin(mask, (0, 1)).all() and np.any(mask))
        if not flags:
            raise InputError(f"reset: reset_mask is {mask!r}; allowed: {self.num_envs} flags, some set")
        rows = list(range(self.num_envs)) if mask is None else np.flatnonzero(mask).tolist()
        each = range(self.num_envs)
        seeds = seed if isinstance(seed, Sequence) else [None if seed is None else seed + k for k in each]
        if len(seeds) != self.num_envs:
            raise InputError(f"{len(seeds)} seeds for {self.num_envs} environments")
        for row in rows:
            if seeds[row] is not None:
                self._rngs[row] = seeding.np_random(seeds[row])[0]
        infos = self._restart(rows, options)
        self._over[rows] = False
        return self._observation.copy(), infos

    def step(self, actions: NDArray[np.float32]) -> Result:
        """One control period of all rows. Raises Gymnasium's `ResetNeeded` before the first `reset`, and where no row
        begins anew by itself (`DISABLED`) after an episode's end."""
        self.task.require_begun(running=self.autoreset_mode is AutoresetMode.DISABLED)
        again = np.flatnonzero(self._over).tolist() if self.autoreset_mode is AutoresetMode.NEXT_STEP else []
        step = self.task.step(finite("action", actions, self.action_space.shape or (), exact=True), again)
        self._observation = step.observation
        reward, over = step.reward, step.over
        mask = np.ones(self.num_envs, dtype=np.bool_)
        mask[again] = False
        infos: dict[str, Any] = {}
        for name, column in zip(self.task.score.NAMES, step.info.T, strict=True):
            infos[name], infos[f"_{name}"] = column, mask
        if again:
            step.info[again] = 0.0
            reward[again], over[again] = 0.0, False
            infos = (infos if len(again) < self.num_envs else {}) | self._restart(again, {})
        self._over = over.copy()
        if self.autoreset_mode is AutoresetMode.SAME_STEP and over.any():
            infos = self._same_step(np.flatnonzero(over).tolist(), infos)
        return self._observation.copy(), reward, np.zeros(self.num_envs, dtype=np.bool_), over, infos

    def _same_step(self, rows: list[int], infos: dict[str, Any]) -> dict[str, Any]:
        """Resets the rows that are over; their last values are in `final_obs` and `final_info`."""
        final_obs = np.full(self.num_envs, None, dtype=object)
        ended = np.zeros(self.num_envs, dtype=np.bool_)
        ended[rows] = True
        final: dict[str, Any] = {}
        for row in rows:
            final_obs[row] = self._observation[row].copy()
        for name in self.task.score.NAMES:
            final[name], final[f"_{name}"] = np.where(ended, infos[name], 0.0), ended
            infos[name], infos[f"_{name}"] = np.where(ended, 0.0, infos[name]), ~ended
        if ended.all():
            infos = {}
        infos |= self._restart(rows, {})
        return infos | {"final_obs": final_obs, "_final_obs": ended, "final_info": final, "_final_info": ended}

    def _restart(self, rows: list[int], options: dict[str, Any]) -> dict[str, Any]:
        observation, each = self.task.reset(rows, self._rngs, options)
        self._observation[rows] = observation
        infos: dict[str, Any] = {}
        for row, info in zip(rows, each, strict=True):
            infos = self._add_info(infos, info, row)
        return infos


class KindVectorEnv(PlantVectorEnv):
    """num_envs structures of a kind at once; arguments as in their environment, threads: of the engine."""

    kind: ClassVar[type[Structure]]

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **arguments: Any,
    ) -> None:
        structure, others = divided(self.kind, arguments)
        super().__init__(Task(structure, num_envs, **others), autoreset_mode)


class FrameVectorEnv(KindVectorEnv):
    """Of `FrameEnv`."""

    kind = Frame


class CableVectorEnv(KindVectorEnv):
    """Of `CableEnv`."""

    kind = Cable


class CarVectorEnv(KindVectorEnv):
    """Of `CarEnv`."""

    kind = Car


class StructureVectorEnv(KindVectorEnv):
    """Of `StructureEnv`."""

    def __init__(self, num_envs: int = 1, *, structure: str | type[LinearStructure], **arguments: Any) -> None:
        self.kind = own_kind(structure)  # type: ignore[misc]
        super().__init__(num_envs, **arguments)
