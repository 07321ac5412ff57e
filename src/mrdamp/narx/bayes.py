"""Levenberg-Marquardt with Bayesian regularisation.

The objective is beta E_D + alpha E_theta with E_D the sum of squared residuals and E_theta the sum of squared
weights, H = 2 beta J'J + 2 alpha I its Gauss-Newton Hessian, and
gamma = M - 2 alpha trace(H^-1), alpha = gamma / (2 E_theta), beta = (N - gamma) / (2 E_D)
re-estimated at every accepted step: MacKay, Neural Computation 4 (1992) 415-447, doi 10.1162/neco.1992.4.3.415;
Foresee and Hagan, ICNN 1997, doi 10.1109/ICNN.1997.614194; Chen, Ni and Or (2015), Eqs. (7) and (8).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import linalg

from mrdamp.model.core import Array

_QUIET = 5  # so many iterations in a row without a change are the end
_MU_MAX = 1e10


class Problem(Protocol):
    """Residuals (N,) as a function of weights (M,)."""

    @property
    def count(self) -> int:
        """N, residuals that count."""
        ...

    def cost(self, theta: Array) -> float:
        """Sum of squared residuals; infinite where they are not finite."""
        ...

    def normal(self, theta: Array) -> tuple[Array, Array, float]:
        """J'J (M, M), J'r (M,) and the sum of squared residuals."""
        ...


@dataclass(frozen=True, eq=False)
class Posterior:
    """The most probable weights theta (M,) and what is known of them.

    alpha, beta: of the prior and of the noise (its variance is 1 / (2 beta)), scaled units. gamma: effective number of
    weights, 0 to M. log_evidence: of the data given alpha and beta, Gaussian approximation around theta. normal: J'J at
    theta, of the weights that may move. converged: False where the number of iterations was the limit.
    """

    theta: Array
    alpha: float
    beta: float
    gamma: float
    log_evidence: float
    normal: Array
    converged: bool

    @property
    def hessian(self) -> Array:
        """2 beta J'J + 2 alpha I, of the weights that may move."""
        return np.asarray(2.0 * self.beta * self.normal + 2.0 * self.alpha * np.eye(len(self.normal)))


def effective(normal: Array, ratio: float) -> tuple[float, float]:
    """gamma, and log det(J'J + ratio I), for ratio = alpha / beta."""
    m = len(normal)
    factor = linalg.cholesky(normal + ratio * np.eye(m), lower=True, check_finite=False)
    inverse, failed = linalg.lapack.dtrtri(factor, lower=1)
    if failed:
        raise linalg.LinAlgError("singular triangle")
    gamma = m - ratio * float(np.sum(np.tril(inverse) ** 2))
    return min(max(gamma, 0.0), float(m)), 2.0 * float(np.sum(np.log(np.diag(factor))))


def evidence(n: int, m: int, alpha: float, beta: float, e_d: float, e_theta: float, log_det: float) -> float:
    """log p(data | alpha, beta), the weights integrated out with the Gaussian approximation.

    log_det: of J'J + alpha / beta I.
    """
    log_hessian = m * np.log(2.0 * beta) + log_det
    return float(
        -alpha * e_theta - beta * e_d - 0.5 * log_hessian + 0.5 * m * np.log(2.0 * np.pi)
        - 0.5 * n * np.log(np.pi / beta) - 0.5 * m * np.log(np.pi / alpha)
    )  # fmt: skip


def minimise(
    problem: Problem,
    theta: Array,
    *,
    alpha: float = 0.01,
    beta: float | None = None,
    reestimate: bool = True,
    free: Array | None = None,
    iterations: int = 200,
    tolerance: float = 1e-5,
) -> Posterior:
    """The most probable weights from a start theta (M,).

    alpha, beta: start values; beta None: from the residuals at the start. reestimate: False keeps both as they are.
    free: (M,) bool, weights that may move, None: all; the others stay, and gamma counts the free ones. iterations: at
    most. tolerance: of the log evidence (of the objective without re-estimation), per residual.
    """
    theta = np.array(theta, dtype=np.float64)
    moving = np.arange(len(theta)) if free is None else np.flatnonzero(free)
    whole = len(moving) == len(theta)
    n, m = problem.count, len(moving)

    def normal_at(point: Array) -> tuple[Array, Array, float]:
        a, g, e = problem.normal(point)
        return (a, g, e) if whole else (a[np.ix_(moving, moving)], g[moving], e)

    a, g, e_d = normal_at(theta)
    if beta is None:
        beta = 0.5 * n / max(e_d, 1e-12 * n)
    mu, grow, quiet, converged, last = 1e-3 * float(np.trace(a)) / m, 2.0, 0, False, -np.inf
    gamma, log_det = _gamma(a, alpha / beta)
    for _ in range(iterations):
        p = theta[moving]
        ratio = alpha / beta
        gradient = g + ratio * p
        objective = e_d + ratio * float(p @ p)
        while mu < _MU_MAX:
            step = _solve(a, ratio + mu, gradient)
            trial = theta.copy()
            trial[moving] = p + step
            e_new = problem.cost(trial)
            gain = objective - e_new - ratio * float(trial[moving] @ trial[moving])
            if gain > 0.0:
                break
            mu, grow = mu * grow, 2.0 * grow
        else:
            converged = True  # no step of any length makes it smaller
            break
        expected = float(-2.0 * step @ gradient - step @ (a @ step) - ratio * step @ step)
        # Nielsen's update of the damping: by how well the quadratic model predicted the gain.
        mu, grow = mu * max(1.0 / 3.0, 1.0 - (2.0 * gain / expected - 1.0) ** 3), 2.0
        mu = max(mu, 1e-14 * float(np.trace(a)) / m)
        theta = trial
        a, g, e_d = normal_at(theta)
        e_theta = float(theta[moving] @ theta[moving])
        gamma, log_det = _gamma(a, alpha / beta)
        if reestimate:
            alpha = max(gamma, 1e-3) / (2.0 * max(e_theta, 1e-12))
            beta = max(n - gamma, 1.0) / (2.0 * max(e_d, 1e-12 * n))
            gamma, log_det = _gamma(a, alpha / beta)
            now = evidence(n, m, alpha, beta, e_d, e_theta, log_det)
        else:
            now = -beta * e_d - alpha * e_theta
        quiet = quiet + 1 if abs(now - last) < tolerance * n else 0
        last = now
        if quiet >= _QUIET:
            converged = True
            break
    e_theta = float(theta[moving] @ theta[moving])
    log_evidence = evidence(n, m, alpha, beta, e_d, e_theta, log_det)
    return Posterior(theta, float(alpha), float(beta), gamma, log_evidence, a, converged)


def _gamma(a: Array, ratio: float) -> tuple[float, float]:
    # A ratio below rounding of J'J cannot be factored; the smallest that can is as good.
    floor = 1e-13 * float(np.trace(a))
    for _ in range(6):
        try:
            return effective(a, max(ratio, floor))
        except linalg.LinAlgError:
            floor = max(floor, ratio) * 10.0
    return effective(a + 1e-9 * float(np.trace(a)) * np.eye(len(a)), ratio)


def _solve(a: Array, damping: float, gradient: Array) -> Array:
    """-(a + damping I)^-1 gradient."""
    for _ in range(12):
        try:
            factor = linalg.cho_factor(a + damping * np.eye(len(a)), lower=True, check_finite=False)
            return np.asarray(-linalg.cho_solve(factor, gradient, check_finite=False))
        except linalg.LinAlgError:
            damping = 10.0 * damping + 1e-14 * float(np.trace(a))
    return np.asarray(-gradient / (damping + float(np.trace(a))))
