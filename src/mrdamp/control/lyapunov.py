"""Bang-bang control from a Lyapunov function: the field is on where the damper's force takes it down.

Jansen and Dyke, J. Eng. Mech. 126 (2000) 795-803, doi 10.1061/(ASCE)0733-9399(2000)126:8(795). With V = s^T P s
and the frame's s' = a s + b f + e xg'', the part of V' that depends on the damper is 2 s^T P b f, hence

    v = v_max H(-(s_hat^T P b) f)

The structure's energy as V gives maximum dissipation: the field is on wherever the damper takes energy out.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from mrdamp.control.base import sensor_name
from mrdamp.control.clipped_optimal import OptimalForce, estimator
from mrdamp.control.force_control import ForceController, Resisting, for_each
from mrdamp.control.lqg import Estimator
from mrdamp.control.plant import Linear, linear
from mrdamp.errors import InputError, require_positive
from mrdamp.structures import FloatArray, ShearFrame


def bang_bang(
    direction: FloatArray, states: Estimator, command_max: float, period: float, name: str
) -> ForceController:
    """v = v_max H((direction^T s_hat) f). direction (2N,), of m dampers (2N, m), of the force that is good; states: a
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
    name: str = "lyapunov",
) -> ForceController:
    """Control by the Lyapunov function of the named outputs' weighted squares.

    command_max: A or V. weights: by measurement name or `drift_j`, 1 on every measured acceleration by default.
    noise_ratio, period: of the Kalman filter, as for clipped-optimal control. Raises InputError.
    """
    s = linear(structure)
    chosen = weights or {each: 1.0 for each in s.measured if each.startswith("acceleration")}
    direction = -lyapunov_matrix(s, chosen) @ s.plant.b
    return bang_bang(direction, estimator(s, noise_ratio, period), command_max, period, name)


def max_dissipation(
    structure: ShearFrame | Linear,
    command_max: float,
    noise_ratio: float = 50.0,
    period: float = 1e-3,
    name: str = "max-dissipation",
) -> ForceController:
    """The field on wherever the damper's force resists its motion: V is the structure's energy. Raises InputError."""
    s = linear(structure)
    rows = s.outputs([sensor_name("stroke_velocity", k) for k in range(s.dampers)])[0]
    direction = rows.T if s.plant.b.ndim > 1 else rows[0]
    return bang_bang(direction, estimator(s, noise_ratio, period), command_max, period, name)
