"""A linear structure with a damper and loads, as matrices.

    M q'' + C q' + K q = E w - s f,   stroke = s^T q

w are the loads, f (N) is the damper's force, positive when it is being extended.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import eigh

from mrdamp.errors import InputError
from mrdamp.structures.frames import FloatArray


@dataclass(frozen=True, eq=False)
class Mechanics:
    """mass, damping, stiffness (n, n): kg, N s/m, N/m. stroke (n,): of the damper per unit of the coordinates. load
    (n, k): N on the coordinates per unit of each load; absolute: the coordinates are relative to a ground whose
    acceleration is the load, accelerometers then read q'' and the ground's. Raises InputError."""

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    stroke: FloatArray
    load: FloatArray
    absolute: bool = False

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(self.stroke))
        shapes = {"mass": (n, n), "damping": (n, n), "stiffness": (n, n), "stroke": (n,), "load": (n, -1)}
        for name, shape in shapes.items():
            try:
                values = np.array(getattr(self, name), dtype=np.float64).reshape(shape)
            except ValueError:
                raise InputError(f"mechanics: {name} has another shape than {n} coordinates need") from None
            if not np.isfinite(values).all() or (shape == (n, n) and not np.allclose(values, values.T)):
                raise InputError(f"mechanics: {name} must be finite, and a matrix of coordinates symmetric")
            object.__setattr__(self, name, values)
        if np.linalg.eigvalsh(self.mass)[0] <= 0:
            raise InputError("mechanics: mass must be positive definite")

    @cached_property
    def rate(self) -> FloatArray:
        """(n, 2n) accelerations per unit of the coordinates, then of their velocities."""
        return np.asarray(-np.linalg.solve(self.mass, np.hstack([self.stiffness, self.damping])))

    @cached_property
    def push(self) -> FloatArray:
        """(n, 1) accelerations per N of the damper's force."""
        return np.asarray(-np.linalg.solve(self.mass, self.stroke)[:, None])

    @cached_property
    def loaded(self) -> FloatArray:
        """(n, k) accelerations per unit of the loads."""
        return np.asarray(np.linalg.solve(self.mass, self.load))

    @cached_property
    def frequencies(self) -> FloatArray:
        """(n,) rad/s, without damping and without the damper."""
        squares = eigh(self.stiffness, self.mass, eigvals_only=True)
        return np.asarray(np.sqrt(np.maximum(squares, 0.0)))
