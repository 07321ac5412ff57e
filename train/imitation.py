"""Where a search begins: the weights whose action is nearest to the wanted force of a classical controller."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.control.following import ForceController
from mrdamp.control.observe import Observer
from mrdamp.errors import InputError
from mrdamp.train.worlds import Stage

Array = NDArray[np.float64]


def imitated(
    stage: Stage, loads: Sequence[Any], observer: Observer, matrix: NDArray[np.float32], force_max: float
) -> Array:
    """(inputs,) weights on whitened observations, by least squares on runs of the controller itself.

    The runs of all loads count alike, whatever their size. matrix: (inputs, observer.size). force_max: N, of an action
    of 1. Raises InputError for a controller that wants no force.
    """
    controller, plant = stage.controller, stage.plant
    if not isinstance(controller, ForceController):
        raise InputError(f"teacher {controller.name}: it has no wanted force; allowed: clipped-optimal and the like")
    own = Observer.from_dict(observer.to_dict())
    inputs, wanted = [], []
    for load in loads:
        controller.reset()
        own.reset()
        y, command = plant.reset(load), 0.0
        seen, forces = [], []
        while not plant.finished:
            seen.append(own(y, command))
            command = controller.command(plant.time, y)
            forces.append(controller.wanted / force_max)
            y = plant.step(command)
        size = float(np.sqrt(np.mean(np.square(forces)))) or 1.0
        inputs.append(np.array(seen, dtype=np.float64) @ matrix.T / size)
        wanted.append(np.array(forces) / size)
    return np.asarray(np.linalg.lstsq(np.concatenate(inputs), np.concatenate(wanted), rcond=1e-8)[0])
