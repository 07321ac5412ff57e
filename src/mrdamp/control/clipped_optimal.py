"""Clipped-optimal control: an LQG force to aim at, and a bang-bang law that follows it.

Dyke, Spencer, Sain and Carlson, Smart Materials and Structures 5 (1996) 565-575, doi
10.1088/0964-1726/5/5/006. With s = [x; x'] and the sign of f as in mrdamp.structures:

    fc = -k s_hat                                                       (LQR, cost y_r^T Q y_r + R f^2)
    s_hat' = a s_hat + b f + l (y - c s_hat - d f)                      (Kalman filter, f measured)
    v  = v_max H((fc - f) f)                                            (clipping)

H is the unit step: the field is on where the damper's force has the sign of the wanted one and
is smaller. Departure: the continuous filter is stepped exactly for measurements that run straight
between the samples (first-order hold), where the paper had a digital controller of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from mrdamp.control.lqg import first_order_hold, kalman_gain, regulator_gain
from mrdamp.control.plant import outputs, plant
from mrdamp.errors import InputError
from mrdamp.structures import FloatArray, ShearFrame


def clip(wanted: float, force: float, command_max: float) -> float:
    """command_max * H((wanted - force) * force); H(0) = 0. Forces in N."""
    return command_max if (wanted - force) * force > 0 else 0.0


class ClippedOptimal:
    """The controller above; built by `clipped_optimal`.

    Attributes: name; period, s; command_max; measurements, p names; k (2N,), the regulator's gain;
    gain (2N, p), l above, the filter's; wanted, the force fc of the last call, N; estimate, s_hat
    (2N,) of the last call.
    """

    def __init__(
        self,
        frame: ShearFrame,
        command_max: float,
        k: FloatArray,
        gain: FloatArray,
        measurements: Sequence[str],
        period: float,
        name: str = "clipped-optimal",
    ) -> None:
        self.name = name
        self.period = period
        self.command_max = command_max
        self.measurements = tuple(measurements)
        self.k = k
        self.gain = gain
        linear = plant(frame)
        c, d = outputs(frame, self.measurements)
        drive = np.column_stack([gain, linear.b - gain @ d])  # inputs: y, then f
        self._phi, self._g0, self._g1 = first_order_hold(linear.a - gain @ c, drive, period)
        self.reset()

    def reset(self) -> None:
        self.estimate: FloatArray = np.zeros(len(self.k))
        self.wanted = 0.0
        self._last: FloatArray | None = None

    def command(self, t: float, y: Mapping[str, float]) -> float:
        force = y["force"]
        now = np.array([*(y[name] for name in self.measurements), force])
        if self._last is not None:
            self.estimate = self._phi @ self.estimate + self._g0 @ self._last + self._g1 @ now
        self._last = now
        self.wanted = -float(self.k @ self.estimate)
        return clip(self.wanted, force, self.command_max)


def clipped_optimal(
    frame: ShearFrame,
    command_max: float,
    regulate: Mapping[str, float] | None = None,
    r: float = 1e-17,
    noise_ratio: float = 50.0,
    period: float = 1e-3,
    measurements: Sequence[str] | None = None,
    name: str = "clipped-optimal",
) -> ClippedOptimal:
    """A clipped-optimal controller for a frame; the defaults are Dyke's.

    command_max: A or V. regulate: weights Q of the regulated outputs by measurement name (or
    `drift_j`), 1 on the top floor's absolute acceleration by default. r: weight of the force
    squared. noise_ratio: S_g / S_v. period: s. measurements: names of what the filter gets, all
    floor accelerations and `displacement_1` by default; the damper's force is always used.
    Raises InputError.
    """
    for what, value in (
        ("command_max", command_max),
        ("r", r),
        ("noise_ratio", noise_ratio),
        ("period", period),
    ):
        if not 0 < value < math.inf:
            raise InputError(f"clipped_optimal: {what} is {value}; allowed: a finite number > 0")
    n = frame.storeys
    weights = dict(regulate) if regulate is not None else {f"acceleration_{n}": 1.0}
    if not weights or any(not 0 <= w < math.inf for w in weights.values()) or not any(weights.values()):
        raise InputError(f"clipped_optimal: regulate is {weights}; allowed: weights >= 0, one of them > 0")
    names = (
        tuple(measurements)
        if measurements is not None
        else (
            *(f"acceleration_{i}" for i in range(1, n + 1)),
            "displacement_1",
        )
    )
    if not names:
        raise InputError("clipped_optimal: measurements is empty; name at least one")
    linear = plant(frame)
    regulated, through = outputs(frame, tuple(weights))
    c, _ = outputs(frame, names)
    return ClippedOptimal(
        frame,
        command_max,
        regulator_gain(linear.a, linear.b, regulated, through, np.array(list(weights.values())), r),
        kalman_gain(linear.a, linear.e, c, noise_ratio),
        names,
        period,
        name,
    )
