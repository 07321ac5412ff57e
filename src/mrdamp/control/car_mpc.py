"""Clipped model-predictive control of a quarter car: a quadratic program of the damper's forces over a horizon.

    min  sum over the horizon of y_r^T Q y_r + r f^2, and what an LQ regulator would cost behind it
    with |f_k| <= f_max, and f_0 of the sign of the stroke's velocity, as a damper only resists

The first force is wanted, and followed through the damper's inverse. As in Canale, Milanese and Novara 2006 (doi
10.1109/TCST.2006.880196), but with the program solved on line, by OSQP (Stellato et al. 2020, doi
10.1007/s12532-020-00179-2), and states from the Kalman filter.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import sparse
from scipy.linalg import expm, solve_discrete_are

from mrdamp.control.clipped_optimal import estimator
from mrdamp.errors import InputError
from mrdamp.structures import FloatArray

if TYPE_CHECKING:
    from mrdamp.control.registry import AnySite

_MOST = 200  # forces in a horizon


class MpcForce:
    """The wanted force above, for a quarter car. o: options of the LQ force, and horizon, s. Raises InputError, also
    where OSQP is not installed."""

    def __init__(self, site: AnySite, o: Mapping[str, float]) -> None:
        try:
            import osqp
        except ImportError:
            raise InputError(
                "clipped-mpc needs osqp, which is not installed: pip install 'mrdamp[mpc]'"
            ) from None
        horizon = o["horizon"]
        steps = round(horizon / site.period)
        if not 1 <= steps <= _MOST:
            raise InputError(f"clipped-mpc: horizon is {horizon} s; allowed: 1 to {_MOST} control periods")
        whole, lqg = site.linear, site.lqg(o)
        linear, weights = whole.plant, dict(lqg["regulate"] or {})
        self._estimator = estimator(whole, lqg["noise_ratio"], site.period)
        n = len(linear.a)
        both = np.zeros((n + 1, n + 1))
        both[:n, :n], both[:n, n] = linear.a, linear.b
        moved = expm(both * site.period)
        a, b = moved[:n, :n], moved[:n, n:]
        c, d = whole.outputs(tuple(weights))
        cost = np.diag(list(weights.values()))
        q, s, rr = c.T @ cost @ c, c.T @ cost @ d[:, None], float(d @ cost @ d) + lqg["r"]
        # Forces in units of the largest, so that the program is well scaled.
        largest = site.force_max
        b, s, rr = b * largest, s * largest, rr * largest**2
        end = solve_discrete_are(a, b, q, np.array([[rr]]), s=s)
        # x_k = power x_0 + reach f, for k = 0 ... steps.
        power, reach = [np.eye(n)], [np.zeros((n, steps))]
        for k in range(steps):
            after = a @ reach[-1]
            after[:, k] += b[:, 0]
            power.append(a @ power[-1])
            reach.append(after)
        hessian = rr * np.eye(steps)
        slope = np.zeros((steps, n))
        for k in range(steps):
            hessian += reach[k].T @ q @ reach[k]
            mixed = np.zeros((steps, steps))
            mixed[k] = (s.T @ reach[k])[0]
            hessian += mixed + mixed.T
            slope += reach[k].T @ q @ power[k]
            slope[k] += (s.T @ power[k])[0]
        hessian += reach[-1].T @ end @ reach[-1]
        slope += reach[-1].T @ end @ power[-1]
        scale = 1 / float(np.abs(np.diag(hessian)).max())
        self._slope, self._largest = scale * slope, largest
        self._low, self._high = -np.ones(steps), np.ones(steps)
        self._solver: Any = osqp.OSQP()
        self._solver.setup(
            sparse.csc_matrix(np.triu(scale * (hessian + hessian.T) / 2)), np.zeros(steps),
            sparse.csc_matrix(np.eye(steps)), self._low, self._high, verbose=False, eps_abs=1e-4, eps_rel=1e-4,
            polishing=False,
        )  # fmt: skip
        self._steps = steps

    def reset(self) -> None:
        self._estimator.reset()
        rest = np.zeros(self._steps)
        self._solver.warm_start(x=rest, y=rest)
        self._before: list[tuple[Any, Any]] = []

    def __call__(self, t: float, y: Mapping[str, float]) -> Any:
        states, extends = self._estimator(y), np.asarray(y["stroke_velocity"]) > 0
        if states.ndim == 1:
            return self._solve(t, states, bool(extends))[0]
        rest = np.zeros(self._steps)
        found = []
        for (x, dual), state, way in zip(
            self._before or [(rest, rest)] * len(extends), states.T, extends.tolist(), strict=True
        ):
            self._solver.warm_start(x=x, y=dual)
            found.append(self._solve(t, state, way))
        self._before = [(solved.x, solved.y) for _, solved in found]
        return np.array([force for force, _ in found])

    def _solve(self, t: float, state: FloatArray, extends: bool) -> tuple[float, Any]:
        """The force, N, from the states (n,), and the solution."""
        self._low[0], self._high[0] = (0.0, 1.0) if extends else (-1.0, 0.0)
        self._solver.update(q=self._slope @ state, l=self._low, u=self._high)
        found = self._solver.solve(raise_error=False)
        if not np.isfinite(found.x[0]):
            raise InputError(f"clipped-mpc: no solution at {t:g} s: {found.info.status}")
        return float(np.clip(found.x[0], self._low[0], self._high[0])) * self._largest, found
