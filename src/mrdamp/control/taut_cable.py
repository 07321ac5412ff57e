"""A taut cable with an ideal damper, without dimensions: best viscous, active and semi-active control of its motion.

Johnson, Baker, Spencer and Fujino, J. Eng. Mech. 133 (2007) 1-11, doi 10.1061/(ASCE)0733-9399(2007)133:1(1). Length,
mass per length 1 and tension 1/pi^2, so that mode n has the circular frequency n. The motion is the static shape
under a force at the damper and the first sines:

    v(x, t) = q_0(t) min(x / x_d, (1 - x) / (1 - x_d)) + sum_n q_n(t) sin(n pi x)
    M q'' + C q' + K q = phi F + p w(t),     J = (E[int_0^1 v^2 dx])^(1/2)

F is the damper's force on the cable, w white noise, J the RMS motion. With the sines alone hundreds are needed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.linalg import block_diag, eigh, expm, solve_continuous_lyapunov
from scipy.optimize import minimize_scalar

from mrdamp.control.lqg import regulator_gain
from mrdamp.control.plant import Plant
from mrdamp.errors import InputError
from mrdamp.structures import FloatArray

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
            raise InputError(f"cable: damping ratio {self.ratio}, {self.modes} modes; allowed: 0 to 1, 1 or more")
        if self.load not in ("uniform", "mode1"):
            raise InputError(f"cable: load {self.load!r}; allowed: uniform, mode1")

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
    def plant(self) -> Plant:
        """First-order form; b per unit of F, e per unit of w."""
        n = self.modes + 1
        inverse = np.linalg.inv(self.mass)
        a = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ self.stiffness, -inverse @ self.damping]])
        zero = np.zeros(n)
        return Plant(
            a, np.concatenate([zero, inverse @ self.at_damper]), np.concatenate([zero, inverse @ self.forcing])
        )

    @cached_property
    def velocity_row(self) -> FloatArray:
        """(2N+2,) the velocity at the damper."""
        return np.concatenate([np.zeros(self.modes + 1), self.at_damper])

    @cached_property
    def cost_factor(self) -> FloatArray:
        """h (N+1, 2N+2) with |h s|^2 = int v^2 dx."""
        lower = np.linalg.cholesky(self.mass)
        return np.hstack([lower.T, np.zeros_like(lower)])

    def rms(self, gain: FloatArray) -> tuple[float, float]:
        """J and the RMS force under F = -gain s, gain (2N+2,), in white noise of intensity one.

        Raises InputError where the cable is unstable under that gain.
        """
        p = self.plant
        closed = p.a - np.outer(p.b, gain)
        if np.linalg.eigvals(closed).real.max() >= 0:
            raise InputError("cable: unstable under this gain")
        covariance = solve_continuous_lyapunov(closed, -np.outer(p.e, p.e))
        motion = np.trace(self.cost_factor @ covariance @ self.cost_factor.T)
        return math.sqrt(motion), math.sqrt(max(gain @ covariance @ gain, 0.0))

    def optimal_gain(self, r: float = 1e-3) -> FloatArray:
        """(2N+2,) of the active force F = -gain s that minimises E[int v^2 dx + r F^2]."""
        h, p = self.cost_factor, self.plant
        return regulator_gain(p.a, p.b, h, np.zeros(len(h)), np.ones(len(h)), r)

    def best_viscous(self) -> float:
        """The dashpot's constant with the least J."""
        # The best one goes as 1 / x_d: kappa = c n x_d of about 0.1 for a mode.
        near = 0.1 / self.damper_at
        found = minimize_scalar(
            lambda c: self.rms(c * self.velocity_row)[0], bounds=(0.2 * near, 5 * near), method="bounded"
        )
        return float(found.x)


@dataclass(frozen=True)
class CableResult:
    """RMS motion over that with the best viscous damper, and RMS force over its."""

    best_viscous: float  # the dashpot's constant
    uncontrolled: float
    active: float
    semi_active: float
    force: float  # of the semi-active damper


def semi_active(
    cable: TautCable,
    gain: FloatArray,
    *,
    period: float,
    duration: float = 300.0,
    runs: int = 32,
    seed: int = 0,
    locking: bool = False,
) -> tuple[float, float]:
    """J and RMS force of an ideal semi-active damper: F = -gain s where that takes energy out, else none.

    The states are known. period: of control, the force is held over it (the fundamental's period is 2 pi); cable and
    noise in between are stepped exactly. duration: of each of `runs` runs, the first tenth left out. locking: a force
    that would turn the damper's velocity round within a period is cut to what stops it, which is the limit that
    shorter and shorter periods tend to; without it the force goes on to the period's end and puts energy in.
    """
    p, n = cable.plant, len(cable.plant.b)
    block = np.zeros((n + 2, n + 2))
    block[:n] = np.column_stack([p.a, p.b, p.e]) * period
    e = expm(block)
    b, noise = e[:n, n], e[:n, n + 1 :] / math.sqrt(period)
    # One product a period: the state without the force, the wanted force, the velocity, and the velocity at the end.
    rows = np.vstack([e[:n, :n], -gain, cable.velocity_row])
    stop = cable.velocity_row @ b
    rng = np.random.default_rng(seed)
    steps, skip = round(duration / period), round(0.1 * duration / period)
    s = np.zeros((n, runs))
    motion = np.zeros((len(cable.cost_factor), runs))
    squares = np.zeros(2)  # of motion and force
    for k in range(steps):
        out = rows @ s
        free = out[:n] + noise * rng.standard_normal(runs)
        wanted = out[n]
        if locking:
            velocity = cable.velocity_row @ free
            largest = np.abs(velocity / stop)
            wanted = np.clip(wanted, -largest, largest)
        else:
            velocity = out[n + 1]
        force = np.where(wanted * velocity < 0, wanted, 0.0)
        s = free + b[:, None] * force
        if k >= skip:
            np.matmul(cable.cost_factor, s, out=motion)
            squares += np.vdot(motion, motion), force @ force
    mean = squares / ((steps - skip) * runs)
    return math.sqrt(mean[0]), math.sqrt(mean[1])


def reference_result(cable: TautCable, *, period: float, r: float = 1e-3, seed: int = 0) -> CableResult:
    """The published comparison of one cable; arguments as for `semi_active` and `optimal_gain`."""
    c = cable.best_viscous()
    best, best_force = cable.rms(c * cable.velocity_row)
    gain = cable.optimal_gain(r)
    motion, force = semi_active(cable, gain, period=period, seed=seed)
    return CableResult(
        best_viscous=c,
        uncontrolled=cable.rms(np.zeros_like(gain))[0] / best,
        active=cable.rms(gain)[0] / best,
        semi_active=motion / best,
        force=force / best_force,
    )
