"""A controller on a plant: one run, and what its command and coil took."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrdamp.compare.bench import UNCONTROLLED, Bench, Coil, require_periods
from mrdamp.control.base import Controller, ZeroOrderHold
from mrdamp.envs.plant_env import RowPlant
from mrdamp.model.core import Array

#: s. Every run is as long as with control periods of this, so that no controller is judged by motion that another's run
#: is too short for; a period that is no multiple of it is stepped in parts of at most _PART.
WINDOW = 5e-3
_PART = 1e-3


@dataclass(frozen=True)
class PlantRun:
    """Samples every `period` (s): results of the rows for each period (n, columns), at its end command and current (A
    or V), force (N) and stroke (m), (n,) each."""

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


@dataclass(frozen=True, kw_only=True)
class PlantBench(Bench):
    """Base of benches whose runs are those of a `RowPlant`."""

    command_unit: str = "V"
    period: float = 5e-3
    timestep: float = 5e-4
    engine: str = "mujoco"

    def run(self, spec: str, load: Any, amplitude: float) -> dict[str, Any]:
        if spec == UNCONTROLLED:
            return self.uncontrolled(load.scaled(amplitude))
        return self.driven(self.controller(spec), load, amplitude)

    @abstractmethod
    def uncontrolled(self, load: Any) -> dict[str, Any]:
        """What is kept of the run that ratios are over."""

    @abstractmethod
    def kept(self, run: PlantRun) -> dict[str, Any]:
        """What is kept of a controller's run, besides `PlantRun.electric`."""

    def driven(self, controller: Controller, load: Any, amplitude: float) -> dict[str, Any]:
        """What is kept of a controller's run. Raises InputError."""
        scaled, every = load.scaled(amplitude), round(controller.period / WINDOW)
        if every < 1 or abs(every * WINDOW - controller.period) > 1e-9 * WINDOW:
            every = math.ceil(controller.period / _PART - 1e-9)
        period = controller.period / every
        for each in (controller.period, period):
            require_periods(scaled, each)
        plant = RowPlant(self.structure, period=period, timestep=self.timestep, engine=self.engine)
        sampled, measured = ZeroOrderHold(controller, every), self.measured
        plant.rows.window = WINDOW
        sampled.reset()
        y, rows, said = plant.reset(scaled), [], []
        while not plant.finished:
            # In a copy of its own.
            command = sampled.command(plant.time, {name: y[name] for name in measured})
            y = plant.step(command)
            rows.append((command, y["current"], y["true_force"], y["stroke"]))
            said.append(tuple(plant.of_period))
        run = PlantRun(period, np.array(said), *np.array(rows).T)
        return {**self.kept(run), **run.electric(self.command_unit, self.site.command_max)}
