"""A taut cable with a damper near its anchorage, without dimensions: its matrices.

Johnson, Baker, Spencer and Fujino, J. Eng. Mech. 133 (2007) 1-11, doi 10.1061/(ASCE)0733-9399(2007)133:1(1). Length,
mass per length 1 and tension 1/pi^2, so that mode n has the circular frequency n. The motion is the static shape
under a force at the damper and the first sines:

    v(x, t) = q_0(t) min(x / x_d, (1 - x) / (1 - x_d)) + sum_n q_n(t) sin(n pi x)
    M q'' + C q' + K q = phi F + p w(t)

F is the damper's force on the cable, w the load. With the sines alone hundreds are needed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.linalg import block_diag, eigh

from mrdamp.errors import InputError, require_one_of
from mrdamp.structures.frames import FloatArray

Load = Literal["uniform", "mode1"]
TENSION = 1 / math.pi**2


@dataclass(frozen=True)
class TautCable:
    """damper_at: x_d / L, from 0 to 1; ratio: of damping of every mode; modes: sines, N; load: spread evenly, or as
    the first mode; all without dimensions. States [q; q'] (2N + 2,). Raises InputError."""

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
