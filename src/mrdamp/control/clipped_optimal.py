"""Clipped-optimal control: an LQG force to aim at, and a law that follows it; and control by a Lyapunov function.

Dyke, Spencer, Sain and Carlson, Smart Materials and Structures 5 (1996) 565-575, doi
10.1088/0964-1726/5/5/006. With s = [x; x'] and the sign of f as in mrdamp.structures:

    fc = -k s_hat                                                       (LQR, cost y_r^T Q y_r + R f^2)
    s_hat' = a s_hat + b f + l (y - c s_hat - d f)                      (Kalman filter, f measured)
    v  = v_max H((fc - f) f)                                            (clipping)

H is the unit step: the field is on where the damper's force has the sign of the wanted one and
is smaller. Departure: the filter is stepped as in mrdamp.control.lqg, where the paper had a
digital controller of its own.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from mrdamp.control.base import sensor_name
from mrdamp.control.force_control import (
    Direct,
    ForceController,
    Modulated,
    OnOff,
    Resisting,
    Tracking,
    for_each,
)
from mrdamp.control.lqg import Estimator, Linear, linear, regulator_gain
from mrdamp.errors import InputError, require_positive
from mrdamp.structures import FloatArray, ShearFrame

if TYPE_CHECKING:
    from mrdamp.inverse import Inverse


class OptimalForce:
    """fc = -k s_hat, the aim above; built by `optimal_force`. k (n,), of m dampers (m, n); estimator: of the states."""

    def __init__(self, k: FloatArray, estimator: Estimator) -> None:
        self.k = k
        self.estimator = estimator

    def reset(self) -> None:
        self.estimator.reset()

    def __call__(self, t: float, y: Mapping[str, float]) -> Any:
        return -(self.k @ self.estimator(y))


def estimator(
    structure: ShearFrame | Linear,
    noise_ratio: float = 50.0,
    period: float = 1e-3,
    measurements: Sequence[str] | None = None,
) -> Estimator:
    """The Kalman filter of a structure's states [x; x'] (2N,); arguments as for `optimal_force`."""
    require_positive("clipped_optimal", noise_ratio=noise_ratio, period=period)
    s = linear(structure)
    names = s.measured if measurements is None else tuple(measurements)
    if not names:
        raise InputError("clipped_optimal: measurements is empty; name at least one")
    deviation = s.deviation if measurements is None else None
    return Estimator(s.plant, *s.outputs(names), names, noise_ratio, period, deviation)


class Lqg(TypedDict, total=False):
    """Options of the LQG force of a structure, all with Dyke's values by default.

    regulate: weights Q of the regulated outputs by measurement name (or `drift_j`). r: weight of the force squared,
    1e-17. noise_ratio: S_g / S_v, 50. measurements: names of what the filter gets. See `Linear` for their defaults.
    """

    regulate: Mapping[str, float] | None
    r: float
    noise_ratio: float
    measurements: Sequence[str] | None


def optimal_force(structure: ShearFrame | Linear, period: float = 1e-3, **lqg: Unpack[Lqg]) -> OptimalForce:
    """The LQG force of a structure; see `kalman_gain` for the noise. period: s; lqg: options. Raises InputError."""
    regulate, s = lqg.get("regulate"), linear(structure)
    weights = s.regulated if regulate is None else regulate
    r, noise_ratio = lqg.get("r", 1e-17), lqg.get("noise_ratio", 50.0)
    require_positive("clipped_optimal", r=r, noise_ratio=noise_ratio, period=period)
    regulated = s.weighted("clipped_optimal: regulate is", weights)
    filtered = estimator(s, noise_ratio, period, lqg.get("measurements"))
    return OptimalForce(regulator_gain(s.plant.a, s.plant.b, *regulated, r), filtered)


def clipped_optimal(
    structure: ShearFrame | Linear,
    command_max: float,
    period: float = 1e-3,
    **lqg: Unpack[Lqg],
) -> ForceController:
    """A clipped-optimal controller for a structure; on a frame the defaults are Dyke's.

    command_max: A or V; period: s; lqg: options, see `Lqg`. Raises InputError.
    """
    require_positive("clipped_optimal", command_max=command_max)
    follower = for_each(lambda: OnOff(command_max), linear(structure).dampers)
    return ForceController(optimal_force(structure, period, **lqg), follower, period, "clipped-optimal")


def modulated_optimal(
    structure: ShearFrame | Linear,
    command_max: float,
    force_max: float,
    period: float = 1e-3,
    **lqg: Unpack[Lqg],
) -> ForceController:
    """The same aim, followed by a command in proportion to it; force_max in N, see `Modulated`."""
    aim = optimal_force(structure, period, **lqg)
    follower = for_each(lambda: Modulated(command_max, force_max), linear(structure).dampers)
    return ForceController(aim, follower, period, "modulated-optimal")


def force_tracking(structure: ShearFrame | Linear, inverse: Inverse, **lqg: Unpack[Lqg]) -> ForceController:
    """The same aim, followed by an inverse model of the damper in place of on/off switching, at its period."""
    aim = optimal_force(structure, inverse.period, **lqg)
    follower = for_each(lambda: Tracking(copy.deepcopy(inverse)), linear(structure).dampers)
    return ForceController(aim, follower, inverse.period, "force-tracking")


def ideal_active(
    structure: ShearFrame | Linear, period: float = 1e-3, force_max: float = math.inf, **lqg: Unpack[Lqg]
) -> ForceController:
    """The LQG force applied as it is, limited to force_max (N).

    Its command is a force in N, for `run_frame(..., ideal_force=True)`.
    """
    return ForceController(optimal_force(structure, period, **lqg), Direct(force_max), period, "ideal-active")


def bang_bang(
    direction: FloatArray, states: Estimator, command_max: float, period: float, name: str
) -> ForceController:
    """Bang-bang control: v = v_max H((direction^T s_hat) f).

    From a Lyapunov function V = s^T P s the direction is -P b: the part of V' that depends on the damper is
    2 s^T P b f, and the field is on where the damper's force takes V down. Jansen and Dyke, J. Eng. Mech. 126 (2000)
    795-803, doi 10.1061/(ASCE)0733-9399(2000)126:8(795). The structure's energy as V gives maximum dissipation.

    direction (2N,), of m dampers (2N, m), of the force that is good; states: a
    filter of the states (2N,); command_max: A or V."""
    require_positive(f"controller {name}", command_max=command_max)
    dampers = 1 if direction.ndim == 1 else direction.shape[1]
    follower = for_each(lambda: Resisting(command_max), dampers)
    return ForceController(OptimalForce(-direction.T, states), follower, period, name)


def lyapunov_matrix(structure: ShearFrame | Linear, weights: Mapping[str, float]) -> FloatArray:
    """P (2N, 2N) of a^T P + P a = -c^T diag(weights) c, c the named outputs' rows. Raises InputError."""
    s = linear(structure)
    a, (c, _, q) = s.plant.a, s.weighted("lyapunov: weights are", weights)
    if np.linalg.eigvals(a).real.max() >= 0:
        raise InputError("lyapunov: the structure has a mode without damping; no such function is found")
    return np.asarray(solve_continuous_lyapunov(a.T, -c.T @ (q[:, None] * c)))


