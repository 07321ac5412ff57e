"""NARX networks as data and Bayesian regularisation against known truths; training, choice and pruning on a made-up
damper."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from excitation import Array
from mrdamp.narx import data
from mrdamp.narx.bayes import effective, minimise
from mrdamp.narx.data import Series, lagged, protocol, series
from mrdamp.narx.error_bars import error_bars
from mrdamp.narx.evaluation import evaluate, force_at_rest, free_run_error
from mrdamp.narx.network import Network
from mrdamp.narx.problems import FreeRun, OneStep
from mrdamp.narx.prune import compact, prune
from mrdamp.narx.select import Candidate, Choice, Effort, as_good, select
from mrdamp.narx.train import FitNarx, blank, train_narx
from mrdamp.records import Record, embedded
from narx_data import made, small
from refusals import refuses

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


TRAIN = (made(700, 1), made(500, 2))
VALIDATION = (made(400, 3),)
TEST = (made(500, 4),)


def fit(test: data.Series) -> FitNarx:
    return train_narx(
        TRAIN, VALIDATION, (test,), inputs=lagged("xviF", 1), hidden=(6,), initialisations=2,
        horizons=(10, 50, None), one_step_iterations=60, iterations=10,
    )  # fmt: skip


@pytest.fixture(scope="module")
def trained() -> FitNarx:
    return fit(TEST[0])


def test_both_errors_come_near_the_noise(trained: FitNarx) -> None:
    """2 N of white noise: a one-step prediction reads it in its past forces too, a free run does not."""
    assert 1.5 < trained.one_step.test[0].rmse < 6.0
    assert 1.5 < trained.free_run.test[0].rmse < 15.0
    assert trained.free_run.pooled[2] < 0.03
    assert trained.stages[0].name == "one step"
    least = min(stage.free_run for stage in trained.stages[1:])
    assert least < 0.9 * trained.stages[0].free_run
    assert free_run_error(trained.network, VALIDATION[0]).nrmse == pytest.approx(least)


def test_the_test_stretch_is_not_learned_from(trained: FitNarx) -> None:
    """Lags never cross a boundary: changing the test's forces changes its errors only, and the same seed has the same
    weights."""
    again = fit(replace(TEST[0], force=TEST[0].force[::-1].copy()))
    np.testing.assert_array_equal(again.network.theta, trained.network.theta)
    assert again.free_run.test[0].rmse > 10 * trained.free_run.test[0].rmse


EFFORT = Effort(initialisations=1, one_step_iterations=15, horizons=(10,), iterations=4, most=600)


def choose(**more: Any) -> Choice:
    return select(
        TRAIN, VALIDATION, sets=("xv", "vF", "xviF"), lags=(1, 2), units=(2, 4), start=Candidate("", 1, (4,)),
        effort=EFFORT, **more,
    )  # fmt: skip


@pytest.mark.slow
def test_choice_is_the_same_for_one_worker_and_two_and_goes_on_from_its_cache(tmp_path: Path) -> None:
    cache = tmp_path / "trials.json"
    said: list[str] = []
    one = choose(cache=cache, progress=lambda what, _: said.append(what))
    assert one == choose(workers=2)
    assert one.candidate.channels == "xviF"
    assert one.inputs[0].validation_one > 3 * one.inputs[2].validation_one  # no memory of the force
    assert one.inputs[0].validation_free == pytest.approx(one.inputs[0].validation_one, rel=0.05)
    assert said[0] == "inputs: 3 to train"
    said.clear()
    assert one == choose(cache=cache, progress=lambda what, _: said.append(what))
    assert said == [f"{what}: 0 to train" for what in ("inputs", "lags", "units")]
    cache.write_text("{}")
    refuses(lambda: choose(cache=cache), "no file of finished runs")


@pytest.mark.slow
def test_the_choice_finds_a_network_that_is_known() -> None:
    """Three tanh units of v two steps back and F three back, which is lag space 2; disturbed by .005."""

    def teacher(n: int, seed: int) -> data.Series:
        rng = np.random.default_rng(seed)
        x, v, force = rng.uniform(-1, 1, n), rng.uniform(-1, 1, n), np.zeros(n)
        for k in range(3, n):
            a, b = 2 * v[k - 2], 1.5 * force[k - 3]
            force[k] = 0.6 * np.tanh(a + b) + 0.4 * np.tanh(2 * a - 2) - 0.4 * np.tanh(2 * b - a + 1)
            force[k] += 0.005 * rng.standard_normal()
        return data.Series(f"{seed}", 2e-3, x, v, 0 * x, force)

    found = select(
        (teacher(900, 1),), (teacher(600, 2),), lags=(1, 2, 3), units=(1, 2, 3, 5), start=Candidate("", 2, (5,)),
        by="one_step", effort=Effort(initialisations=3, horizons=()), seeds=2,
    )  # fmt: skip
    assert found.candidate.channels in ("vF", "xvF")
    inputs = {t.candidate.channels: t.validation_one for t in found.inputs}
    assert min(inputs["xv"], inputs["xF"]) > 20 * inputs["vF"]
    assert found.lags[0].validation_one > 20 * found.lags[1].validation_one
    assert 2 in {t.candidate.lags for t in as_good(found.lags, "one_step")}
    errors = {t.candidate.hidden[0]: t.validation_one for t in found.units}
    assert errors[2] > 5 * errors[3]
    spread = float(np.std(teacher(600, 2).force))
    assert 0.0045 < errors[3] * spread < 0.0065


@pytest.fixture(scope="module")
def large() -> FitNarx:
    """More units than records with 30 N of noise determine."""
    train = tuple(replace(s, force=made(s.n, k + 1, noise=30.0).force) for k, s in enumerate(TRAIN))
    return train_narx(
        train, VALIDATION, inputs=lagged("xviF", 2), hidden=(8,), initialisations=1, horizons=(20, 100),
        one_step_iterations=60, iterations=10,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("method", ["surgeon", "magnitude", "structure"])
def test_pruning_finds_a_smaller_network_that_is_as_good(large: FitNarx, method: str) -> None:
    limits: dict[str, Any] = {"share": 0.15, "tolerance": 0.5, "horizon": 50, "most": 1200, "iterations": 8}
    pruned = prune(large.network, TRAIN, VALIDATION, method=method, **limits)
    whole = pruned.steps[1]
    assert pruned.smallest.nonzero < 0.85 * whole.weights
    if method == "structure":
        assert len(pruned.smallest.inputs) < whole.inputs or pruned.smallest.hidden < whole.units
        assert (
            len(pruned.steps[-1].network.inputs) + sum(pruned.steps[-1].units)
            < whole.inputs + sum(whole.units) - 3
        )
    error = free_run_error(pruned.smallest, VALIDATION[0]).nrmse
    assert error <= 1.5 * pruned.best * (1 + 1e-12)
    weights = [step.weights for step in pruned.steps[1:]]
    assert weights == sorted(weights, reverse=True)
    assert evaluate(pruned.smallest, TRAIN, VALIDATION, TEST)[1].test[0].nrmse < 0.1


def test_protocol_cuts_one_record_into_stretches_without_a_common_sample() -> None:
    record = embedded()["sine_5.0Hz_2.5mm_random_current"]
    parts = protocol(record)
    assert [s.n for s in parts] == [4000, 2000, 1500]
    assert record.force is not None
    np.testing.assert_array_equal(np.concatenate([s.force for s in parts]), record.force[:7500])
    refuses(lambda: protocol(record, (4000, 3000, 2000)), r"samples at 0.002 s; 9000 are needed")


def test_a_record_keeps_its_motion_and_noise_at_another_sample_time() -> None:
    t: Array = np.asarray(5e-4 * np.arange(8000), dtype=np.float64)
    w, noise = 4 * np.pi, np.random.default_rng(0).normal(0, 3.43, 8000)
    force = 90 * w * np.cos(w * t) + noise
    made_of = {"displacement_m": 0.01 * np.sin(w * t), "command": 0 * t, "force_N": force}
    for every in (1, 4):
        s = series(Record("smooth", None, 5e-4, made_of), every * 5e-4)
        assert s.sample_time == every * 5e-4
        assert s.noise == pytest.approx(3.43, rel=0.05)
        np.testing.assert_allclose(s.v[10:-10], 0.01 * w * np.cos(w * t)[::every][10:-10], atol=2e-3 * w * 0.01)


def test_force_at_rest_is_the_fixed_point_of_the_recursion() -> None:
    # F = .9 F before + .2 i + .01, scaled: at rest F = (.2 i + .01) / .1.
    inputs = (("F", 1), ("i", 0))
    net = Network(
        2e-3, inputs, np.zeros(2), np.array([1 / 800, 1.0]), 0.0, 800.0, (), np.array([0.9, 0.2, 0.01])
    )
    found = force_at_rest(net, TRAIN)
    assert [u for u, _ in found] == [min(s.i.min() for s in TRAIN), max(s.i.max() for s in TRAIN)]
    for u, force in found:
        assert force == pytest.approx(800 * (0.2 * u + 0.01) / 0.1, rel=1e-6)


def test_doubt_of_a_linear_network_is_that_of_linear_regression() -> None:
    """Without feedback and hidden layers the error bars have a closed form."""
    net = blank([TRAIN[0]], lagged("xv", 0), ())
    posterior = minimise(OneStep.of(net, [TRAIN[0]]), net.theta)
    s = replace(TEST[0], x=3.0 * TEST[0].x)
    found = error_bars(net.with_theta(posterior.theta), posterior, s)
    rows = np.column_stack([net.scaled(s.regressors(net.inputs)), np.ones(s.n)])
    covariance = np.linalg.inv(2 * posterior.beta * posterior.normal + 2 * posterior.alpha * np.eye(3))
    expected = np.sqrt(np.einsum("ni,ij,nj->n", rows, covariance, rows)) * net.force_scale
    np.testing.assert_allclose(found.deviation, expected, rtol=1e-8)
    middle, half = 0.5 * (TRAIN[0].x.max() + TRAIN[0].x.min()), 0.5 * np.ptp(TRAIN[0].x)
    assert found.outside["x"] == pytest.approx(np.max(np.abs(s.x - middle)) / half - 1)
