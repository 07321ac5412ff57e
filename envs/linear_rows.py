"""Rows of structures given by matrices and of stay cables, in the engine and on the chain."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter

from mrdamp.envs.cable_xml import linear_xml
from mrdamp.envs.plants import Chained, EngineRows
from mrdamp.envs.structure import Structure
from mrdamp.errors import InputError, require_positive
from mrdamp.model.core import Array
from mrdamp.simulation.rows import ChainRows, Stepping
from mrdamp.structures.lumped import Mechanics

if TYPE_CHECKING:
    from mrdamp.envs.cable import Cable

_ROUNDING = 1e-6


class ByMatrices(Structure):
    """A structure given by matrices, with rows `at` (places, n) over its coordinates; whole: kg, see
    `ChainRows.linear`."""

    @property
    @abstractmethod
    def system(self) -> Mechanics:
        """Without the damper."""

    @property
    def load_names(self) -> list[str]:
        return [f"load_{k + 1}" for k in range(self.system.load.shape[1])]

    def mjcf(self, timestep: float, *, drawn: bool = False) -> str:
        return linear_xml(self.name, self.system, self.models[0], timestep, drawn=drawn)


def forces_of(whole: Any, load: Any) -> Array:
    """`Structure.forces` of a load. InputError unless they are (samples, k) finite numbers over its duration."""
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
        """Row at rest under a load; returns `Structure.forces` of it."""
        forces = forces_of(self.structure, load)
        self._begin(row, forces, load.sample_time, load.duration)
        return forces

    def _somewhere(self, coordinates: Array) -> Array:
        """(..., places) from coordinates (..., n). A matrix product might add up otherwise for other row counts."""
        return np.asarray((coordinates[..., None, :] * self.structure.at).sum(axis=-1))

    def _accelerations(self, qacc: Array, rows: NDArray[np.int64], steps: NDArray[np.int64]) -> Array:
        """(rows, k, places), as accelerometers read it, of qacc (rows, k, n) at steps (rows, k)."""
        s = self.structure.system
        if s.grounds:
            ground = self.plants.loads_at(rows, steps)[..., None, : s.grounds]
            qacc = qacc - (ground * s.loaded[:, : s.grounds]).sum(axis=-1)
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
        self._hold(ChainRows.linear(*matrices, whole.models, self.stepping, whole.whole, s.grounds))


class Accelerometers:
    """Accelerometers of n rows at p places with a bandwidth: the mean acceleration of every control period, from the
    velocities at its ends, through a Butterworth low-pass of the second order at the control period.

    bandwidth: Hz, below half of the control rate. Attributes: state (n, 3, p), all that the next reading depends on:
    the last velocities and the filter's. Raises InputError.
    """

    def __init__(self, bandwidth: float, period: float, n: int, places: int) -> None:
        require_positive("accelerometers", bandwidth=bandwidth)
        if bandwidth >= 0.5 / period:
            raise InputError(f"bandwidth is {bandwidth} Hz; allowed: below {0.5 / period:g}, half of the control rate")
        self._b, self._a = (part.tolist() for part in butter(2, bandwidth, fs=1 / period))
        self._period = period
        self.state = np.zeros((n, 3, places))

    def read(self, velocity: Array, fresh: Sequence[int] | None = None) -> Array:
        """(rows, p) m/s2 from velocities (rows, p) m/s; fresh: rows that have just started, None: all, a period on."""
        if fresh is not None:
            self.state[list(fresh)] = 0.0
            self.state[list(fresh), 0] = velocity
            return np.zeros_like(velocity)
        last, first, second = self.state[:, 0], self.state[:, 1], self.state[:, 2]
        mean = (velocity - last) / self._period
        found = self._b[0] * mean + first
        self.state[:, 0] = velocity
        self.state[:, 1] = self._b[1] * mean - self._a[1] * found + second
        self.state[:, 2] = self._b[2] * mean - self._a[2] * found
        return np.asarray(found)


class CableRows(LinearRows):
    """n cables, each under its own load. Results of a period: means of int v^2 dx / L, m2, and of int a^2 dx / L,
    m2/s4, a the acceleration; then `OF_DAMPERS`."""

    structure: Cable

    def __init__(self, structure: Cable, stepping: Stepping) -> None:
        self.accelerometers: Accelerometers | None = None
        if structure.bandwidth is not None:
            places = len(structure.places)
            self.accelerometers = Accelerometers(structure.bandwidth, stepping.period, stepping.n, places)
        super().__init__(structure, stepping)

    def _criteria(self, record: Mapping[str, Array]) -> Sequence[Array]:
        cable, (n, inner, _) = self.structure.cable, record["qpos"].shape
        # The modal mass is 1 kg: the sum of squares is m int v^2 dx.
        whole = 1.0 / (inner * cable.mass * cable.length)
        squares = (np.square(record[field]).reshape(n, -1) for field in ("qpos", "qacc"))
        return [whole * np.add.reduce(square, axis=1) for square in squares]

    def _read(self, now: Mapping[str, Array], fresh: Sequence[int] | None) -> Array:
        return self.seen(super()._read(now, fresh), fresh)

    def seen(self, values: Array, fresh: Sequence[int] | None) -> Array:
        """Measurements (rows, names), in place, with the accelerations of the sensors; fresh: as of `_read`."""
        if self.accelerometers is not None:
            p = len(self.structure.places)
            values[:, :p] = self.accelerometers.read(values[:, 2 * p : 3 * p], fresh)
        return values

    def _beside(self, row: int) -> Any:
        return None if self.accelerometers is None else self.accelerometers.state[row].copy()

    def _put_back(self, row: int, beside: Any) -> None:
        if self.accelerometers is not None:
            self.accelerometers.state[row] = beside


class CableChain(CableRows, LinearChain):
    """`CableRows` on the chain."""

    def add_noise(self, deviation: Array) -> bool:
        """As `Chained.add_noise`, but where the accelerometers have a bandwidth, which comes before their noise."""
        return self.accelerometers is None and super().add_noise(deviation)
