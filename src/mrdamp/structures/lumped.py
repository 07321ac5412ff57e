"""Shear frames, floors in a chain with one damper between two of them; quarter cars, frames of two floors; and any
linear structure with a damper and loads, as matrices.

    M x'' + C x' + K x = Gamma f - M Lambda xg''        a frame
    M q'' + C q' + K q = E w - s f,   stroke = s^T q    any other

x (N,) floor displacements to the ground (m), xg'' ground acceleration (m/s2), Lambda a vector
of ones. The damper's force f (N) is positive as a load cell reads it when the damper is being
extended. It pulls on the structure with the opposite sign: an extending damper drags its rod
end back, so Gamma is -1 at the floor of the rod end (`damper_between[1]`) and +1 at the other.
w are the loads.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh

from mrdamp.errors import InputError, require_positive

FloatArray = NDArray[np.float64]

GRAVITY = 9.80665  # m/s2, for the weight alone


@dataclass(frozen=True, eq=False)
class ShearFrame:
    """A frame of N storeys, counted from the ground up; floor 0 is the ground.

    mass: (N,) kg, floors 1..N. stiffness: (N,) N/m and damping: (N,) N s/m, storeys 1..N
    (storey 1 joins the ground to floor 1). damper_between: the floors the damper stands
    between; its stroke is the displacement of the second less that of the first. others: those of
    further dampers.
    Sequences are turned into read-only arrays. Raises InputError on unequal lengths, on a
    mass or stiffness that is not positive, on negative damping, on floors that do not exist.
    """

    mass: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    damper_between: tuple[int, int] = (0, 1)
    others: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        for name in ("mass", "stiffness", "damping"):
            object.__setattr__(self, name, _vector(name, getattr(self, name)))
        n = len(self.mass)
        for name in ("stiffness", "damping"):
            if len(getattr(self, name)) != n:
                raise InputError(
                    f"structure: {name} has {len(getattr(self, name))} values and mass has {n}; "
                    "give one mass, stiffness and damping per storey"
                )
        for name, allowed in (("mass", "> 0"), ("stiffness", "> 0"), ("damping", ">= 0")):
            values: FloatArray = getattr(self, name)
            bad = np.flatnonzero(values < 0 if allowed == ">= 0" else values <= 0)
            if len(bad):
                raise InputError(
                    f"structure: {name} of storey {bad[0] + 1} is {values[bad[0]]:g}; allowed: {allowed}"
                )
        object.__setattr__(self, "damper_between", _floors(self.damper_between, n))
        object.__setattr__(self, "others", tuple(_floors(floors, n) for floors in self.others))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ShearFrame):
            return NotImplemented
        return self.to_dict() == other.to_dict() and self.places == other.places

    def __hash__(self) -> int:
        return hash(
            (self.mass.tobytes(), self.stiffness.tobytes(), self.damping.tobytes(), self.places)
        )

    @property
    def storeys(self) -> int:
        return len(self.mass)

    @property
    def mass_matrix(self) -> FloatArray:
        """(N, N) kg."""
        return np.diag(self.mass)

    @property
    def damping_matrix(self) -> FloatArray:
        """(N, N) N s/m, the chain form."""
        return _chain(self.damping)

    @property
    def stiffness_matrix(self) -> FloatArray:
        """(N, N) N/m, the chain form."""
        return _chain(self.stiffness)

    @property
    def places(self) -> tuple[tuple[int, int], ...]:
        """The floors of every damper."""
        return (self.damper_between, *self.others)

    @property
    def gamma(self) -> FloatArray:
        """(N,) the floors on which the damper's force acts, with its signs (see the module); (N, m) of several."""
        g = np.zeros((self.storeys + 1, len(self.places)))
        for k, (lower, upper) in enumerate(self.places):
            g[lower, k], g[upper, k] = 1.0, -1.0
        return g[1:] if self.others else g[1:, 0]

    @property
    def weight(self) -> float:
        """N, of all floors."""
        return float(self.mass.sum()) * GRAVITY

    @property
    def frequencies(self) -> FloatArray:
        """(N,) Hz, undamped and without the damper, ascending."""
        return np.asarray(np.sqrt(eigh(self.stiffness_matrix, self.mass_matrix)[0]) / (2 * np.pi))

    def displacement(self, drift: ArrayLike) -> FloatArray:
        """(..., N) floor displacements to the ground from (..., N) storey drifts, m."""
        return np.asarray(np.cumsum(np.asarray(drift, dtype=np.float64), axis=-1))

    def stroke(self, displacement: ArrayLike) -> FloatArray:
        """(...) piston displacement, extension positive, from (..., N) floor displacements, m; (..., m) of several."""
        return np.asarray(np.asarray(displacement, dtype=np.float64) @ -self.gamma)

    def to_dict(self) -> dict[str, list[float]]:
        """The `structure` entry of a case.json; `damper_between` is an entry next to it there."""
        return {
            "mass_kg": self.mass.tolist(),
            "stiffness_n_m": self.stiffness.tolist(),
            "damping_n_s_m": self.damping.tolist(),
        }

    @classmethod
    def from_dict(
        cls, structure: Mapping[str, Any], damper_between: Any = (0, 1), where: str = "structure"
    ) -> ShearFrame:
        """A frame from the `structure` and `damper_between` entries of a case.json.

        where: how error messages name the source. Raises InputError.
        """
        keys = ("mass_kg", "stiffness_n_m", "damping_n_s_m")
        if not isinstance(structure, Mapping):
            raise InputError(
                f"{where}: structure is {structure!r}; allowed: an object with {', '.join(keys)}"
            )
        for key in keys:
            if key not in structure:
                raise InputError(f"{where}: structure has no {key}; needed: {', '.join(keys)}")
        try:
            return cls(structure[keys[0]], structure[keys[1]], structure[keys[2]], damper_between)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None


