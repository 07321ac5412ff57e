"""Stay cables in MuJoCo with their measurements: n of them, one a row, a control period at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.envs.cable_loads import CableLoad
from mrdamp.envs.cable_xml import modal_xml
from mrdamp.envs.damper_sensors import SIGNALS
from mrdamp.envs.frame_rows import DamperSums, currents, work
from mrdamp.envs.plants import EngineRows, Plants
from mrdamp.envs.sensors import Accelerometers
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.simulation.rows import Stepping
from mrdamp.structures.cables import StayCable

Array = NDArray[np.float64]


#: Results of one control period over all steps of the engine: columns of (n, 6).
#: means of int v^2 dx / L, m2, and of int a^2 dx / L, m2/s4, a the acceleration; means over the period of |current|
#: over the largest command, of its square, and of |current| in A or V; energy taken in by the damper, J.
PERIOD = ("motion", "acceleration", "share", "power", "current", "energy")


class CableRows(EngineRows):
    """n cables, each under its own load.

    places: (p,) x / L, where motion is measured. bandwidth: Hz, of the accelerometers there (`Accelerometers`); None:
    their readings are those of the coordinates at the instant. Attributes: names of the measurements, in the order of
    the columns of `measure`; plants; steps (n,), how many control periods each load lasts.
    """

    def __init__(
        self,
        cable: StayCable,
        damper: Model,
        places: Sequence[float],
        bandwidth: float | None,
        stepping: Stepping,
    ) -> None:
        bad = [x for x in places if not 0 < x < 1]
        if bad:
            raise InputError(f"cable: measured at {bad[0]} of the length; allowed: between 0 and 1")
        self.cable, self.damper = cable, damper
        self._at = cable.at(np.array(places, dtype=np.float64))  # (p, modes)
        self._here = cable.at(cable.damper_at)
        many = range(1, len(self._at) + 1)
        self.names: tuple[str, ...] = (
            *(f"{what}_{j}" for what in ("acceleration", "displacement", "velocity") for j in many),
            *SIGNALS[:-1],
        )
        self.accelerometers: Accelerometers | None = None
        if bandwidth is not None:
            self.accelerometers = Accelerometers(bandwidth, stepping.period, stepping.n, len(self._at))
        super().__init__(stepping)

    def _build(self) -> None:
        s, inner = self.stepping, self.stepping.inner
        loads = [f"load_{k + 1}" for k in range(len(self.cable.natural))]
        xml = modal_xml(self.cable, self.damper, self.period / inner)
        self.plants = Plants(
            xml, loads, ("damper",), inner, s.n, s.threads, ("sensordata", "qpos", "qvel", "qacc")
        )
        at = self.plants.sensors
        self._direct = slice(at["force"].start, at["current"].stop)
        self._pull, self._velocity = at["pull"], at["stroke_velocity"]
        self._current = at["current"]
        self._sums = DamperSums(inner, self.command_max, self.plants.timestep)

    def start(self, row: int, load: CableLoad) -> Array:
        """Row at rest under a load; returns `forces` of it."""
        forces = self.forces(load)
        self._begin(row, forces, load.sample_time, load.duration)
        return forces

    def forces(self, load: CableLoad) -> Array:
        """(samples, modes) N, a load on the natural coordinates at its own samples."""
        return np.asarray(load.force @ self.cable.load_matrix(load.places))

    def measure(self, rows: Sequence[int]) -> Array:
        """(rows, names) sensor readings of rows that have just started."""
        return self._limited(self._read(self.plants.measure(rows)), rows)

    def advance(self, commands: Array) -> tuple[Array, Array]:
        """One control period with commands (n, 1) held: `PERIOD` (n, 6), and the sensor readings after it."""
        data, now = self.plants.advance(commands)
        sensors, after = data["sensordata"], now["sensordata"]
        n, inner, _ = sensors.shape
        found = np.empty((n, 6))
        # The modal mass is 1 kg: the sum of squares is m int v^2 dx.
        whole = 1.0 / (inner * self.cable.mass * self.cable.length)
        for k, field in enumerate(("qpos", "qacc")):
            found[:, k] = whole * np.add.reduce(np.square(data[field]).reshape(n, -1), axis=1)
        found[:, 2:5] = currents(sensors[:, :, self._current], self.command_max)
        found[:, 5] = work(
            sensors[:, :, self._pull],
            sensors[:, :, self._velocity],
            after[:, self._velocity],
            self.plants.timestep,
        )
        return found, self._limited(self._read(self._moved_on(now)))

    def _limited(self, values: Array, fresh: Sequence[int] | None = None) -> Array:
        """Measurements (rows, names) with the accelerations of the sensors; fresh: rows that have just started."""
        if self.accelerometers is not None:
            p = len(self._at)
            values[:, :p] = self.accelerometers.read(values[:, 2 * p : 3 * p], fresh)
        return values

    def _moved_on(self, now: Mapping[str, Array]) -> Mapping[str, Array]:
        """All velocities, which stand half a step before the positions, moved on to them by the accelerations."""
        rise, sensors = 0.5 * self.plants.timestep * now["qacc"], now["sensordata"].copy()
        sensors[:, self._velocity] += (rise * self._here).sum(axis=-1, keepdims=True)
        return {**now, "sensordata": sensors, "qvel": now["qvel"] + rise}

    def advance_one(self, commands: Array) -> tuple[list[float], list[float]]:
        """`advance` for a single cable in plain numbers, bit-identical: every sum is NumPy's over the same numbers."""
        data, now = self.plants.advance(commands)
        sensors, after = data["sensordata"][0], now["sensordata"][0].tolist()
        whole = 1.0 / (len(sensors) * self.cable.mass * self.cable.length)
        squares = [np.add.reduce(np.square(data[field]).reshape(1, -1), axis=1) for field in ("qpos", "qacc")]
        size, velocity = np.abs(sensors[:, self._current]), sensors[:, self._velocity]
        period = [
            *(whole * square.item() for square in squares),
            *self._sums(size, sensors[:, self._pull], velocity, after[self._velocity]),
        ]
        moved = self._moved_on(now)
        after = moved["sensordata"][0].tolist()
        motion = [self._somewhere(moved[field])[0].tolist() for field in ("qacc", "qpos", "qvel")]
        values = [*motion[0], *motion[1], *motion[2], *after[self._direct]]
        return period, values if self.accelerometers is None else self._limited(np.array([values]))[0].tolist()

    def _read(self, data: Mapping[str, Array]) -> Array:
        motion = [self._somewhere(data[field]) for field in ("qacc", "qpos", "qvel")]
        return np.concatenate([*motion, data["sensordata"][:, self._direct]], axis=1)

    def _somewhere(self, coordinates: Array) -> Array:
        """(rows, p) at the places from natural coordinates (rows, modes).

        A matrix product might add up in another order for another number of rows.
        """
        return np.asarray((coordinates[:, None, :] * self._at).sum(axis=-1))

    def save(self, row: int) -> Any:
        moment = self.plants.save(row)
        return moment if self.accelerometers is None else (moment, self.accelerometers.state[row].copy())

    def restore(self, row: int, state: Any) -> None:
        if self.accelerometers is not None:
            state, self.accelerometers.state[row] = state
        self.plants.restore(row, state)
        self.steps[row] = state.steps // self.plants.inner
