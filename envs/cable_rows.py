"""Stay cables in MuJoCo with their measurements: n of them, one a row, a control period at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.envs.cable_loads import CableLoad
from mrdamp.envs.plants import EngineRows
from mrdamp.envs.sensors import Accelerometers
from mrdamp.simulation.rows import Stepping

if TYPE_CHECKING:
    from mrdamp.envs.cable_task import Cable

Array = NDArray[np.float64]


#: Results of one control period over all steps of the engine: columns of (n, 6).
#: means of int v^2 dx / L, m2, and of int a^2 dx / L, m2/s4, a the acceleration; means over the period of |current|
#: over the largest command, of its square, and of |current| in A or V; energy taken in by the damper, J.
PERIOD = ("motion", "acceleration", "share", "power", "current", "energy")


class CableRows(EngineRows):
    """n cables, each under its own load."""

    structure: Cable

    fields = ("sensordata", "qpos", "qvel", "qacc")

    def __init__(self, structure: Cable, stepping: Stepping) -> None:
        self.cable = structure.cable
        self._at = self.cable.at(np.array(structure.places, dtype=np.float64))  # (p, modes)
        self.accelerometers: Accelerometers | None = None
        if structure.bandwidth is not None:
            self.accelerometers = Accelerometers(structure.bandwidth, stepping.period, stepping.n, len(self._at))
        super().__init__(structure, stepping)

    def start(self, row: int, load: CableLoad) -> Array:
        """Row at rest under a load; returns `StayCable.forces` of it."""
        forces = self.cable.forces(load.force, load.places)
        self._begin(row, forces, load.sample_time, load.duration)
        return forces

    def _criteria(self, record: Mapping[str, Array]) -> Sequence[Array]:
        n, inner, _ = record["qpos"].shape
        # The modal mass is 1 kg: the sum of squares is m int v^2 dx.
        whole = 1.0 / (inner * self.cable.mass * self.cable.length)
        squares = (np.square(record[field]).reshape(n, -1) for field in ("qpos", "qacc"))
        return [whole * np.add.reduce(square, axis=1) for square in squares]

    def _moved_on(self, record: Mapping[str, Array], now: Mapping[str, Array]) -> Mapping[str, Array]:
        rise, sensors = 0.5 * self.plants.timestep * now["qacc"], now["sensordata"].copy()
        sensors[:, self._velocity] += (rise * self.cable.at(self.cable.damper_at)).sum(axis=-1, keepdims=True)
        return {**now, "sensordata": sensors, "qvel": now["qvel"] + rise}

    def _read(self, now: Mapping[str, Array], fresh: Sequence[int] | None) -> Array:
        # A matrix product might add up in another order for another number of rows.
        motion = [(now[field][:, None, :] * self._at).sum(axis=-1) for field in ("qacc", "qpos", "qvel")]
        return self._limited(np.concatenate([*motion, now["sensordata"][:, self._direct]], axis=1), fresh)

    def _limited(self, values: Array, fresh: Sequence[int] | None) -> Array:
        """Measurements (rows, names) with the accelerations of the sensors; fresh: rows that have just started."""
        if self.accelerometers is not None:
            p = len(self._at)
            values[:, :p] = self.accelerometers.read(values[:, 2 * p : 3 * p], fresh)
        return values

    def _beside(self, row: int) -> Any:
        return None if self.accelerometers is None else self.accelerometers.state[row].copy()

    def _put_back(self, row: int, beside: Any) -> None:
        if self.accelerometers is not None:
            self.accelerometers.state[row] = beside
