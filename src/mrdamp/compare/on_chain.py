"""A controlled frame on the C++ chain, as `mrdamp.simulation.stepping.run_frame` runs it in MuJoCo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mrdamp.control.base import Controller
from mrdamp.envs.plant import FramePlant
from mrdamp.errors import InputError
from mrdamp.model import FLOOR_SENSOR_EFFECTS, Model
from mrdamp.motions import GroundMotion
from mrdamp.simulation.stepping import FrameRun


def run_chain(model: Model, motion: GroundMotion, controller: Controller, *, timestep: float) -> FrameRun:
    """At the controller's period (s); timestep: the largest of the chain, s. Accelerometers of the floors are ideal."""
    ideal = tuple(e for e in model.effects if e.place is None or e.name not in FLOOR_SENSOR_EFFECTS)
    own = replace(model, effects=ideal)
    # The largest command is for shares that no one asks for here; commands are not cut off at it.
    plant = FramePlant(own, period=controller.period, timestep=timestep, command_max=1.0, engine="chain")
    controller.reset()
    y, rows = plant.reset(motion), []
    floors = range(1, plant.structure.storeys + 1)
    names = [f"{what}_{j}" for what in ("drift", "acceleration") for j in floors]
    while not plant.finished:
        command = controller.command(plant.time, y)
        rows.append([*(y[name] for name in names), y["force"], y["stroke"], command, y["current"]])
        y = plant.step(command)
    found = np.array(rows)
    if not np.isfinite(found).all():
        raise InputError(
            f"{model.name}: the simulation diverged; check the structure and the ground motion's unit"
        )
    n = len(floors)
    return FrameRun(
        time=controller.period * np.arange(len(found), dtype=np.float64),
        drift=found[:, :n],
        acceleration=found[:, n : 2 * n],
        force=found[:, 2 * n],
        stroke=found[:, 2 * n + 1],
        command=found[:, 2 * n + 2],
        current=found[:, 2 * n + 3],
    )
