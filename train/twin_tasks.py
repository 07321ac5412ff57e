"""The tasks of the frame and the cable on twins (`mrdamp.train.twin`) in place of the engine."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from mrdamp.control.cable import cable_plant
from mrdamp.control.plant import Plant, plant
from mrdamp.envs.cable_rows import CableRows
from mrdamp.envs.cable_task import CableTask
from mrdamp.envs.frame_rows import FrameRows, currents
from mrdamp.envs.frame_task import FrameTask
from mrdamp.envs.plants import whole_steps
from mrdamp.envs.reward import Reference
from mrdamp.train.twin import TwinPlants

Array = NDArray[np.float64]

Kept = TypeVar("Kept")

_STEP = 1e-3  # s, of a twin at most
_FRAME = 5e-4  # s, of the frame's at least: the engine at .1 ms gives the same peaks within .5 %
_KEPT = 256  # references of loads


class FrameTwins(FrameRows):
    """`FrameRows` on twins."""

    def _build(self, timestep: float, n: int, threads: int) -> None:
        inner, structure = whole_steps(self.period, min(max(timestep, _FRAME), _STEP)), self.structure
        self.twins = TwinPlants(plant(structure), -structure.gamma, self.models[0], inner, self.period / inner, n)
        self.plants = cast(Any, self.twins)  # it has what a task asks of `Plants`
        floors = range(1, structure.storeys + 1)
        self.names = (
            *(f"{what}_{j}" for what in ("acceleration", "displacement") for j in floors),
            *("stroke", "force", "current"),
        )

    def measure(self, rows: Sequence[int]) -> Array:
        return self._channels()[list(rows)]

    def advance(self, commands: Array) -> tuple[Array, Array]:
        """As `FrameRows.advance`."""
        n, floors = len(commands), self.structure.storeys
        drift, acceleration, energy = np.zeros(n), np.zeros(n), np.zeros(n)
        current = np.zeros((n, self.twins.inner, 1))
        for k in range(self.twins.inner):
            now, rates = self.twins.measure()
            x = now[:floors]
            np.maximum(drift, np.abs(np.diff(x, axis=0, prepend=0.0)).max(axis=0), out=drift)
            np.maximum(acceleration, np.abs(rates + now[-1]).max(axis=0), out=acceleration)
            energy += now[2 * floors] * (self.twins.stroke @ now[floors : 2 * floors])
            current[:, k, 0] = self.twins.dampers.current
            self.twins.advance(commands[:, 0])
        energy *= self.twins.timestep
        found = np.column_stack([drift, acceleration, currents(current, self.command_max), energy])
        return found, self._channels()

    def _channels(self) -> Array:
        now, rates = self.twins.measure()
        floors = self.structure.storeys
        rest = np.stack([self.twins.stroke @ now[:floors], now[2 * floors], self.twins.dampers.current])
        return np.concatenate([rates + now[-1], now[:floors], rest]).T.copy()


class CableTwins(CableRows):
    """`CableRows` on twins."""

    def _build(self, timestep: float, n: int, threads: int) -> None:
        cable, inner = self.cable, whole_steps(self.period, min(timestep, _STEP))
        many, structure = len(cable.natural), cable_plant(cable)
        modal = Plant(structure.a, structure.b, np.vstack([np.zeros((many, many)), np.eye(many)]))
        self.twins = TwinPlants(modal, cable.at(cable.damper_at), self.damper, inner, self.period / inner, n)
        self.plants = cast(Any, self.twins)  # it has what a task asks of `Plants`
        at = range(1, len(self._at) + 1)
        self.names = (*(f"acceleration_{j}" for j in at), "stroke", "force", "current")

    def measure(self, rows: Sequence[int]) -> Array:
        return self._channels()[list(rows)]

    def advance(self, commands: Array) -> tuple[Array, Array]:
        """As `CableRows.advance`."""
        n, many, inner = len(commands), len(self.cable.natural), self.twins.inner
        motion, acceleration, energy, current = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((n, inner, 1))
        for k in range(inner):
            now, rates = self.twins.measure()
            acceleration += np.square(rates).sum(axis=0)
            energy += now[2 * many] * (self.twins.stroke @ now[many : 2 * many])
            current[:, k, 0] = self.twins.dampers.current
            self.twins.advance(commands[:, 0])
            motion += np.square(now[:many]).sum(axis=0)
        whole = 1.0 / (inner * self.cable.mass * self.cable.length)
        energy *= self.twins.timestep
        found = [whole * motion, whole * acceleration, currents(current, self.command_max), energy]
        return np.column_stack(found), self._channels()

    def _channels(self) -> Array:
        now, rates = self.twins.measure()
        many = len(self.cable.natural)
        rest = np.stack([self.twins.stroke @ now[:many], now[2 * many], self.twins.dampers.current])
        return np.concatenate([self._at @ rates, rest]).T.copy()


class FrameTwinTask(FrameTask):
    """`FrameTask` on twins; rows that start together under one motion share its reference."""

    structures: ClassVar[type[FrameRows]] = FrameTwins

    def reference(self, ground: Array, dt: float) -> Reference:
        return _once(self, ground, lambda: super(FrameTwinTask, self).reference(ground, dt))


class CableTwinTask(CableTask):
    """`CableTask` on twins; rows that start together under one load share its reference."""

    structures: ClassVar[type[CableRows]] = CableTwins

    def reference(self, pushes: Array) -> Array:
        return _once(self, pushes, lambda: super(CableTwinTask, self).reference(pushes))


def _once(task: Any, load: Array, found: Callable[[], Kept]) -> Kept:
    """What `found` says of a load, from before where the task was asked of it lately."""
    kept: dict[bytes, Kept] = task.__dict__.setdefault("_references", {})
    key = hashlib.sha256(load.tobytes()).digest()
    if key not in kept:
        if len(kept) >= _KEPT:
            kept.clear()
        kept[key] = found()
    return kept[key]
