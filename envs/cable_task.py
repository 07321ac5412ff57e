"""The task of the cable: ambient and wind loads, its default observation, and its reward."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp import sets
from mrdamp.envs.cable_loads import CableLoad, LoadSource, WindLoads
from mrdamp.envs.cable_reward import CableReward, free_run
from mrdamp.envs.chain_rows import CABLES
from mrdamp.envs.options import RowOptions, TaskOptions, model_of
from mrdamp.envs.plant import RowPlant
from mrdamp.envs.task import Task, check_options
from mrdamp.envs.weights import Score
from mrdamp.errors import require_kind
from mrdamp.model import Model
from mrdamp.structures.cables import StayCable

Array = NDArray[np.float64]

#: RMS over the scales under the default loads and commands that change evenly between none and the largest.
_TYPICAL = {"acceleration_1": 10.0, "acceleration": 2.8, "force": 0.5, "true_force": 0.5, "current": 0.6}
_LARGE = 0.002  # of the length: motion at mid-span that the scales of the observation belong to


def cable_damper() -> Model:
    """A small shear-mode damper that fits the laboratory cable: 4 to 21 N at 0.6 to 4 V (Zapateiro et al. 2010)."""
    found = sets.load("zapateiro_foam_bouc_wen")
    return Model(found.law, dict(found.parameters), name=found.id)


class CablePlant(RowPlant):
    """A stay cable with a damper, in MuJoCo or on the chain (engine), for any controller, without rewards.

    cable: None is the laboratory cable of `StayCable`. model: any identified one, None: `cable_damper`.
    measured_at: places x / L where acceleration_1 ..., displacement_1 ... and velocity_1 ... are measured; the
    first is the damper's own by default. bandwidth: Hz, of the accelerometers, as in `CableEnv`. options: of
    `RowOptions`. Raises InputError.
    """

    def __init__(
        self,
        cable: StayCable | None = None,
        model: Model | None = None,
        measured_at: Sequence[float] | None = None,
        bandwidth: float | None = None,
        **options: Any,
    ) -> None:
        self.cable = cable or StayCable()
        damper = model or cable_damper()
        places = measured_at or default_places(self.cable)
        super().__init__(RowOptions(**options).rows(CABLES, [damper], self.cable, damper, places, bandwidth))

    @property
    def mean_square(self) -> float:
        """int v^2 dx / L over the last period, m2."""
        return self.of_period[0]


def default_places(cable: StayCable) -> tuple[float, ...]:
    """Default places of measurement: at the damper, and farther from the anchorage."""
    return (cable.damper_at, min(5 * cable.damper_at, 0.25))


class CableTask(Task):
    """n cables under ambient or wind loads; arguments as in `CableEnv`."""

    def __init__(
        self,
        n: int = 1,
        *,
        cable: StayCable | None = None,
        model: Model | Path | str | None = None,
        measured_at: Sequence[float] | None = None,
        bandwidth: float | None = None,
        loads: LoadSource | None = None,
        reward: CableReward | Mapping[str, Any] | None = None,
        **options: Any,
    ) -> None:
        given = TaskOptions(**options)
        require_kind("a StayCable", StayCable, cable=cable)
        require_kind("a source of loads", LoadSource, loads=loads)
        require_kind("a list of places x / L", (list, tuple, np.ndarray), measured_at=measured_at)
        self.cable = cable or StayCable()
        self.model = model_of(model, cable_damper)
        if given.full_state:  # as many places as the sines can be distinguished at, between the anchorages
            measured_at = tuple(np.arange(1, self.cable.modes + 1) / (self.cable.modes + 1))
        places = tuple(measured_at or default_places(self.cable))
        rows = given.rows(CABLES, [self.model], self.cable, self.model, places, bandwidth, n=n)
        self.loads = WindLoads() if loads is None else loads
        self.weights = CableReward.of(reward)
        maximum = rows.command_max
        observer = given.observes(
            lambda full: cable_sensors(self.cable, places, float(maximum[0]), full), maximum, _TYPICAL
        )
        super().__init__(rows, Score(self.weights, n), observer, maximum, given.noise)

    drawn_size = 0.45

    def reference_motion(self, row: int) -> float:
        """RMS over time and length, m."""
        return math.sqrt(self.score.values[row, 0])

    def begin(
        self, row: int, rng: np.random.Generator, options: Mapping[str, Any], drawn: Mapping[str, float]
    ) -> dict[str, Any]:
        amplitude = check_options(options, "load")
        load = options.get("load")
        if load is None:
            load = self.loads.draw(rng, self.cable.length)
        require_kind("a CableLoad", CableLoad, load=load)
        load = load.scaled(amplitude)
        forces, cable = self.rows.start(row, load), self.rows.of(row).cable
        free = self._references.of(forces, drawn, lambda: free_run(cable, forces, load.sample_time))
        self.score.start(row, free, int(self.rows.steps[row]))
        return {
            "load": load.name,
            "load_rms": load.rms,
            "duration": load.duration,
            "reference_motion": math.sqrt(free[0]),
        }


def cable_sensors(
    cable: StayCable, places: Sequence[float], command_max: float, full_state: bool
) -> tuple[list[str], dict[str, float]]:
    """Signals of a cable's sensors: accelerations at the places of measurement, and the damper's stroke and force.

    full_state: displacements and velocities all along the cable, and the coil's current. Returns the signals, and the
    scale of every measurement (SI): those of the first mode with an amplitude of 0.2 % of the length at mid-span, at
    each place; of the force, what holds the cable fast there.
    """
    many = range(1, len(places) + 1)
    if full_state:
        signals = [f"{what}_{j}" for what in ("displacement", "velocity") for j in many] + ["current"]
    else:
        signals = [f"acceleration_{j}" for j in many]
    amplitude, w = _LARGE * cable.length, cable.first
    here = amplitude * math.sin(math.pi * cable.damper_at)
    scale = {
        "stroke": here,
        "stroke_velocity": here * w,
        "current": command_max,
        "force": cable.tension * here / (cable.damper_at * cable.length),
    }
    scale["true_force"] = scale["force"]
    for j, x in zip(many, places, strict=True):
        there = amplitude * math.sin(math.pi * x)
        scale |= {f"displacement_{j}": there, f"velocity_{j}": there * w, f"acceleration_{j}": there * w * w}
    return [*signals, "stroke", "force"], scale
