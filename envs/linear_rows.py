"""Rows of structures given by matrices, in the engine and on the chain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mrdamp.envs.chain_rows import Chained
from mrdamp.envs.plants import EngineRows
from mrdamp.errors import InputError, require_positive
from mrdamp.model.core import Array
from mrdamp.simulation.rows import ChainRows
from mrdamp.structures.mechanics import Mechanics

_ROUNDING = 1e-6


class ByMatrices(Protocol):
    """A structure: matrices; rows (places, n) over its coordinates; whole: kg, see `ChainRows.linear`."""

    system: Mechanics
    at: Array
    whole: float

    def forces(self, load: Any) -> Array:
        """(samples, k) of a load every `load.sample_time`, straight between."""


def forces_of(whole: Any, load: Any) -> Array:
    """`ByMatrices.forces` of a load. InputError unless they are (samples, k) finite numbers over its duration."""
    found, many = np.asarray(whole.forces(load), dtype=np.float64), whole.system.load.shape[1]
    if found.ndim != 2 or found.shape[1] != many or not len(found):
        raise InputError(f"{load.name}: forces have the shape {found.shape}; allowed: finite (samples, {many})")
    if not np.isfinite(found).all():
        sample, k = np.argwhere(~np.isfinite(found))[0]
        raise InputError(f"{load.name}: forces[{sample}, {k}] is {found[sample, k]}; allowed: finite (samples, {many})")
    require_positive(load.name, sample_time=load.sample_time, duration=load.duration)
    last, whole_periods = (len(found) - 1) * load.sample_time, len(found) * load.sample_time
    if not last * (1 - _ROUNDING) <= load.duration <= whole_periods * (1 + _ROUNDING):
        raise InputError(
            f"{load.name}: duration is {load.duration:g} s; allowed: {last:g} s, of its {len(found)} forces "
            f"every {load.sample_time:g} s"
        )
    return found


class LinearRows(EngineRows):
    """n structures, each under its own load."""

    structure: Any  # ByMatrices
    fields = ("sensordata", "qpos", "qvel", "qacc")

    def start(self, row: int, load: Any) -> Array:
        """Row at rest under a load; returns `ByMatrices.forces` of it."""
        forces = forces_of(self.structure, load)
        self._begin(row, forces, load.sample_time, load.duration)
        return forces

    def _somewhere(self, coordinates: Array) -> Array:
        """(..., places) from coordinates (..., n). A matrix product might add up otherwise for other row counts."""
        return np.asarray((coordinates[..., None, :] * self.structure.at).sum(axis=-1))

    def _accelerations(self, qacc: Array, rows: NDArray[np.int64], steps: NDArray[np.int64]) -> Array:
        """(rows, k, places), as accelerometers read it, of qacc (rows, k, n) at steps (rows, k)."""
        s = self.structure.system
        if s.absolute:
            qacc = qacc - (self.plants.loads_at(rows, steps)[..., None, :] * s.loaded).sum(axis=-1)
        return self._somewhere(qacc)

    def _criteria(self, record: Mapping[str, Array]) -> Sequence[Array]:
        n, inner = len(self.steps), self.plants.inner
        steps = self.plants.step[:, None] - inner + np.arange(inner)
        both = self._accelerations(record["qacc"], np.arange(n), steps), self._somewhere(record["qpos"])
        return [column for x in both for found in ((x * x).mean(axis=1), np.abs(x).max(axis=1)) for column in found.T]

    def _moved_on(self, record: Mapping[str, Array], now: Mapping[str, Array]) -> Mapping[str, Array]:
        rise, sensors = 0.5 * self.plants.timestep * now["qacc"], now["sensordata"].copy()
        sensors[:, self._velocity] += (rise * self.structure.system.stroke).sum(axis=-1, keepdims=True)
        return {**now, "sensordata": sensors, "qvel": now["qvel"] + rise}

    def _read(self, now: Mapping[str, Array], fresh: Sequence[int] | None) -> Array:
        rows = np.arange(len(self.steps)) if fresh is None else np.array(fresh)
        acceleration = self._accelerations(now["qacc"][:, None], rows, self.plants.step[rows, None])[:, 0]
        motion = [acceleration, *(self._somewhere(now[field]) for field in ("qpos", "qvel"))]
        return np.concatenate([*motion, now["sensordata"][:, self._direct]], axis=1)


class LinearChain(Chained, LinearRows):
    """`LinearRows` on the chain."""

    def _build(self) -> None:
        whole, s = self.structure, self.structure.system
        matrices = s.rate, s.loaded, s.stroke[None], s.push, whole.at
        self._hold(ChainRows.linear(*matrices, whole.models, self.stepping, whole.whole, s.absolute))
