"""Training: one step ahead with Bayesian regularisation, then in free run over growing horizons.

One step ahead is the papers' way; free run is what a simulator does. Both errors are always reported together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp import core
from mrdamp.core import Array
from mrdamp.errors import InputError
from mrdamp.identify import RecordError, pooled
from mrdamp.model import Model
from mrdamp.narx import layers as nn
from mrdamp.narx.bayes import Posterior, minimise
from mrdamp.narx.data import Series, check, scaling
from mrdamp.narx.network import Input, Network, check_hidden, check_inputs
from mrdamp.narx.problems import FreeRun, OneStep

Progress = Callable[[str, float], None]

#: Samples of free run from measured lags; None: whole stretches, started as the plugin starts.
HORIZONS: tuple[int | None, ...] = (5, 20, 100, 400, None)
DISTURB = 1.5  # half ranges of the force; where every other segment of the free-run training starts, at most
START = 0.02  # s of a free run that do not count, where the unknown start fades, as in `mrdamp.identify`


@dataclass(frozen=True)
class Judged:
    """Errors of one network, by stretch: one step ahead and in free run.

    Attributes:
        train, validation, test: RMS error (N) and over the standard deviation of the force, per stretch.
        rms: RMS force (N) per stretch name, the papers' yardstick.
    """

    train: tuple[RecordError, ...]
    validation: tuple[RecordError, ...]
    test: tuple[RecordError, ...]
    rms: tuple[tuple[str, float], ...]

    @property
    def pooled(self) -> tuple[float, float, float]:
        """RMS error over the standard deviation: training, validation, test; NaN for none."""
        return pooled(self.train), pooled(self.validation), pooled(self.test)

    def share(self, error: RecordError) -> float:
        """RMS error over the RMS force of that stretch."""
        return error.rmse / dict(self.rms)[error.record]


@dataclass(frozen=True)
class Stage:
    """One stage of training: what it ran on, and what came out on training and validation."""

    name: str
    gamma: float
    iterations: int
    one_step: float  # pooled NRMSE on validation (training where there is none)
    free_run: float


@dataclass(frozen=True, eq=False)
class FitNarx:
    """A trained network with both errors, the posterior of the stage it comes from, and the stages."""

    network: Network
    one_step: Judged
    free_run: Judged
    posterior: Posterior
    stages: tuple[Stage, ...]

    @property
    def model(self) -> Model:
        """As the plugin and `mrdamp predict` take it."""
        return Model(
            "narx", weights=self.network.to_text(), name=f"narx {self.network.topology}",
            sample_rate_hz=round(1.0 / self.network.sample_time, 6),
        )  # fmt: skip


def one_step_force(network: Network, s: Series) -> Array:
    """Force (n - max_lag,) N predicted one step ahead of measured forces."""
    return network.forward(s.regressors(network.inputs)[network.max_lag :])


def free_run_force(network: Network, s: Series) -> Array:
    """Force (n,) N in free run through the C entry, from the plugin's start."""
    return core.run("narx", {}, s.sample_time, s.x, s.v, u=s.i, narx=core.Narx(network.to_text()))["force"]


def one_step_error(network: Network, s: Series) -> RecordError:
    """One step ahead, over the samples whose lags are all measured."""
    return _error(s.name, one_step_force(network, s), s.force[network.max_lag :])