def dyke1996(damper_between: tuple[int, int] = (0, 1)) -> ShearFrame:
    """The three-storey test frame of Dyke, Spencer, Sain and Carlson, damper under floor 1.

    98.3 kg a floor; 5.16e5, 6.84e5, 6.84e5 N/m; 125, 50, 50 N s/m; 5.44, 15.81, 23.63 Hz.
    Source: Smart Materials and Structures 5 (1996) 565-575, doi 10.1088/0964-1726/5/5/006.
    Departure: the paper prints K22 = 13.7e5 N/m; the chain's 2 x 6.84e5 is used, as
    the rounded figure would tie floor 2 to the ground with 2000 N/m.
    """
    return ShearFrame(
        mass=np.array([98.3, 98.3, 98.3]),
        stiffness=np.array([5.16e5, 6.84e5, 6.84e5]),
        damping=np.array([125.0, 50.0, 50.0]),
        damper_between=damper_between,
    )


def _chain(values: FloatArray) -> FloatArray:
    """(N, N) matrix of N springs (or dashpots) in a chain, the first one to the ground."""
    return np.asarray(
        np.diag(values + np.append(values[1:], 0.0)) - np.diag(values[1:], 1) - np.diag(values[1:], -1)
    )


def _vector(name: str, values: ArrayLike) -> FloatArray:
    try:
        vector = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(
            f"structure: {name} is {values!r}; allowed: a list of numbers, one per storey"
        ) from None
    if vector.ndim != 1 or not len(vector):
        raise InputError(
            f"structure: {name} has shape {vector.shape}; allowed: a list of numbers, one per storey"
        )
    if not np.isfinite(vector).all():
        at = int(np.flatnonzero(~np.isfinite(vector))[0])
        raise InputError(f"structure: {name} of storey {at + 1} is {vector[at]}; allowed: a finite number")
    vector.setflags(write=False)
    return vector


def _floors(floors: Any, storeys: int) -> tuple[int, int]:
    whole = isinstance(floors, (list, tuple)) and len(floors) == 2
    whole = whole and all(isinstance(f, (int, np.integer)) and not isinstance(f, bool) for f in floors)
    if not whole or floors[0] == floors[1] or not all(0 <= f <= storeys for f in floors):
        raise InputError(
            f"damper_between is {floors!r}; allowed: two different floor numbers from 0 (ground) to {storeys}"
        )
    return int(floors[0]), int(floors[1])


