"""The network as data against differences and the C entry, and Bayesian regularisation against known truths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from excitation import Array
from mrdamp.narx.bayes import effective, minimise
from mrdamp.narx.data import Series, lagged
from mrdamp.narx.problems import FreeRun, OneStep
from mrdamp.narx.prune import compact
from narx_data import made, small

SHAPES: tuple[tuple[int, ...], ...] = ((), (5,), (4, 3))


@pytest.mark.parametrize("hidden", SHAPES, ids=str)
@pytest.mark.parametrize("horizon", [7, None], ids=["segments", "whole"])
def test_free_run_sensitivities_are_those_of_differences(
    hidden: tuple[int, ...], horizon: int | None
) -> None:
    net = small(hidden, seed=3)
    theta = 0.6 * net.theta
    problem = FreeRun.of(net, [made(40, 1), made(33, 2)], horizon)
    force, exact = problem.sensitivities(theta)
    assert exact.shape == (*force.shape, len(theta))
    for k in range(len(theta)):
        step = np.zeros(len(theta))
        step[k] = 1e-6
        difference = (problem.sensitivities(theta + step)[0] - problem.sensitivities(theta - step)[0]) / 2e-6
        np.testing.assert_allclose(exact[:, :, k], difference, rtol=1e-5, atol=1e-7)


def test_normal_equations_are_those_of_the_residuals() -> None:
    """J'J, J'r and r'r by blocks, uncounted samples left out, against the plain products."""
    net = small((5,))
    train = [made(90, 1), made(61, 2)]
    free = FreeRun.of(net, train, 25)
    assert free.count == sum(25 * ((s.n - 3) // 25) for s in train)
    assert FreeRun.of(net, train, None, skip=10).count == sum(s.n - 10 for s in train)
    one = OneStep.of(net, train)
    assert one.count == sum(s.n - 3 for s in train)
    force, jacobian = free.sensitivities(net.theta)
    rows, residual = jacobian[free.counts], (force - free.target)[free.counts]
    a, g, e = free.normal(net.theta)
    np.testing.assert_allclose(a, rows.T @ rows, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(g, rows.T @ residual, rtol=1e-10, atol=1e-10)
    assert e == pytest.approx(float(residual @ residual)) == pytest.approx(free.cost(net.theta))
    predicted = np.concatenate([net.forward(s.regressors(net.inputs)[3:]) - s.force[3:] for s in train])
    assert one.cost(net.theta) == pytest.approx(float(np.sum((predicted / net.force_scale) ** 2)))


def test_segments_start_from_measured_forces_and_never_leave_their_record() -> None:
    """One step of a segment is the one-step prediction; the second reads the first one's force."""
    net, s = small((5,), seed=2), made(50, 4)
    force, _ = FreeRun.of(net, [s, made(40, 5)], 10).sensitivities(net.theta)
    values = s.regressors(net.inputs)
    first = net.forward(values[3:4])[0]
    assert force[0, 0] * net.force_scale + net.force_offset == pytest.approx(first)
    values[4, net.inputs.index(("F", 1))] = first
    assert force[1, 0] * net.force_scale + net.force_offset == pytest.approx(net.forward(values[4:5])[0])
    assert force.shape[1] == (50 - 3) // 10 + (40 - 3) // 10


def test_lag_space_and_what_lies_before_a_record() -> None:
    assert lagged("vF", 1) == (("v", 0), ("v", 1), ("F", 1), ("F", 2))
    assert len(lagged("vF", 4)) == 10  # the paper's 10-9-1
    assert len(lagged("viF", 4)) == 15
    x = np.array([1.0, 2.0, 3.0])
    table = Series("s", 1e-3, x, x, x, x).regressors((("x", 1), ("v", 1), ("i", 2), ("F", 1), ("v", 0)))
    np.testing.assert_array_equal(table, [[1, 0, 1, 0, 1], [1, 1, 1, 1, 2], [2, 2, 1, 2, 3]])


def test_compacting_keeps_the_function() -> None:
    """A unit without inputs is a constant; a unit that nobody reads and an unread input go."""
    net = small((5, 3), seed=7)
    theta = net.theta.copy()
    net = net.with_theta(theta)
    first, second, out = (weight.copy() for weight, _ in net.layers)
    first[1] = 0.0  # constant
    first[:, 2] = 0.0  # an input that is not read
    second[:, 4] = 0.0  # not read
    out[0, 2] = 0.0  # nor is this one
    parts = [part for weight, (_, bias) in zip((first, second, out), net.layers, strict=True)
             for part in (weight.ravel(), bias)]  # fmt: skip
    sparse = net.with_theta(np.concatenate(parts))
    smaller = compact(sparse)
    assert smaller.hidden == (3, 2)
    assert smaller.inputs == tuple(entry for k, entry in enumerate(net.inputs) if k != 2)
    s = made(80, 6)
    np.testing.assert_allclose(
        smaller.forward(s.regressors(smaller.inputs)), sparse.forward(s.regressors(net.inputs)), rtol=1e-12
    )


@dataclass(frozen=True)
class Linear:
    """Residuals design @ theta - target."""

    design: Array
    target: Array

    @property
    def count(self) -> int:
        return len(self.target)

    def cost(self, theta: Array) -> float:
        return float(np.sum((self.design @ theta - self.target) ** 2))

    def normal(self, theta: Array) -> tuple[Array, Array, float]:
        residual = self.design @ theta - self.target
        return self.design.T @ self.design, self.design.T @ residual, float(residual @ residual)


def linear(n: int, spread: Array, noise: float, seed: int = 0) -> Linear:
    """Columns of the given sizes; weights of size one; Gaussian noise."""
    rng = np.random.default_rng(seed)
    design = rng.standard_normal((n, len(spread))) * spread
    return Linear(design, design @ rng.standard_normal(len(spread)) + noise * rng.standard_normal(n))


def test_evidence_of_a_linear_model_is_the_density_of_its_data() -> None:
    """Weights ~ N(0, 1 / (2 alpha)), noise ~ N(0, 1 / (2 beta)): the data are jointly Gaussian."""
    problem, alpha, beta = linear(40, np.array([1.0, 0.3, 2.0, 1e-2]), 0.2), 0.7, 9.0
    found = minimise(problem, np.zeros(4), alpha=alpha, beta=beta, reestimate=False, tolerance=1e-12)
    covariance = np.eye(40) / (2 * beta) + problem.design @ problem.design.T / (2 * alpha)
    truth = multivariate_normal(np.zeros(40), covariance).logpdf(problem.target)
    assert found.log_evidence == pytest.approx(truth, abs=1e-6)
    mean = np.linalg.solve(
        beta * problem.design.T @ problem.design + alpha * np.eye(4), beta * problem.design.T @ problem.target
    )
    np.testing.assert_allclose(found.theta, mean, rtol=1e-5, atol=1e-7)
    assert (found.alpha, found.beta) == (alpha, beta)


@pytest.mark.slow
def test_reestimated_alpha_and_beta_maximise_the_evidence() -> None:
    """Against a direct search over both with the closed form; the noise is found too."""
    problem = linear(300, np.array([1.0, 0.5, 0.2, 2.0, 1.0, 0.7]), 0.3, seed=1)
    found = minimise(problem, np.zeros(6), tolerance=1e-10, iterations=500)
    assert found.converged

    def minus(logs: Array) -> float:
        alpha, beta = np.exp(logs)
        covariance = np.eye(300) / (2 * beta) + problem.design @ problem.design.T / (2 * alpha)
        return -float(multivariate_normal(np.zeros(300), covariance).logpdf(problem.target))

    best = minimize(minus, np.log([1.0, 1.0]), method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-7})
    np.testing.assert_allclose([found.alpha, found.beta], np.exp(best.x), rtol=1e-3)
    assert found.log_evidence == pytest.approx(-best.fun, abs=1e-4)
    assert np.sqrt(1 / (2 * found.beta)) == pytest.approx(0.3, rel=0.1)


def test_gamma_is_its_definition() -> None:
    a = linear(30, np.array([1.0, 0.1, 3.0]), 0.1).design
    normal, ratio = a.T @ a, 0.9
    gamma, log_det = effective(normal, ratio)
    beta, alpha = 2.5, 2.5 * ratio
    hessian = 2 * beta * normal + 2 * alpha * np.eye(3)
    assert gamma == pytest.approx(3 - 2 * alpha * np.trace(np.linalg.inv(hessian)))
    assert log_det == pytest.approx(np.linalg.slogdet(normal + ratio * np.eye(3))[1])


@pytest.mark.parametrize("hidden", [(3,), (3, 2)], ids=str)
def test_small_network_ends_where_a_general_optimiser_does(hidden: tuple[int, ...]) -> None:
    net = small(hidden, seed=4, lags={"v": (0, 1), "i": (0,), "F": (1,)})
    problem = OneStep.of(net, [made(300, 1)])
    alpha, beta = 0.05, 50.0
    mine = minimise(
        problem, net.theta, alpha=alpha, beta=beta, reestimate=False, iterations=400, tolerance=1e-14
    )

    def objective(theta: Array) -> tuple[float, Array]:
        _, g, e = problem.normal(theta)
        return beta * e + alpha * float(theta @ theta), 2 * beta * g + 2 * alpha * theta

    value, slope = objective(mine.theta)
    assert np.max(np.abs(slope)) < 1e-4 * value
    # From a disturbed point a general optimiser comes back to the same place, and not below it.
    rng = np.random.default_rng(0)
    start = mine.theta + 0.02 * rng.standard_normal(len(net.theta))
    other = minimize(objective, start, jac=True, method="BFGS", options={"gtol": 1e-8, "maxiter": 3000})
    assert value == pytest.approx(other.fun, rel=1e-6)
    np.testing.assert_allclose(mine.theta, other.x, atol=2e-3)


def test_weights_that_are_held_stay() -> None:
    problem = linear(50, np.ones(5), 0.1, seed=3)
    free = np.array([True, False, True, False, True])
    found = minimise(problem, np.zeros(5), free=free)
    np.testing.assert_array_equal(found.theta[~free], 0.0)
    assert np.all(found.theta[free] != 0.0)
    assert found.gamma <= 3.0
    assert found.hessian.shape == (3, 3)
