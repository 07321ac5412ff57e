"""Sensors between a structure and a controller: accelerometers with a bandwidth, and white noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.signal import butter

from mrdamp.errors import InputError, require_positive
from mrdamp.model.core import Array


def stem(name: str) -> str:
    """A measurement's name without its number."""
    return name.rstrip("0123456789").rstrip("_")


class Noise:
    """White noise on measurements; deviation: name, or the name without its number -> standard deviation, SI.

    Attributes: where, of the names there is any; all (names,), its standard deviation on each.
    """

    def __init__(self, deviation: Mapping[str, float], names: Sequence[str]) -> None:
        self.where: list[int] = []
        found: list[float] = []
        stems = {name: stem(name) for name in names}
        for key, value in deviation.items():
            if key not in stems and key not in stems.values():
                raise InputError(f"noise on {key!r}: no such measurement; there are: {', '.join(names)}")
            if not 0 <= value < math.inf:
                raise InputError(f"noise on {key!r} is {value}; allowed: >= 0")
        for k, name in enumerate(names):
            value = deviation.get(name, deviation.get(stems[name], 0.0))
            if value > 0:
                self.where.append(k)
                found.append(value)
        self.deviation = np.array(found)
        self.all = np.zeros(len(names))
        self.all[self.where] = self.deviation

    def add(self, values: Array, row: int, rng: np.random.Generator) -> None:
        """Onto row of values (n, names), in place."""
        if self.where:
            values[row, self.where] += self.deviation * rng.standard_normal(len(self.where))


class Accelerometers:
    """Accelerometers of n rows at p places with a bandwidth: the mean acceleration of every control period, from the
    velocities at its ends, through a Butterworth low-pass of the second order at the control period.

    bandwidth: Hz, below half of the control rate. Attributes: state (n, 3, p), all that the next reading depends on:
    the last velocities and the filter's. Raises InputError.
    """

    def __init__(self, bandwidth: float, period: float, n: int, places: int) -> None:
        require_positive("accelerometers", bandwidth=bandwidth)
        if bandwidth >= 0.5 / period:
            raise InputError(f"bandwidth is {bandwidth} Hz; allowed: below {0.5 / period:g}, half of the control rate")
        self._b, self._a = (part.tolist() for part in butter(2, bandwidth, fs=1 / period))
        self._period = period
        self.state = np.zeros((n, 3, places))

    def read(self, velocity: Array, fresh: Sequence[int] | None = None) -> Array:
        """(rows, p) m/s2 from velocities (rows, p) m/s; fresh: rows that have just started, None: all, a period on."""
        if fresh is not None:
            self.state[list(fresh)] = 0.0
            self.state[list(fresh), 0] = velocity
            return np.zeros_like(velocity)
        last, first, second = self.state[:, 0], self.state[:, 1], self.state[:, 2]
        mean = (velocity - last) / self._period
        found = self._b[0] * mean + first
        self.state[:, 0] = velocity
        self.state[:, 1] = self._b[1] * mean - self._a[1] * found + second
        self.state[:, 2] = self._b[2] * mean - self._a[2] * found
        return np.asarray(found)
