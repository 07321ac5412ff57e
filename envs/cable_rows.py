"""Stay cables with their measurements: n of them, one a row, a control period at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mrdamp.envs.linear_rows import LinearChain, LinearRows
from mrdamp.envs.sensors import Accelerometers
from mrdamp.model.core import Array
from mrdamp.simulation.rows import Stepping

if TYPE_CHECKING:
    from mrdamp.envs.cable_task import Cable



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
