"""Training one step ahead and in free run, the choice of a network, and pruning, on a made-up damper."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from excitation import Array
from mrdamp.narx import data
from mrdamp.narx.bayes import minimise
from mrdamp.narx.data import lagged, protocol, series
from mrdamp.narx.error_bars import error_bars
from mrdamp.narx.evaluation import evaluate, force_at_rest, free_run_error
from mrdamp.narx.network import Network
from mrdamp.narx.problems import OneStep
from mrdamp.narx.prune import prune
from mrdamp.narx.select import Candidate, Choice, Effort, as_good, select
from mrdamp.narx.train import FitNarx, blank, train_narx
from mrdamp.records import Record, embedded
from narx_data import made
from refusals import refuses

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
