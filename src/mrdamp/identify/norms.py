"""Figures of error between a measured and a simulated force; all take arrays (n,) of one length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrdamp.errors import InputError
from mrdamp.model.core import Array
from mrdamp.records import Record

#: m; the foam-damper paper counts in centimetres, and E_x and E_v carry the root of the unit.
CENTIMETRE = 0.01
CUTOFF = 80.0  # Hz, the foam-damper paper's low-pass


@dataclass(frozen=True)
class FoamNorms:
    """E_t, E_x, E_v of Zapateiro et al. (foam-damper paper), Eq. (9): errors in time, displacement and velocity.

    e_t has no unit; e_x is in (length unit / s)^(1/2) and e_v in (length unit / s^2)^(1/2).
    """

    e_t: float
    e_x: float
    e_v: float


def rmse(measured: Array, simulated: Array) -> float:
    """Root of the mean squared difference, in the force's unit; self-sensing paper (Chen, Ni, Or), Eq. (10)."""
    measured, simulated = _pair(measured, simulated)
    return float(np.sqrt(np.mean((measured - simulated) ** 2)))


def nrmse(measured: Array, simulated: Array) -> float:
    """RMS difference over the standard deviation of the measured force."""
    return rmse(measured, simulated) / _deviation(np.asarray(measured, dtype=float))


def delta_1(reference: Array, force: Array) -> float:
    """RMS difference over the standard deviation of the reference; self-sensing paper, Eq. (2)."""
    return nrmse(reference, force)


def delta_2(reference: Array, force: Array) -> float:
    """RMS difference over the RMS of the reference, its mean left in; self-sensing paper, Eq. (4)."""
    size = float(np.sqrt(np.mean(np.asarray(reference, dtype=float) ** 2)))
    if not size > 0:
        raise InputError("the reference force is zero throughout; an error relative to it has no meaning")
    return rmse(reference, force) / size


def foam_norms(
    dt: float,
    measured: Array,
    simulated: Array,
    velocity: Array,
    acceleration: Array,
    length_unit: float = 1.0,
) -> FoamNorms:
    """Eq. (9) of the foam-damper paper, by the trapezoidal rule.

    dt (s); velocity (m/s) and acceleration (m/s2), (n,); length_unit: 1 for m, 0.01 for the paper's cm.
    e^2 = 1/T int (F - F_hat)^2 w dt with w = 1, |dx/dt|, |dv/dt|, each over the standard deviation of F.
    """
    measured, simulated = _pair(measured, simulated)
    squared = (measured - simulated) ** 2
    deviation = _deviation(measured)
    total = dt * (len(measured) - 1)

    def norm(weight: Array) -> float:
        return float(np.sqrt(np.trapezoid(squared * weight, dx=dt) / total) / deviation)

    v, a = (np.abs(np.asarray(x, dtype=float)) / length_unit for x in (velocity, acceleration))
    return FoamNorms(norm(np.ones_like(squared)), norm(v), norm(a))


def record_norms(record: Record, simulated: Array, length_unit: float = 1.0) -> FoamNorms:
    """Eq. (9) for a record and a simulated force (n,) N.

    Velocity and acceleration as in the foam-damper paper's Section 4, where they were not measured: central differences
    of the displacement after its low-pass at 80 Hz, where the rate allows that cut-off.
    """
    cutoff = CUTOFF if 0.45 / record.sample_time > CUTOFF else None
    return foam_norms(
        record.sample_time,
        record.channel("force_N"),
        simulated,
        record.velocity(cutoff),
        record.acceleration(cutoff),
        length_unit,
    )


def _pair(measured: Array, simulated: Array) -> tuple[Array, Array]:
    a, b = np.asarray(measured, dtype=float), np.asarray(simulated, dtype=float)
    if a.shape != b.shape or a.ndim != 1 or len(a) < 2:
        raise InputError(f"forces of shapes {a.shape} and {b.shape} cannot be compared; allowed: twice (n,)")
    return a, b


def _deviation(force: Array) -> float:
    deviation = float(np.std(force))
    if not deviation > 0:
        raise InputError("channel force_N is constant; an error relative to its deviation has no meaning")
    return deviation
