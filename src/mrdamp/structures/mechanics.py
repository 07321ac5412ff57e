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

_SINGULAR = 1e-13  # of the largest eigenvalue; what is left of a zero after rounding

_ROUNDING = 1e-9  # of poles, over the largest


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
        n = np.size(self.stroke)
        if np.ndim(self.stroke) > 1:
            raise InputError(f"mechanics: stroke has the shape {np.shape(self.stroke)}; allowed: (n,), of one damper")
        square = ("mass", "damping", "stiffness")
        for name in (*square, "stroke", "load"):
            shape = (n, n) if name in square else (n,)
            try:
                if np.iscomplexobj(getattr(self, name)):
                    raise TypeError  # else NumPy drops what is imaginary
                values = np.array(getattr(self, name), dtype=np.float64)
            except (TypeError, ValueError):
                raise InputError(f"mechanics: {name} is no array of real numbers; allowed: {shape}") from None
            if not n or values.shape[: len(shape)] != shape or values.ndim > 2:
                allowed = f"({n}, loads)" if name == "load" else shape
                said = f"mechanics: {name} has the shape {values.shape}; allowed with {n} coordinates in stroke"
                raise InputError(f"{said}: {allowed}")
            if not np.isfinite(values).all():
                raise InputError(f"mechanics: {name} holds NaN or infinity; allowed: finite numbers")
            if name in square and not np.allclose(values, values.T):
                raise InputError(f"mechanics: {name} is not symmetric")
            object.__setattr__(self, name, values.reshape(n, -1) if name == "load" else values)
        for name in ("mass", "stiffness"):
            sizes = np.linalg.eigvalsh(getattr(self, name))
            if sizes[0] <= _SINGULAR * sizes[-1]:
                raise InputError(
                    f"mechanics: {name} is not positive definite: its eigenvalues are from {sizes[0]:.3g} to "
                    f"{sizes[-1]:.3g}"
                )
        if not self.stroke.any():
            raise InputError("mechanics: stroke is zero throughout; the damper would do nothing")
        # With a damping that is nowhere negative nothing grows.
        if np.linalg.eigvalsh(self.damping)[0] < 0:
            poles = np.linalg.eigvals(np.vstack([np.eye(n, 2 * n, n), self.rate]))
            if poles.real.max() > _ROUNDING * np.abs(poles).max():
                raise InputError(
                    "mechanics: damping is negative: without the damper the structure is unstable, a motion grows with "
                    f"{poles.real.max():.3g} 1/s"
                )

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
