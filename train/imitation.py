"""What is taken from a classical controller: its Kalman filter, and the weights nearest to its wanted force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.control.clipped_optimal import OptimalForce
from mrdamp.control.force_control import ForceController
from mrdamp.control.ground_filter import Ground
from mrdamp.control.observe import LinearFilter, Observer
from mrdamp.envs.frame import Frame
from mrdamp.errors import InputError
from mrdamp.model.core import Array
from mrdamp.train.worlds import Stage, World

_WIDE = 1e3  # of the observer's units


def estimated(world: World, spec: str) -> Observer:
    """The world's observer with the states of a controller's Kalman filter, each in its share of the wanted force over
    the largest: what matters most to the controller is largest.

    Raises InputError for a controller without one, and for an observer without its measurements.
    """
    task = world.task(1)
    controller, own = world.stage(task, spec).controller, task.observer
    if not isinstance(controller, ForceController) or not isinstance(controller.aim, OptimalForce):
        raise InputError(
            f"estimator {controller.name}: it has no Kalman filter; allowed: clipped-optimal and the like"
        )
    held = controller.aim.estimator
    needed = (*held.measurements, "force")
    missing = [name for name in needed if name not in own.signals]
    if missing:
        raise InputError(f"estimator {controller.name}: {missing[0]} is not observed")
    scale = controller.aim.k / world.levels(task).force_max
    columns = [needed.index(name) if name in needed else -1 for name in own.signals]

    def of(gain: Array) -> Array:
        padded = np.column_stack([gain, np.zeros(len(gain))])
        return scale[:, None] * padded[:, columns] * own.scales

    step, before, now = held.matrices
    rows = scale[:, None] * step / scale, of(before), of(now)
    # What is cut off would be in the states for long: near a damper that sticks, accelerations are large.
    return replace(
        own, limit=_WIDE, filter=LinearFilter(*(tuple(map(tuple, matrix.tolist())) for matrix in rows))
    )


def with_ground(world: World, given: Any) -> World:
    """The world with an observer that has the states of a filter of frame and ground besides, or of several, one behind
    the other; given: see `mrdamp.control.ground_filter.Ground`, or a list of such. Raises InputError."""
    task = world.task(1)
    if not isinstance(task.structure, Frame):
        raise InputError("ground filter: it is for mrdamp/Frame-v0 only")
    observer = task.observer
    for ground in [Ground.of(one) for one in (given if isinstance(given, list) else [given])]:
        observer = ground.observed(observer, task.structure.frame, task.rows.period)
    return world.observing(replace(observer, limit=_WIDE))


def imitated(
    stage: Stage, loads: Sequence[Any], observer: Observer, matrix: NDArray[np.float32], force_max: float
) -> Array:
    """(inputs,) weights on whitened observations, by least squares on runs of the controller itself.

    The runs of all loads count alike, whatever their size. matrix: (inputs, observer.size). force_max: N, of an action
    of 1. Raises InputError for a controller without a wanted force.
    """
    controller, plant = stage.controller, stage.plant
    if not isinstance(controller, ForceController):
        raise InputError(
            f"teacher {controller.name}: it has no wanted force; allowed: clipped-optimal and the like"
        )
    own = Observer.from_dict(observer.to_dict())
    inputs, wanted = [], []
    for load in loads:
        controller.reset()
        own.reset()
        y, command = plant.reset(load), 0.0
        observation, forces = [], []
        while not plant.finished:
            observation.append(own(y, command))
            command = controller.command(plant.time, y)
            forces.append(controller.wanted / force_max)
            y = plant.step(command)
        size = float(np.sqrt(np.mean(np.square(forces)))) or 1.0
        inputs.append(np.array(observation, dtype=np.float64) @ matrix.T / size)
        wanted.append(np.array(forces) / size)
    return np.asarray(np.linalg.lstsq(np.concatenate(inputs), np.concatenate(wanted), rcond=1e-8)[0])
