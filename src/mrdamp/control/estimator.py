"""A Kalman filter whose input is the measured damper force, stepped once per control period.

    s_hat' = a s_hat + b f + l (y - c s_hat - d f)

The measured force f is a known input. The continuous filter is stepped exactly for measurements that are
linear between the samples (first-order hold).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mrdamp.control.base import sensor_name
from mrdamp.control.lqg import first_order_hold, kalman_gain
from mrdamp.control.plant import Plant
from mrdamp.errors import InputError
from mrdamp.structures import FloatArray


class Estimator:
    """The filter above for s' = a s + b f + e w, y = c s + d f, of n states and p measurements.

    c (p, n), d (p,), measurements: p names; noise_ratio: intensity of w over that of every measurement's noise, in
    units of its deviation (p,), one by default; period: s. Attributes: gain (n, p), l above; estimate, s_hat (n,) of
    the last call. Raises InputError.
    """

    def __init__(
        self,
        linear: Plant,
        c: FloatArray,
        d: FloatArray,
        measurements: Sequence[str],
        noise_ratio: float,
        period: float,
        deviation: FloatArray | None = None,
    ) -> None:
        if not measurements:
            raise InputError("estimator: measurements is empty; name at least one")
        self.measurements = tuple(measurements)
        self.gain = kalman_gain(linear.a, linear.e, c, noise_ratio, deviation)
        drive = np.column_stack([self.gain, linear.b - self.gain @ d])  # inputs: y, then f
        forces = range(drive.shape[1] - len(self.measurements))
        self._inputs = (*self.measurements, *(sensor_name("force", k) for k in forces))
        self._phi, self._g0, self._g1 = first_order_hold(linear.a - self.gain @ c, drive, period)
        self.reset()

    @property
    def matrices(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(n, n), (n, p + m), (n, p + m) of s_hat+ = m0 s_hat + m1 y + m2 y+, y the measurements, then the m forces."""
        return self._phi, self._g0, self._g1

    def reset(self) -> None:
        """The structure is at rest."""
        self.estimate: FloatArray = np.zeros(len(self._phi))
        self._last: FloatArray | None = None

    def __call__(self, y: Mapping[str, float]) -> FloatArray:
        """s_hat (n,) with the measurements y of now, (n, rows) with those of many runs; `force` (N) is among them."""
        now = np.array([y[name] for name in self._inputs])
        if self._last is None:
            self.estimate = np.zeros((len(self._phi), *now.shape[1:]))
        else:
            self.estimate = self._phi @ self.estimate + self._g0 @ self._last + self._g1 @ now
        self._last = now
        return self.estimate
