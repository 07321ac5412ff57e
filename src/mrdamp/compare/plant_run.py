"""A controller on a plant: one run, and what its command and coil took."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mrdamp.compare.bench import Coil
from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.zero_order_hold import ZeroOrderHold
from mrdamp.envs.plant import RowPlant
from mrdamp.errors import InputError, require_positive
from mrdamp.model import Model

Array = NDArray[np.float64]
_PERIODS = 1e-5, 10.0  # s
_MOST = 10_000_000  # periods of a run: results of more may not fit into memory


@dataclass(frozen=True, kw_only=True)
class PlantBench(ABC):
    """Base of benches of a plant. command_unit: A or V; period: of the classical controllers, s; timestep: of the
    engine, s, at most; engine: `mujoco` or `chain`; options: kind of controller -> options with their defaults."""

    model: Model
    command_unit: str = "V"
    period: float = 5e-3
    timestep: float
    engine: str = "mujoco"
    options: ClassVar[Mapping[str, Mapping[str, float]]]
    bounds: ClassVar[Mapping[str, Mapping[str, float]]] = {}
    base: ClassVar[str] = "passive-on"

    def __post_init__(self) -> None:
        require_period("compare", self.period)
        require_positive("compare", timestep=self.timestep)

    @property
    def kinds(self) -> tuple[str, ...]:
        return tuple(self.options)

    @abstractmethod
    def controller(self, spec: str) -> Controller:
        """Of a spec, as it is compared: see `mrdamp.control.told`. Raises InputError."""

    @abstractmethod
    def plant(self, period: float) -> RowPlant:
        """The structure with its damper, from its control period, s."""

    def check(self, spec: str) -> None:
        registry.parse(spec, self.options)
        at_rest(self.controller(spec), self.plant(self.period).rows.names)

    @property
    def command_max(self) -> float:
        """A or V. Raises InputError where the model has none."""
        largest = self.model.attributes.get("command_max", math.nan)
        if not 0 < largest < math.inf:
            raise InputError(
                f"{self.model.name}: no command_max among its parameters; give the largest command"
            )
        return largest


def at_rest(controller: Controller, names: Sequence[str]) -> None:
    """Asks a controller once for a command, at rest, so that what is wrong with it is found before a run.

    names: of the measurements. Raises InputError.
    """
    controller.reset()
    controller.command(0.0, dict.fromkeys(names, 0.0))


def require_period(what: str, period: Any) -> None:
    """InputError unless a control period, s, is a number that a run can be made with. what: whose it is."""
    if not isinstance(period, Real) or not _PERIODS[0] <= float(period) <= _PERIODS[1]:
        raise InputError(f"{what}: period is {period!r}; allowed: {_PERIODS[0]:g} to {_PERIODS[1]:g} s")


def require_periods(load: Any, period: float) -> None:
    """InputError unless a load, with a name and a duration (s), lasts 1 to `_MOST` control periods (s)."""
    if not 1 <= load.duration / period * (1 + 1e-9) <= _MOST:
        raise InputError(
            f"{load.name}: {load.duration:g} s in control periods of {period:g} s; allowed: 1 to {_MOST} periods"
        )


@dataclass(frozen=True)
class PlantRun:
    """Samples every `period` (s), at the ends of the control periods: results of the rows for each period (n, columns),
    command and current (A or V), force (N) and stroke (m), (n,) each."""

    period: float
    of_period: Array
    command: Array
    current: Array
    force: Array
    stroke: Array

    @property
    def duration(self) -> float:
        """s."""
        return self.period * len(self.command)

    def electric(self, unit: str, command_max: float) -> dict[str, Any]:
        """`ELECTRIC` by key."""
        way = float(np.abs(np.diff(self.command)).sum())
        return {
            "mean_command": float(np.abs(self.command).mean()),
            "rms_command": float(np.sqrt(np.mean(self.command**2))),
            "switching_rate": way / command_max / self.duration,
            **Coil.of(unit).use(
                float(np.abs(self.current).mean()), float(np.mean(self.current**2)), self.duration
            ),
        }


def run_plant(
    make: Callable[[float], RowPlant], load: Any, controller: Controller, period: float
) -> PlantRun:
    """A controller over a load. make: a plant from its control period, s; period: of the plant, unless the controller's
    own is no multiple of it."""
    every = round(controller.period / period)
    if abs(every * period - controller.period) > 1e-9 * period or every < 1:
        period, every = controller.period, 1
    require_periods(load, period)
    plant, sampled = make(period), ZeroOrderHold(controller, every)
    sampled.reset()
    y, rows, said = plant.reset(load), [], []
    while not plant.finished:
        command = sampled.command(plant.time, y)
        y = plant.step(command)
        rows.append((command, y["current"], y["true_force"], y["stroke"]))
        said.append(tuple(plant.of_period))
    return PlantRun(period, np.array(said), *np.array(rows).T)
