"""The reference numbers of a taut cable with an ideal damper: best viscous, active and ideal semi-active damping.

After Johnson, Baker, Spencer and Fujino, as `mrdamp.structures.cables`. The load w is white noise and
J = (E[int_0^1 v^2 dx])^(1/2) the RMS motion. Six cases: the damper at .01, .02 and .05 of the length, the load spread
evenly or as the first mode; full state, weight of the force squared 1e-3, mode damping .005.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.optimize import minimize_scalar

from mrdamp.compare import tables
from mrdamp.control.lqg import Plant, first_order, regulator_gain
from mrdamp.errors import InputError
from mrdamp.parallel import mapped
from mrdamp.structures import FloatArray
from mrdamp.structures.cables import Load, TautCable


@dataclass(frozen=True)
class ControlledCable(TautCable):
    """A taut cable and linear laws for the damper's force."""

    @cached_property
    def plant(self) -> Plant:
        """First-order form; b per unit of F, e per unit of w."""
        inverse = np.linalg.inv(self.mass)
        rate = np.hstack([-inverse @ self.stiffness, -inverse @ self.damping])
        return first_order(rate, inverse @ self.at_damper, inverse @ self.forcing)

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


def semi_active(
    cable: ControlledCable,
    gain: FloatArray,
    *,
    period: float,
    duration: float = 300.0,
    runs: int = 32,
) -> tuple[float, float]:
    """J and RMS force of an ideal semi-active damper: F = -gain s where that takes energy out, else none.

    The states are known. period: of control, the force is held over it (the fundamental's period is 2 pi); cable and
    noise in between are stepped exactly. duration: of each of `runs` runs, the first tenth left out. A
    force that turns the damper's velocity round within a period continues to the period's end and adds energy.
    """
    p, n = cable.plant, len(cable.plant.b)
    block = np.zeros((n + 2, n + 2))
    block[:n] = np.column_stack([p.a, p.b, p.e]) * period
    e = expm(block)
    b, noise = e[:n, n], e[:n, n + 1 :] / math.sqrt(period)
    # One product a period: the state without the force, the wanted force, the velocity, and the velocity at the end.
    rows = np.vstack([e[:n, :n], -gain, cable.velocity_row])
    rng = np.random.default_rng(0)
    steps, skip = round(duration / period), round(0.1 * duration / period)
    s = np.zeros((n, runs))
    motion = np.zeros((len(cable.cost_factor), runs))
    squares = np.zeros(2)  # of motion and force
    for k in range(steps):
        out = rows @ s
        free = out[:n] + noise * rng.standard_normal(runs)
        wanted = out[n]
        velocity = out[n + 1]
        force = np.where(wanted * velocity < 0, wanted, 0.0)
        s = free + b[:, None] * force
        if k >= skip:
            np.matmul(cable.cost_factor, s, out=motion)
            squares += np.vdot(motion, motion), force @ force
    mean = squares / ((steps - skip) * runs)
    return math.sqrt(mean[0]), math.sqrt(mean[1])


def reference_result(cable: ControlledCable) -> dict[str, float]:
    """The published comparison of one cable: the best dashpot's constant, RMS motions over that with it, and the
    semi-active RMS force over its."""
    c = cable.best_viscous()
    best, best_force = cable.rms(c * cable.velocity_row)
    gain = cable.optimal_gain()
    motion, force = semi_active(cable, gain, period=PERIOD)
    return {
        "best_viscous": c,
        "uncontrolled": cable.rms(np.zeros_like(gain))[0] / best,
        "active": cable.rms(gain)[0] / best,
        "semi_active": motion / best,
        "force": force / best_force,
    }


#: Of control, where the fundamental's period is 2 pi. The semi-active figure depends on it: docs/control.md.
PERIOD = 1e-3
Case = tuple[float, Load]

#: Motion over the best viscous damper's: uncontrolled, active, ideal semi-active.
REFERENCE: Mapping[Case, tuple[float, float, float]] = {
    (0.01, "uniform"): (1.42394, 0.23456, 0.30638),
    (0.02, "uniform"): (1.75931, 0.28434, 0.36515),
    (0.05, "uniform"): (2.55905, 0.39485, 0.47643),
    (0.01, "mode1"): (1.42127, 0.23670, 0.30318),
    (0.02, "mode1"): (1.75247, 0.28735, 0.36361),
    (0.05, "mode1"): (2.53414, 0.39992, 0.47837),
}
COLUMNS = ("uncontrolled", "active", "semi-active")
_FOUND = ("uncontrolled", "active", "semi_active")


@dataclass(frozen=True)
class TableRow:
    """A case: what was found and the deviations from the reference, percent, as COLUMNS."""

    case: Case
    found: Mapping[str, float]
    deviation: tuple[float, ...]


def table(jobs: int = 1, progress: Callable[[str, float], None] | None = None) -> tuple[TableRow, ...]:
    """The six cases."""
    cases = tuple(REFERENCE)
    results = mapped(reference_result, [(ControlledCable(at, load=load),) for at, load in cases], jobs)
    rows = []
    for k, (case, found) in enumerate(zip(cases, results, strict=True), start=1):
        if progress:
            progress("cable", k / len(cases))
        deviation = tuple(100 * (found[name] / r - 1) for name, r in zip(_FOUND, REFERENCE[case], strict=True))
        rows.append(TableRow(case, found, deviation))
    return tuple(rows)


def shown(rows: Sequence[TableRow]) -> tables.Table:
    """Ratios with the deviation from the reference in percent."""
    heads = ("x_d / L, load", "best viscous", *COLUMNS, "semi-active force")
    body = []
    for row in rows:
        f = row.found
        cells = (f"{f[name]:.4f} ({d:+.2f})" for name, d in zip(_FOUND, row.deviation, strict=True))
        body.append((f"{row.case[0]:g}, {row.case[1]}", f"{f['best_viscous']:.3f}", *cells, f"{f['force']:.2f}"))
    note = (
        "RMS motion over that with the best viscous damper, in parentheses the deviation from the reference in "
        "percent; the force over the best viscous damper's RMS force. White noise, full state, control period "
        f"{PERIOD:g} of a fundamental period of 2 pi."
    )
    return tables.Table(heads, body, note)


def to_dict(rows: Sequence[TableRow]) -> list[dict[str, Any]]:
    return [
        {"damper_at": row.case[0], "load": row.case[1], **row.found, "deviation_percent": row.deviation}
        for row in rows
    ]
