"""A structure with its dampers, for any controller, without rewards and episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from mrdamp import sets
from mrdamp.envs.chain_rows import FRAMES
from mrdamp.envs.frame_rows import as_mapping
from mrdamp.envs.frame_xml import Position, frame_models
from mrdamp.envs.options import RowOptions
from mrdamp.errors import InputError
from mrdamp.model import Model, effects_from
from mrdamp.simulation.rows import finite
from mrdamp.structures import ShearFrame


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


def default_damper() -> Model:
    """The damper of Dyke, Spencer, Sain and Carlson 1996: modified Bouc-Wen, 3 kN, 0 to 2.25 V, driver lag."""
    found = sets.load("dyke1996_3kN")
    effects = effects_from({k: v for k, v in found.attributes().items() if k not in found.parameters})
    return Model(found.law, dict(found.parameters), effects, name=found.id)


def positions(damper_between: Position | Sequence[Position]) -> tuple[Position, ...]:
    """One pair of floors or several, as several."""
    pairs = np.asarray(damper_between)
    if pairs.ndim not in (1, 2) or pairs.shape[-1] != 2 or pairs.dtype.kind not in "iu":
        raise InputError(f"damper_between is {damper_between!r}; allowed: a pair of floors, or several pairs")
    return tuple((int(a), int(b)) for a, b in pairs.reshape(-1, 2))


class RowPlant:
    """One row as a `Plant`.

    Attributes: rows, of the structure; period, s; commands_max, (m,) of all dampers, and command_max, of the first, A
    or V; of_period, result of `Rows.advance_one` for the last control period.
    """

    of_period: Sequence[float]

    def __init__(self, rows: Any) -> None:
        self.rows = rows
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
        return as_mapping(self.rows.names, self.rows.measure([0])[0].tolist())

    def step(self, command: float | Sequence[float]) -> Mapping[str, float]:
        """One control period with the command (or one a damper) held; the measurements at its end."""
        each = command if np.ndim(command) else [command] * len(self.commands_max)
        self.of_period, values = self.rows.advance_one(finite("command", each, (1, len(self.commands_max))))
        return as_mapping(self.rows.names, values)


class FramePlant(RowPlant):
    """A shear frame on a moving ground, in MuJoCo or on the chain (engine), with a damper or several.

    model: any identified one (any law, with or without effects; None: `default_damper`), or one a damper.
    structure: None takes the model's own, or Dyke's three-storey frame. damper_between: floors of the damper, or
    several pairs. options: of `RowOptions`; the ground moves at each of the engine's steps. The measurements of a
    second damper have `_2` at the end, as `force_2`. Raises InputError.
    """

    def __init__(
        self,
        model: Model | Sequence[Model] | None = None,
        structure: ShearFrame | None = None,
        damper_between: Position | Sequence[Position] | None = None,
        **options: Any,
    ) -> None:
        models = placed(model, structure, damper_between)
        super().__init__(RowOptions(**options).rows(FRAMES, models, models))
        self.structure = self.rows.structure


def placed(
    model: Model | Sequence[Model] | None,
    structure: ShearFrame | None,
    damper_between: Position | Sequence[Position] | None,
) -> tuple[Model, ...]:
    """The models of the dampers at their places; None as in `FramePlant`."""
    model = default_damper() if model is None else model
    first = model if isinstance(model, Model) else model[0]
    if damper_between is None:
        own = structure or first.structure
        damper_between = own.damper_between if own is not None else (0, 1)
    return frame_models(model, structure, positions(damper_between))