def free_run_error(network: Network, s: Series) -> RecordError:
    """In free run; the first 20 ms do not count."""
    skip = min(s.n // 4, int(START / s.sample_time))
    return _error(s.name, free_run_force(network, s)[skip:], s.force[skip:])


def judge(
    network: Network, train: Sequence[Series], validation: Sequence[Series] = (), test: Sequence[Series] = ()
) -> tuple[Judged, Judged]:
    """Errors one step ahead and in free run."""
    rms = tuple((s.name, float(np.sqrt(np.mean(s.force**2)))) for s in (*train, *validation, *test))

    def judged(error: Callable[[Network, Series], RecordError]) -> Judged:
        parts = [tuple(error(network, s) for s in part) for part in (train, validation, test)]
        return Judged(parts[0], parts[1], parts[2], rms)

    return judged(one_step_error), judged(free_run_error)


def blank(
    train: Sequence[Series], inputs: Sequence[Input], hidden: Sequence[int], sample_time: float | None = None
) -> Network:
    """A network of zeros with the scaling of these stretches."""
    offset, scale, force_offset, force_scale = scaling(train, inputs)
    theta = np.zeros(nn.count(len(inputs), hidden))
    return Network(
        sample_time or train[0].sample_time, tuple(inputs), offset, scale, force_offset, force_scale,
        tuple(hidden), theta,
    )  # fmt: skip


def one_step_fit(
    network: Network, train: Sequence[Series], *, seed: int, number: int = 0, most: int | None = None,
    iterations: int = 150, progress: Callable[[int, float, float], None] | None = None,
) -> Posterior:  # fmt: skip
    """One initialisation, trained one step ahead; the same seed and number give the same weights."""
    problem = OneStep.of(network, train, most)
    rng = np.random.default_rng((seed, number))
    theta = nn.nguyen_widrow(len(network.inputs), network.hidden, rng)
    return minimise(problem, theta, iterations=iterations, progress=progress)


def refine(
    network: Network, train: Sequence[Series], posterior: Posterior, horizon: int | None, *,
    free: Array | None = None, most: int | None = None, iterations: int = 30,
) -> Posterior:  # fmt: skip
    """Free-run training over one horizon from the weights, alpha and beta of a posterior, re-estimated there."""
    skip = int(START / network.sample_time)
    problem = FreeRun.of(network, train, horizon, most, skip=skip, disturb=DISTURB)
    start = posterior.theta
    if not np.isfinite(problem.cost(start)):
        return posterior
    # A new horizon has another error: beta from it, alpha stays.
    return minimise(problem, start, alpha=posterior.alpha, free=free, iterations=iterations, tolerance=1e-4)


def train_narx(
    train: Sequence[Series],
    validation: Sequence[Series] = (),
    test: Sequence[Series] = (),
    *,
    inputs: Sequence[Input],
    hidden: Sequence[int],
    initialisations: int = 3,
    horizons: Sequence[int | None] = HORIZONS,
    seed: int = 0,
    most: int | None = 12_000,
    one_step_iterations: int = 150,
    iterations: int = 30,
    workers: int = 1,
    progress: Progress | None = None,
) -> FitNarx:
    """Trains a network and judges it.

    Every initialisation is trained one step ahead; the one of the largest evidence goes on into free run over
    growing horizons. The stage with the least free-run error on the validation stretches (on the training
    ones where there are none) is kept; the test stretches are never looked at before the end.

    Args:
        train, validation, test: stretches; lags never reach from one into another.
        inputs: as from `lagged`. hidden: tanh units per layer, such as (20,) or (10, 4).
        initialisations: number of random starts.
        horizons: stages of the free-run training, samples; () leaves it out.
        seed: the same seed gives the same network.
        most: samples per iteration at most.
        one_step_iterations, iterations: Levenberg-Marquardt steps one step ahead, and per horizon.
        workers: processes for the initialisations; the same network for any number.
        progress: called with what is done and a share from 0 to 1.

    Raises:
        InputError: too few samples, a constant channel, a command that never varies, different sample times.
    """
    check_inputs(inputs)
    check_hidden(hidden)
    if initialisations < 1:
        raise InputError(f"initialisations is {initialisations}; at least 1")
    check(train, inputs, nn.count(len(inputs), hidden))
    network = blank(train, inputs, hidden)
    for s in (*validation, *test):
        if abs(s.sample_time / network.sample_time - 1.0) > 1e-6:
            raise InputError(
                f"{s.name}: sample time {s.sample_time:g} s; the network has {network.sample_time:g} s"
            )
    say = progress or (lambda what, share: None)
    chosen = list(validation) or list(train)
    half = 0.5 if horizons else 1.0
    with threadpool_limits(limits=1):  # the sums' order, and so the weights, must not depend on the machine
        found = _starts(network, train, initialisations, seed, most, one_step_iterations, workers,
                        lambda what, share: say(what, half * share))  # fmt: skip
    posterior = max(found, key=lambda p: p.log_evidence)
    stages: list[Stage] = []
    best: tuple[float, Posterior] | None = None

    def keep(name: str, p: Posterior) -> None:
        nonlocal best
        net = network.with_theta(p.theta)
        one = pooled([one_step_error(net, s) for s in chosen])
        free = pooled([free_run_error(net, s) for s in chosen])
        free = free if np.isfinite(free) else float("inf")
        stages.append(Stage(name, p.gamma, p.iterations, one, free))
        if best is None or free < best[0]:
            best = (free, p)

    keep("one step", posterior)
    for k, horizon in enumerate(horizons):
        name = "whole" if horizon is None else f"{horizon} samples"
        say(f"free run, {name}", half + (1.0 - half) * k / len(horizons))
        with threadpool_limits(limits=1):
            posterior = refine(network, train, posterior, horizon, most=most, iterations=iterations)
        keep(name, posterior)
    say("judging", 1.0)
    assert best is not None
    result = network.with_theta(best[1].theta)
    return FitNarx(result, *judge(result, train, validation, test), best[1], tuple(stages))


def _starts(
    network: Network, train: Sequence[Series], number: int, seed: int, most: int | None, iterations: int,
    workers: int, say: Progress,
) -> list[Posterior]:  # fmt: skip
    """Every initialisation trained one step ahead, in order."""
    found: list[Posterior] = []
    if workers > 1:
        jobs = (delayed(_start)(network, train, seed, k, most, iterations) for k in range(number))
        for posterior in Parallel(n_jobs=workers, return_as="generator")(jobs):
            found.append(posterior)
            say(f"one step ahead, start {len(found)} of {number}", len(found) / number)
        return found
    for k in range(number):

        def inform(iteration: int, _: float, gamma: float, k: int = k) -> None:
            say(
                f"one step ahead, start {k + 1} of {number}, gamma {gamma:.0f}",
                (k + iteration / iterations) / number,
            )

        found.append(_start(network, train, seed, k, most, iterations, inform))
    return found


def _start(
    network: Network, train: Sequence[Series], seed: int, number: int, most: int | None, iterations: int,
    progress: Callable[[int, float, float], None] | None = None,
) -> Posterior:  # fmt: skip
    with threadpool_limits(limits=1):
        return one_step_fit(
            network, train, seed=seed, number=number, most=most, iterations=iterations, progress=progress
        )


def _error(name: str, force: Array, measured: Array) -> RecordError:
    with np.errstate(over="ignore", invalid="ignore"):
        rmse = float(np.sqrt(np.mean((force - measured) ** 2)))
    rmse = rmse if np.isfinite(rmse) else float("inf")  # a run away
    return RecordError(name, rmse, rmse / float(np.std(measured)))
