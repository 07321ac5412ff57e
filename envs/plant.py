"""A structure with its dampers, for any controller, without rewards and episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from mrdamp.envs.cable_task import Cable
from mrdamp.envs.car_task import Car
from mrdamp.envs.frame_task import Frame
from mrdamp.envs.frame_xml import Position
from mrdamp.envs.options import RowOptions
from mrdamp.envs.structure import Structure
from mrdamp.model import Model
from mrdamp.simulation.rows import finite
from mrdamp.structures import ShearFrame
from mrdamp.structures.cables import StayCable
from mrdamp.structures.cars import QuarterCar


class Plant(Protocol):
    """Interface of the plant of a controller.

    Measurements are named as in `mrdamp.control.base`; `time` is theirs, s. period: s. command_max: A or V.
    """

    period: float
    command_max: float

    @property
    def time(self) -> float:
        """Of the last measurements, s."""

    def reset(self, load: Any) -> Mapping[str, float]:
        """At rest under a load; the measurements at time 0."""

    def step(self, command: float) -> Mapping[str, float]:
        """One control period with the command held; the measurements at its end."""


class RowPlant:
    """A structure as a `Plant`. options: of `RowOptions`. Raises InputError.

    Attributes: structure; rows, one of it; period, s; commands_max, (m,) of all dampers, and command_max, of the first,
    A or V; of_period, result of `EngineRows.advance_one` for the last control period.
    """

    of_period: Sequence[float]

    def __init__(self, structure: Structure, **options: Any) -> None:
        self.structure = structure
        self.rows = rows = RowOptions(**options).rows(structure)
        self.period: float = rows.period
        self.commands_max = rows.command_max
        self.command_max = float(rows.command_max[0])

    @property
    def time(self) -> float:
        """Of the last measurements, s."""
        return float(self.rows.plants.step[0] // self.rows.plants.inner) * self.period

    @property
    def finished(self) -> bool:
        """True if the load is over; a plant may be stepped without one."""
        return bool(self.rows.plants.step[0] >= self.rows.steps[0] * self.rows.plants.inner)

    def reset(self, load: Any) -> Mapping[str, float]:
        """At rest under a load; the measurements at time 0."""
        self.rows.start(0, load)
        return dict(zip(self.rows.names, self.rows.measure([0])[0].tolist(), strict=True))

    def step(self, command: float | Sequence[float]) -> Mapping[str, float]:
        """One control period with the command (or one a damper) held; the measurements at its end."""
        each = command if np.ndim(command) else [command] * len(self.commands_max)
        self.of_period, values = self.rows.advance_one(finite("command", each, (1, len(self.commands_max))))
        return dict(zip(self.rows.names, values, strict=True))


class FramePlant(RowPlant):
    """A shear frame on a moving ground, in MuJoCo or on the chain (engine), with a damper or several.

    model, structure, damper_between: as of `Frame`. options: of `RowOptions`; the ground moves at each of the engine's
    steps. The measurements of a second damper have `_2` at the end, as `force_2`. Raises InputError.
    """

    def __init__(
        self,
        model: Model | Sequence[Model] | None = None,
        structure: ShearFrame | None = None,
        damper_between: Position | Sequence[Position] | None = None,
        **options: Any,
    ) -> None:
        super().__init__(Frame(model, structure, damper_between), **options)


class CablePlant(RowPlant):
    """A stay cable with a damper, in MuJoCo or on the chain (engine), for any controller, without rewards.

    cable, model, measured_at, bandwidth: as of `Cable`. options: of `RowOptions`. Raises InputError.
    """

    def __init__(
        self,
        cable: StayCable | None = None,
        model: Model | None = None,
        measured_at: Sequence[float] | None = None,
        bandwidth: float | None = None,
        **options: Any,
    ) -> None:
        super().__init__(Cable(cable or StayCable(), model, measured_at, bandwidth), **options)


class CarPlant(RowPlant):
    """A quarter car with a damper, in MuJoCo or on the chain (engine), for any controller, without rewards.

    car, model: as of `Car`. Floor 1 of the measurements is the wheel, 2 the body; displacements and velocities are
    those to the road. options: of `RowOptions`. Raises InputError.
    """

    def __init__(self, car: QuarterCar | None = None, model: Model | None = None, **options: Any) -> None:
        super().__init__(Car(car or QuarterCar(), model), **options)
