"""Stay cables with a damper near the anchorage: matrices in a few coordinates, natural modes, sag.

    m v_tt + c v_t - T v_xx + (h's share) = f(x, t) - F(t) delta(x - x_d)

v(x, t) m is the motion from the sagged shape at rest, across the chord; F N the damper's force, positive as a load
cell reads it when the damper is being extended (v(x_d) rising). The coordinates are the static shape under a force at
the damper and the first sines, `TautCable`: Johnson, Baker, Spencer and Fujino, J. Eng.
Mech. 133 (2007) 1-11, doi 10.1061/(ASCE)0733-9399(2007)133:1(1). Sag adds to them, as in Johnson, Christenson and
Spencer, Comput.-Aided Civ. Infrastruct. Eng. 18 (2003) 132-146, doi 10.1111/1467-8667.00305, the pull h that the
stretching of a flat-sag cable causes (Irvine, Cable Structures, MIT Press 1981, ch. 3)::

    K_ij = T int psi_i' psi_j' dx + lambda^2 (T / L^3) int psi_i dx int psi_j dx
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.linalg import block_diag, eigh

from mrdamp.errors import InputError, require_one_of, require_positive
from mrdamp.structures import FloatArray
from mrdamp.structures.lumped import Mechanics

Load = Literal["uniform", "mode1"]
TENSION = 1 / math.pi**2


@dataclass(frozen=True)
class TautCable:
    """A taut cable with a damper near its anchorage, without dimensions: its matrices.

    Length, mass per length 1 and tension 1/pi^2, so that mode n has the circular frequency n. The motion is the static
    shape under a force at the damper and the first sines:

        v(x, t) = q_0(t) min(x / x_d, (1 - x) / (1 - x_d)) + sum_n q_n(t) sin(n pi x)
        M q'' + C q' + K q = phi F + p w(t)

    F is the damper's force on the cable, w the load. With the sines alone hundreds are needed.

    damper_at: x_d / L, from 0 to 1; ratio: of damping of every mode; modes: sines, N; load: spread evenly, or as
    the first mode. States [q; q'] (2N + 2,). Raises InputError."""

    damper_at: float
    ratio: float = 0.005
    modes: int = 8
    load: Load = "uniform"

    def __post_init__(self) -> None:
        if not 0 < self.damper_at < 1:
            raise InputError(f"cable: damper at {self.damper_at} of the length; allowed: between 0 and 1")
        if not 0 < self.ratio < 1 or self.modes < 1:
            raise InputError(
                f"cable: damping ratio {self.ratio}, {self.modes} modes; allowed: 0 to 1, 1 or more"
            )
        require_one_of("cable", ("uniform", "mode1"), load=self.load)

    @cached_property
    def mass(self) -> FloatArray:
        """(N+1, N+1) int psi_i psi_j dx."""
        n, x = np.arange(1, self.modes + 1), self.damper_at
        m = block_diag(1 / 3, np.eye(self.modes) / 2)
        m[0, 1:] = m[1:, 0] = np.sin(n * np.pi * x) / ((n * np.pi) ** 2 * x * (1 - x))
        return np.asarray(m)

    @cached_property
    def stiffness(self) -> FloatArray:
        """(N+1, N+1) T int psi_i' psi_j' dx."""
        n, x = np.arange(1, self.modes + 1), self.damper_at
        k = TENSION * block_diag(1 / (x * (1 - x)), np.diag((n * np.pi) ** 2 / 2))
        k[0, 1:] = k[1:, 0] = TENSION * np.sin(n * np.pi * x) / (x * (1 - x))
        return np.asarray(k)

    @cached_property
    def damping(self) -> FloatArray:
        """(N+1, N+1) with `ratio` in every mode of the cable without a damper."""
        squared, shapes = eigh(self.stiffness, self.mass)
        back = self.mass @ shapes
        return np.asarray(back @ np.diag(2 * self.ratio * np.sqrt(squared)) @ back.T)

    @cached_property
    def at_damper(self) -> FloatArray:
        """phi (N+1,), the shapes where the damper is."""
        return np.concatenate([[1.0], np.sin(np.arange(1, self.modes + 1) * np.pi * self.damper_at)])

    @cached_property
    def forcing(self) -> FloatArray:
        """p (N+1,), the load's shape against each of the cable's."""
        if self.load == "mode1":
            return np.asarray(self.mass[:, 1])
        n = np.arange(1, self.modes + 1)
        return np.concatenate([[0.5], (1 - np.cos(n * np.pi)) / (n * np.pi)])

    @cached_property
    def velocity_row(self) -> FloatArray:
        """(2N+2,) the velocity at the damper."""
        return np.concatenate([np.zeros(self.modes + 1), self.at_damper])

    @cached_property
    def cost_factor(self) -> FloatArray:
        """h (N+1, 2N+2) with |h s|^2 = int v^2 dx."""
        lower = np.linalg.cholesky(self.mass)
        return np.hstack([lower.T, np.zeros_like(lower)])


@dataclass(frozen=True)
class StayCable:
    """A cable, its damper's place and its motion's coordinates.

    length: m, of the chord. tension: N, along the chord. mass: kg/m. damper_at: x_d over the length. ratio: of damping
    of every natural mode without the damper. modes: sines N in addition to the static shape. sag: Irvine's parameter
    lambda^2 (0 is a taut string). Raises InputError.

    The default is the size of a laboratory cable: 12.65 m, 2172 N, 0.747 kg/m, 2.13 Hz.
    """

    length: float = 12.65
    tension: float = 2172.0
    mass: float = 0.747
    damper_at: float = 0.02
    ratio: float = 0.005
    modes: int = 10
    sag: float = 0.0

    def __post_init__(self) -> None:
        require_positive("cable", length=self.length, tension=self.tension, mass=self.mass)
        if not 0 <= self.sag < math.inf:
            raise InputError(f"cable: sag is {self.sag}; allowed: lambda^2 >= 0")
        _ = self.taut  # checks the others

    @cached_property
    def taut(self) -> TautCable:
        """The cable without dimensions and without sag."""
        return TautCable(self.damper_at, self.ratio, self.modes)

    @property
    def first(self) -> float:
        """Circular frequency of the taut string's first mode, rad/s."""
        return math.pi / self.length * math.sqrt(self.tension / self.mass)

    @cached_property
    def areas(self) -> FloatArray:
        """(N+1,) m, int psi_j dx."""
        return np.asarray(self.length * self.taut.forcing)

    @cached_property
    def mass_matrix(self) -> FloatArray:
        """(N+1, N+1) kg."""
        return np.asarray(self.mass * self.length * self.taut.mass)

    @cached_property
    def stiffness_matrix(self) -> FloatArray:
        """(N+1, N+1) N/m, with the sag's share."""
        string = self.tension / self.length * self.taut.stiffness / TENSION
        stretch = self.sag * self.tension / self.length**3 * np.outer(self.areas, self.areas)
        return np.asarray(string + stretch)

    @cached_property
    def _natural(self) -> tuple[FloatArray, FloatArray]:
        squared, shapes = eigh(self.stiffness_matrix, self.mass_matrix)
        return np.sqrt(squared), np.asarray(shapes)

    @property
    def natural(self) -> FloatArray:
        """(N+1,) rad/s, circular frequencies without the damper, ascending; the last few are no real modes."""
        return self._natural[0]

    @property
    def shapes(self) -> FloatArray:
        """(N+1, N+1) natural modes, one a column, in the coordinates psi; their modal mass is 1 kg."""
        return self._natural[1]

    def coordinates(self, place: FloatArray | float) -> FloatArray:
        """(..., N+1) psi_j at places x / L (...)."""
        x, x_d = np.asarray(place, dtype=np.float64)[..., None], self.damper_at
        sines = np.sin(np.arange(1, self.modes + 1) * np.pi * x)
        return np.concatenate([np.minimum(x / x_d, (1 - x) / (1 - x_d)), sines], axis=-1)

    def at(self, place: FloatArray | float) -> FloatArray:
        """(..., N+1) motion at places x / L (...) per unit of the natural coordinates."""
        return np.asarray(self.coordinates(place) @ self.shapes)

    def load_matrix(self, places: FloatArray) -> FloatArray:
        """(p, N+1) load on the natural coordinates per N/m at places x / L (p,), straight between them.

        Outside the first and the last place the load is constant.
        """
        x = np.linspace(0.0, 1.0, 4001)
        hats = np.array([np.interp(x, places, row) for row in np.eye(len(places))])
        hats[:, [0, -1]] *= 0.5  # the trapezoidal rule
        return np.asarray(self.length / 4000 * hats @ self.at(x))

    @cached_property
    def mechanics(self) -> Mechanics:
        """In the natural coordinates, each under a load of its own, N."""
        w = self.natural
        unit = np.eye(len(w))
        return Mechanics(unit, np.diag(2 * self.ratio * w), np.diag(w * w), self.at(self.damper_at), unit)

    def forces(self, force: FloatArray, places: FloatArray) -> FloatArray:
        """(samples, N+1) N on the natural coordinates from a load (samples, p), N/m, at places x / L (p,)."""
        return np.asarray(force @ self.load_matrix(places))
