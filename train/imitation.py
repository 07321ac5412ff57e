"""What is taken from a classical controller: its Kalman filter, and the weights nearest to its wanted force; and a
Kalman filter of frame and ground."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from mrdamp.control.clipped_optimal import OptimalForce
from mrdamp.control.force_control import ForceController
from mrdamp.control.lqg import Estimator, Plant, outputs, plant
from mrdamp.control.observe import LinearFilter, Observer
from mrdamp.envs.frame import Frame
from mrdamp.errors import InputError, require_positive
from mrdamp.model.core import Array
from mrdamp.structures import FloatArray, ShearFrame
from mrdamp.train.worlds import Stage, World

_UNIT = 5.0  # m/s2: ground or floor acceleration that the observed states are scaled by, as signals are


@dataclass(frozen=True)
class Ground:
    """A Kalman filter of a shear frame on a ground whose motion it estimates too, by the model of Kanai and Tajimi.

        q'' + 2 z w q' + w^2 q = -white noise      ground acceleration = 2 z w q' + w^2 q

    A filter for white ground acceleration has nothing to say of the ground itself. This one does, and by its model of
    what follows, a little of the next tenths of the ground's period. Kanai 1957 (Bull. Earthq. Res. Inst. 35, 309),
    Tajimi 1960 (2nd World Conf. Earthq. Eng.).

    w: frequency, rad/s; z: damping, a ratio; noise_ratio: intensity of the white noise over that of every
    measurement's, (m/s2)^2 each; precision: standard deviation of a displacement's noise over that of an
    acceleration's, s^2. Raises InputError."""

    frequency: float
    damping: float
    noise_ratio: float
    precision: float

    def __post_init__(self) -> None:
        require_positive("ground filter", **vars(self))

    @classmethod
    def of(cls, given: Any) -> Ground:
        """From settings. Raises InputError."""
        names = list(cls.__dataclass_fields__)
        fits = isinstance(given, Mapping) and set(given) == set(names)
        if not fits or not all(isinstance(v, int | float) for v in given.values()):
            raise InputError(f"ground filter: {given!r}; allowed: numbers {', '.join(names)}")
        return cls(**given)

    def estimator(self, frame: ShearFrame, measurements: Sequence[str], period: float) -> Estimator:
        """Of the states [x; x'; q; q']; measurements: of `mrdamp.control.lqg.outputs`. Raises InputError."""
        linear = plant(frame)
        n, of_ground = len(linear.a), self._acceleration
        a = np.zeros((n + 2, n + 2))
        a[:n, :n], a[:n, n:] = linear.a, np.outer(linear.e, of_ground)
        a[n, n + 1], a[n + 1, n:] = 1.0, -of_ground
        c, d = outputs(frame, measurements)
        whole = Plant(a, np.append(linear.b, [0.0, 0.0]), np.append(np.zeros(n + 1), 1.0))
        deviation = np.array([1.0 if m.startswith("acceleration") else self.precision for m in measurements])
        return Estimator(
            whole, np.pad(c, ((0, 0), (0, 2))), d, measurements, self.noise_ratio, period, deviation
        )

    @property
    def _acceleration(self) -> FloatArray:
        """(2,) of the ground, from [q, q']."""
        return np.array([self.frequency**2, 2 * self.damping * self.frequency])

    def observed(self, observer: Observer, frame: ShearFrame, period: float) -> Observer:
        """The observer with these states behind those of its own filter, each over that of a strong motion.

        All of its signals but the force are the filter's measurements. Raises InputError without a force.
        """
        if "force" not in observer.signals:
            raise InputError("ground filter: the observer sees no force")
        measurements = [name for name in observer.signals if name != "force"]
        held, needed = self.estimator(frame, measurements, period), [*measurements, "force"]
        w = 2 * np.pi * float(frame.frequencies[0])
        floors = np.repeat([w**2, w], frame.storeys)
        scale = np.append(floors, [self.frequency**2, self.frequency]) / _UNIT
        columns = [needed.index(name) for name in observer.signals]
        step, before, now = held.matrices
        own = scale[:, None] * step / scale
        gains = [scale[:, None] * gain[:, columns] * observer.scales for gain in (before, now)]
        if observer.filter is not None:
            first = observer.filter.matrices
            own = block_diag(first[0], own)
            gains = [np.vstack([one, two]) for one, two in zip(first[1:], gains, strict=True)]
        return replace(
            observer, filter=LinearFilter(*(tuple(map(tuple, m.tolist())) for m in (own, *gains)))
        )


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
    the other; given: see `mrdamp.train.imitation.Ground`, or a list of such. Raises InputError."""
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