@dataclass(frozen=True)
class QuarterCar:
    """Heights are those over the rest position, so that weights appear in one place only: where the tyre lifts off.

        m_b z_b'' = -k (z_b - z_w) - c (z_b' - z_w') - f
        m_w z_w'' = k (z_b - z_w) + c (z_b' - z_w') + f + F - F_0
        F = max(0, F_0 - k_t (z_w - w) - c_t (z_w' - w')),  F_0 = (m_b + m_w) g

    w (m) the road, f (N) the damper, positive where it is being extended, F (N) what the road carries: a tyre pushes
    and never pulls. body, wheel: kg; stiffness, tyre_stiffness: N/m; damping (of the suspension, parallel to the
    damper) and tyre_damping: N s/m.

    Masses and stiffnesses: table 1 of the semi-active quarter car with an MR damper of doi 10.1155/2021/8084343. The
    tyre's damping, which it does not have, is 2 % of critical of the wheel on its tyre. Raises InputError.
    """

    body: float = 400.0
    wheel: float = 40.0
    stiffness: float = 20_000.0
    tyre_stiffness: float = 210_000.0
    damping: float = 0.0
    tyre_damping: float = 120.0

    def __post_init__(self) -> None:
        sizes = ("body", "wheel", "stiffness", "tyre_stiffness")
        require_positive("car", **{name: getattr(self, name) for name in sizes})
        for name, value in (("damping", self.damping), ("tyre_damping", self.tyre_damping)):
            if not 0 <= value < math.inf:
                raise InputError(f"car: {name} is {value}; allowed: >= 0")

    @property
    def frame(self) -> ShearFrame:
        """The same as a frame of two storeys, whose ground is the road: floor 1 the wheel, floor 2 the body."""
        return ShearFrame(
            np.array([self.wheel, self.body]),
            np.array([self.tyre_stiffness, self.stiffness]),
            np.array([self.tyre_damping, self.damping]),
            (1, 2),
        )

    @property
    def weight(self) -> float:
        """N, what the road carries at rest."""
        return (self.body + self.wheel) * GRAVITY

    @property
    def bounce(self) -> float:
        """rad/s, of the body on its spring over a wheel that stands still."""
        return math.sqrt(self.stiffness / self.body)

    @property
    def critical_damping(self) -> float:
        """N s/m, of the body on its spring."""
        return 2 * self.body * self.bounce

    def tyre_load(self, deflection: FloatArray, rate: FloatArray) -> FloatArray:
        """F (...) N from z_w - w (...) m and its rate (...) m/s."""
        force = self.weight - self.tyre_stiffness * deflection - self.tyre_damping * rate
        return np.maximum(force, 0.0)

    def passive(self, damping: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """State space (a, b, c, d) of the car with a dashpot of `damping` (N s/m) in the damper's place, and a tyre
        that always holds contact: from the road's velocity (m/s) to the body's acceleration (m/s2), the dynamic tyre
        load over the weight, and the stroke (m). States: z_w - w, z_b - z_w, z_w', z_b'."""
        k, c, kt, ct = self.stiffness, self.damping + damping, self.tyre_stiffness, self.tyre_damping
        lift = np.array([-kt, 0.0, -ct, 0.0])  # dynamic tyre load, without the road's share
        strut = np.array([0.0, k, -c, c])
        a = np.vstack(
            [[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 1.0], (lift + strut) / self.wheel, -strut / self.body]
        )
        b = np.array([[-1.0], [0.0], [ct / self.wheel], [0.0]])
        out = np.vstack([-strut / self.body, lift / self.weight, [0.0, 1.0, 0.0, 0.0]])
        return a, b, out, np.array([[0.0], [ct / self.weight], [0.0]])


_SINGULAR = 1e-13  # of the largest eigenvalue; what is left of a zero after rounding
_ROUNDING = 1e-9  # of poles, over the largest


@dataclass(frozen=True, eq=False)
class Mechanics:
    """mass, damping, stiffness (n, n): kg, N s/m, N/m. stroke (n,): of the damper per unit of the coordinates. load
    (n, k): N on the coordinates per unit of each load; absolute: the coordinates are relative to a ground whose
    acceleration is the first load, accelerometers then read q'' and the ground's. Raises InputError."""

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

    @property
    def grounds(self) -> int:
        """Loads, from the first on, that are the ground's acceleration."""
        return int(self.absolute)

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
