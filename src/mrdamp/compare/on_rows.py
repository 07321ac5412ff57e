"""A controlled frame with a damper or several on rows, as `mrdamp.simulation.stepping.run_frame` runs one in MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mrdamp.control.base import Controller, sensor_name
from mrdamp.envs.plant import FramePlant
from mrdamp.model import FLOOR_SENSOR_EFFECTS, Model
from mrdamp.motions import GroundMotion
from mrdamp.simulation.floor_sensors import FloorSensors
from mrdamp.simulation.stepping import FrameRun


def run_rows(
    model: Model,
    motion: GroundMotion,
    controller: Controller,
    *,
    timestep: float,
    engine: str = "chain",
    measured: Sequence[str] | None = None,
) -> FrameRun:
    """At the controller's period (s); timestep: the engine's largest, s. measured: what the controller is given, in a
    copy of its own; None: all measurements of the rows.

    Of m dampers, at the places of the model's structure, force, stroke, command and current are (n, m).
    """
    assert model.structure is not None
    ideal = tuple(e for e in model.effects if e.place is None or e.name not in FLOOR_SENSOR_EFFECTS)
    own = replace(model, effects=ideal, structure=replace(model.structure, others=()))
    # The largest command is for shares that no one asks for here; commands are not cut off at it.
    largest = model.attributes.get("command_max", 1.0)
    plant = FramePlant(
        own, damper_between=model.structure.places, period=controller.period, timestep=timestep, command_max=largest,
        engine=engine,
    )  # fmt: skip
    controller.reset()
    y = plant.reset(motion)
    rows: list[list[float]] = []
    floors, dampers = range(1, model.structure.storeys + 1), range(len(model.structure.places))
    names = [f"{what}_{j}" for what in ("drift", "acceleration") for j in floors]
    names += [sensor_name(what, k) for what in ("true_force", "stroke", "current") for k in dampers]
    # The run has the true accelerations, the controller what the floors' accelerometers read.
    sensors, accelerations = FloorSensors(model.frame, controller.period, 1), [f"acceleration_{j}" for j in floors]
    while not plant.finished:
        read = sensors.read(np.array([[y[name] for name in accelerations]]), None if rows else [0])[0]
        seen = {**y, **dict(zip(accelerations, read.tolist(), strict=True))}
        command = controller.command(plant.time, {name: seen[name] for name in measured or seen})
        rows.append([*(y[name] for name in names), *np.broadcast_to(command, len(dampers)).tolist()])
        y = plant.step(command)
    found = np.array(rows)
    n, m = len(floors), len(dampers)
    drift, acceleration, *each = np.split(found, np.cumsum([n, n, m, m, m]), axis=1)
    force, stroke, current, given = (part if m > 1 else part[:, 0] for part in each)
    time = controller.period * np.arange(len(found), dtype=np.float64)
    return FrameRun(time, drift, acceleration, force, stroke, given, current)
