"""Quarter cars: a wheel on a tyre and a body on the suspension, with a damper between the two."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mrdamp.errors import InputError, require_positive
from mrdamp.structures import GRAVITY, FloatArray, ShearFrame


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
