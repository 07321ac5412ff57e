"""A Kalman filter of a shear frame on a ground whose motion it estimates too, by the model of Kanai and Tajimi.

    q'' + 2 z w q' + w^2 q = -white noise      ground acceleration = 2 z w q' + w^2 q

A filter for white ground acceleration has nothing to say of the ground itself. This one does, and by its model of what
follows, a little of the next tenths of the ground's period. Kanai 1957 (Bull. Earthq. Res. Inst. 35, 309), Tajimi 1960
(2nd World Conf. Earthq. Eng.).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from mrdamp.control.lqg import Estimator
from mrdamp.control.observe import LinearFilter, Observer
from mrdamp.control.plant import Plant, outputs, plant
from mrdamp.errors import InputError, require_positive
from mrdamp.structures import FloatArray, ShearFrame

_UNIT = 5.0  # m/s2: ground or floor acceleration that the observed states are scaled by, as signals are


@dataclass(frozen=True)
class Ground:
    """w: frequency, rad/s; z: damping, a ratio; noise_ratio: intensity of the white noise over that of every
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
        """Of the states [x; x'; q; q']; measurements: of `mrdamp.control.plant.outputs`. Raises InputError."""
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