def lyapunov(
    structure: ShearFrame | Linear,
    command_max: float,
    weights: Mapping[str, float] | None = None,
    noise_ratio: float = 50.0,
    period: float = 1e-3,
) -> ForceController:
    """Control by the Lyapunov function of the named outputs' weighted squares.

    command_max: A or V. weights: by measurement name or `drift_j`, 1 on every measured acceleration by default.
    noise_ratio, period: of the Kalman filter, as for clipped-optimal control. Raises InputError.
    """
    s = linear(structure)
    chosen = weights or {each: 1.0 for each in s.measured if each.startswith("acceleration")}
    direction = -lyapunov_matrix(s, chosen) @ s.plant.b
    return bang_bang(direction, estimator(s, noise_ratio, period), command_max, period, "lyapunov")


def max_dissipation(
    structure: ShearFrame | Linear, command_max: float, noise_ratio: float = 50.0, period: float = 1e-3
) -> ForceController:
    """The field on wherever the damper's force resists its motion: V is the structure's energy. Raises InputError."""
    s = linear(structure)
    rows = s.outputs([sensor_name("stroke_velocity", k) for k in range(s.dampers)])[0]
    direction = rows.T if s.plant.b.ndim > 1 else rows[0]
    return bang_bang(direction, estimator(s, noise_ratio, period), command_max, period, "max-dissipation")
