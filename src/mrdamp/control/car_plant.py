"""A quarter car as controllers see it: its linear plant, its measurements, and what is regulated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from mrdamp.control.plant import Linear, Plant
from mrdamp.errors import InputError
from mrdamp.structures import FloatArray
from mrdamp.structures.cars import QuarterCar

#: Of white noise on what the Kalman filter gets, per sample: wheel and body, m/s2, stroke, m.
MEASURED = {"acceleration_1": 0.5, "acceleration_2": 0.05, "stroke": 2e-4}


def car_plant(car: QuarterCar) -> Plant:
    """States z_w - w, z_b - z_w, z_w', z_b'; e (4,) per m/s of the road's velocity, which is white noise on a road of
    ISO 8608."""
    a, e, _, _ = car.passive(0.0)
    return Plant(a, np.array([0.0, 0.0, 1 / car.wheel, -1 / car.body]), e[:, 0])


def car_outputs(car: QuarterCar, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Rows c (p, 4) and feedthrough d (p,) of measurements by name. Raises InputError."""
    linear = car_plant(car)
    rows = {
        "acceleration_1": (linear.a[2], linear.b[2]),
        "acceleration_2": (linear.a[3], linear.b[3]),
        "drift_1": (np.array([1.0, 0.0, 0.0, 0.0]), 0.0),
        "stroke": (np.array([0.0, 1.0, 0.0, 0.0]), 0.0),
        "stroke_velocity": (np.array([0.0, 0.0, -1.0, 1.0]), 0.0),
    }
    unknown = [name for name in names if name not in rows]
    if unknown:
        raise InputError(f"measurement {unknown[0]!r} is unknown; allowed: {', '.join(rows)}")
    return np.array([rows[name][0] for name in names]), np.array([rows[name][1] for name in names])


def regulated(car: QuarterCar, holding: float, stroke: float) -> dict[str, float]:
    """Weights of body acceleration, tyre deflection and stroke.

    Each of the last two is weighed against an acceleration of 1 m/s2: holding, per (m_b 1 m/s2 / k_t)^2 of deflection;
    stroke, per (1 m/s2 over the square of the bounce's frequency)^2.
    """
    return {
        "acceleration_2": 1.0,
        "drift_1": holding * (car.tyre_stiffness / car.body) ** 2,
        "stroke": stroke * car.bounce**4,
    }


def car_linear(car: QuarterCar, period: float) -> Linear:
    """As controllers at a period (s) see it: white noise per sample."""
    deviation = np.array(list(MEASURED.values())) * math.sqrt(period)
    rows = partial(car_outputs, car)
    return Linear(car_plant(car), rows, tuple(MEASURED), regulated(car, 0.3, 0.03), car.bounce, deviation=deviation)
