"""Frames, cables and quarter cars on the C++ chain (`mrdamp.simulation.rows`): the engine's measurements without it.

The structure is stepped exactly and the damper solved for within the step, so that the steps may be longer than the
engine's. White noise on the measurements is the chain's own, a function of a seed that a row draws at its start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mrdamp.envs.cable_loads import CableLoad
from mrdamp.envs.cable_rows import CableRows
from mrdamp.envs.car_rows import CarRows, road_acceleration
from mrdamp.envs.frame_rows import FrameRows
from mrdamp.errors import InputError
from mrdamp.motions import GroundMotion
from mrdamp.simulation.rows import ChainRows

Array = NDArray[np.float64]
Kind = TypeVar("Kind", FrameRows, CableRows, CarRows)

#: s: how far apart peaks are looked for within longer steps; the engine's own step in the frame.
_INSTANT = 5e-4
_SEEDS = 2**53  # whole numbers that a double holds


class Chained:
    """What they have in common. Attributes: plants, seeds (n,) of the rows' noise."""

    plants: Any
    seeds: NDArray[np.int64]
    steps: NDArray[np.int64]

    def _hold(self, plants: ChainRows) -> None:
        self.plants = plants
        self.seeds = np.zeros(plants.n, dtype=np.int64)

    def add_noise(self, deviation: Array) -> bool:
        """White noise (names,), SI, on all measurements from now on; True: the rows see to it themselves."""
        self.plants.noise(deviation)
        return True

    def seed(self, row: int, rng: np.random.Generator) -> None:
        """Of the noise of the row's next start."""
        self.seeds[row] = rng.integers(_SEEDS)

    def measure(self, rows: Sequence[int]) -> Array:
        """(rows, names) what the sensors of rows that have just started read."""
        return np.asarray(self.plants.measured[list(rows)])

    def advance(self, commands: Array) -> tuple[Array, Array]:
        """One control period with commands (n, m) held: `PERIOD` (n, 6), and what the sensors read after it."""
        found: tuple[Array, Array] = self.plants.advance(commands)
        return found

    def advance_one(self, commands: Array) -> tuple[list[float], list[float]]:
        """`advance` of a single row in plain numbers."""
        period, values = self.plants.advance(commands)
        return period[0].tolist(), values[0].tolist()

    def save(self, row: int) -> Any:
        """The row's present."""
        return self.plants.save(row)

    def restore(self, row: int, state: Any) -> None:
        """Back to it, exactly."""
        self.plants.restore(row, state)
        self.steps[row] = state.steps // self.plants.inner


class FrameChain(Chained, FrameRows):
    """`FrameRows` on the chain."""

    def _build(self) -> None:
        between = [model.structure.damper_between for model in self.models if model.structure is not None]
        instants = max(1, round(self.period / self.stepping.inner / _INSTANT))
        self._hold(ChainRows.frame(self.models[0].frame, self.models, between, self.stepping, instants))

    def start(self, row: int, motion: GroundMotion) -> Array:
        """As `FrameRows.start`."""
        ground = self._ground(row, motion)
        self.plants.start(
            row, motion.acceleration[:, None], motion.sample_time, len(ground), int(self.seeds[row])
        )
        return ground

    def position(self, row: int) -> Array:
        """(1 + storeys,) m: the ground, which stays, and the drifts."""
        return np.diff(self.plants.position(row), prepend=[0.0, 0.0])


class CableChain(Chained, CableRows):
    """`CableRows` on the chain."""

    def _build(self) -> None:
        cable = self.cable
        here, mass = cable.at(cable.damper_at), cable.mass * cable.length
        self._hold(
            ChainRows.modes(cable.natural, cable.ratio, here, self._at, mass, self.damper, self.stepping)
        )

    def start(self, row: int, load: CableLoad) -> Array:
        """As `CableRows.start`."""
        forces = self.forces(load)
        pushes = self._pushes(row, load, forces)
        self.plants.start(row, forces, load.sample_time, len(pushes), int(self.seeds[row]))
        return pushes


class CarChain(Chained, CarRows):
    """`CarRows` on the chain."""

    def _build(self) -> None:
        self._hold(ChainRows.car(self.car, self.models[0], self.stepping))

    def start(self, row: int, motion: Any) -> Array:
        """As `CarRows.start`."""
        heights = self._heights(row, motion)
        load = road_acceleration(heights, self.plants.timestep)
        load[0] *= 2.0  # straight between samples, it is there for half as long as the others
        self.plants.start(row, load[:, None], self.plants.timestep, len(load), int(self.seeds[row]))
        return heights[:-1]

    def position(self, row: int) -> Array:
        """(3,) m: the road, and the deflections of tyre and suspension."""
        time = self.plants.timestep * self.plants.step[row]
        return np.append(self.roads[row].at(time), np.diff(self.plants.position(row), prepend=0.0))

    def save(self, row: int) -> Any:
        """The row's present."""
        return self.plants.save(row), self.roads[row]

    def restore(self, row: int, state: Any) -> None:
        """Back to it, exactly."""
        super().restore(row, state[0])
        self.roads[row] = state[1]


#: By engine: the rows of frames, cables and cars, and their largest step unless asked otherwise (s).
FRAMES: Mapping[str, tuple[type[FrameRows], float]] = {
    "mujoco": (FrameRows, 5e-4),
    "chain": (FrameChain, 1e-3),
}
CABLES: Mapping[str, tuple[type[CableRows], float]] = {
    "mujoco": (CableRows, 1e-3),
    "chain": (CableChain, 1e-3),
}
CARS: Mapping[str, tuple[type[CarRows], float]] = {
    "mujoco": (CarRows, 5e-4),
    "chain": (CarChain, 1e-3),
}


def of_engine(engines: Mapping[str, tuple[type[Kind], float]], engine: str) -> tuple[type[Kind], float]:
    """What belongs to an engine's name. Raises InputError."""
    if engine not in engines:
        raise InputError(f"engine is {engine!r}; allowed: {', '.join(engines)}")
    return engines[engine]
