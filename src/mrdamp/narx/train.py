"""Training: one step ahead with Bayesian regularisation, then in free run over growing horizons."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp.errors import InputError
from mrdamp.identify import pooled
from mrdamp.model import Model
from mrdamp.narx import network as nn
from mrdamp.narx.bayes import Posterior, minimise
from mrdamp.narx.data import Series, check, scaling
from mrdamp.narx.evaluation import START, Evaluation, evaluate, free_run_error, one_step_error
from mrdamp.narx.network import Input, Network, check_hidden, check_inputs
from mrdamp.narx.problems import FreeRun, OneStep
from mrdamp.parallel import Kept, Progress, finished, silent

_FORMAT = 1


def fingerprint(parts: Sequence[Sequence[Series]], *more: object) -> str:
    """Of parts, with what they are used as, and of any JSON values."""
    digest = hashlib.sha256(json.dumps([_FORMAT, *more]).encode())
    for part in parts:
        for s in part:
            digest.update(repr((s.name, s.sample_time, s.n)).encode())
            for values in (s.x, s.v, s.i, s.force):
                digest.update(np.ascontiguousarray(values).tobytes())
        digest.update(b"|")
    return digest.hexdigest()[:16]


Score = Callable[[Network], float]

#: Samples of free run from measured lags; None: whole stretches, started as the plugin starts.
HORIZONS: tuple[int | None, ...] = (5, 20, 100, 400, None)
DISTURB = 1.5  # half ranges of the force; where every other segment of the free-run training starts, at most


@dataclass(frozen=True)
class Stage:
    """One stage of training: what it ran on, and what came out on training and validation."""

    name: str
    gamma: float
    one_step: float  # pooled NRMSE on validation (training where there is none)
    free_run: float


@dataclass(frozen=True, eq=False)
class FitNarx:
    """A trained network with both errors, the posterior of the stage it comes from, the stages, and the range of the
    commands that it was trained with (without the sign's symmetry of a law)."""

    network: Network
    one_step: Evaluation
    free_run: Evaluation
    posterior: Posterior
    stages: tuple[Stage, ...]
    commands: tuple[float, float]

    @property
    def model(self) -> Model:
        """As the plugin and `mrdamp predict` take it."""
        follows = any(channel == "i" for channel, _ in self.network.inputs)
        return Model(
            "narx", dict(zip(("command_min", "command_max"), self.commands, strict=True)) if follows else {},
            weights=self.network.to_text(), name=f"narx {self.network.topology}",
            sample_rate_hz=round(1.0 / self.network.sample_time, 6),
        )  # fmt: skip


def blank(train: Sequence[Series], inputs: Sequence[Input], hidden: Sequence[int]) -> Network:
    """A network of zeros with the scaling of these splits."""
    theta = np.zeros(nn.count(len(inputs), hidden))
    return Network(train[0].sample_time, tuple(inputs), *scaling(train, inputs), tuple(hidden), theta)


def refine(
    network: Network, train: Sequence[Series], posterior: Posterior, horizon: int | None, most: int | None = None,
    iterations: int = 30,
) -> Posterior:  # fmt: skip
    """Free-run training over one horizon from the weights, alpha and beta of a posterior, re-estimated there."""
    problem = _segments(network, train, horizon, most)
    start = posterior.theta
    if not np.isfinite(problem.cost(start)):
        return posterior
    # A new horizon has another error: beta from it, alpha stays.
    return minimise(problem, start, alpha=posterior.alpha, iterations=iterations, tolerance=1e-4)


def best_stage(network: Network, stages: Sequence[Posterior], left_out: Sequence[Series]) -> Posterior:
    """The stage of the least free-run error on the left-out stretches; a run away is never the best of several."""

    def left(p: Posterior) -> float:
        value = pooled([free_run_error(network.with_theta(p.theta), s) for s in left_out])
        return value if np.isfinite(value) else float("inf")

    return min(stages, key=left)


def train_narx(
    train: Sequence[Series],
    validation: Sequence[Series] = (),
    test: Sequence[Series] = (),
    *,
    inputs: Sequence[Input],
    hidden: Sequence[int],
    initialisations: int = 3,
    refined: int = 1,
    horizons: Sequence[int | None] = HORIZONS,
    seed: int = 0,
    most: int | None = 12_000,
    one_step_iterations: int = 150,
    iterations: int = 30,
    score: Score | None = None,
    workers: int = 1,
    cache: Path | str | None = None,
    progress: Progress | None = None,
) -> FitNarx:
    """Trains a network and evaluates it.

    Every initialisation is trained one step ahead; those of the largest evidence go on into free run over growing
    horizons. The stage with the least free-run error on the validation stretches (on the training ones where there are
    none) is kept; the test stretches are never looked at before the end.

    train, validation, test: stretches; lags never reach from one into another. inputs: as from `lagged`. hidden: tanh
    units per layer, such as (20,) or (10, 4). initialisations: random starts; refined: how many of them are trained in
    free run. horizons: stages of that, samples; () leaves it out. seed: gives the same network for any number of
    workers (processes). most: samples per iteration at most. one_step_iterations, iterations: Levenberg-Marquardt steps
    one step ahead, and per horizon. score: error that the stages are chosen by; None: free run on the validation
    splits. cache: JSON file of what is finished, from which an interrupted training goes on.

    Raises InputError: too few samples, a constant channel, a command that never varies, different sample times.
    """
    check_inputs(inputs)
    check_hidden(hidden)
    if not 1 <= refined <= initialisations:
        raise InputError(
            f"initialisations is {initialisations}, {refined} of them refined; allowed: 1 to all"
        )
    check(train, inputs, nn.count(len(inputs), hidden))
    network = blank(train, inputs, hidden)
    for s in (*validation, *test):
        if abs(s.sample_time / network.sample_time - 1.0) > 1e-6:
            raise InputError(
                f"{s.name}: sample time {s.sample_time:g} s; the network has {network.sample_time:g} s"
            )
    chosen = list(validation) or list(train)
    rate = score or (lambda net: pooled([free_run_error(net, s) for s in chosen]))
    shape = [list(map(list, inputs)), list(hidden), seed, most, one_step_iterations, iterations]
    mark = fingerprint((train,), "train", *shape)
    store, tell = Kept(cache), progress or silent

    def made(
        work: Callable[..., Posterior], jobs: Mapping[str, tuple[Any, ...]], problem: OneStep | FreeRun,
        say: Callable[[int, Posterior | None], None] = lambda done, made: None,
    ) -> list[Posterior]:  # fmt: skip
        """What `work` makes of each job, in order; finished ones from the store."""
        marked = {f"{mark} {name}": job for name, job in jobs.items()}
        return list(finished(work, marked, store, workers, say, _kept, partial(_read, problem)).values())

    def started(done: int, _: Posterior | None) -> None:
        share = (0.5 if horizons else 1.0) * done / initialisations
        tell(f"one step ahead, start {min(done + 1, initialisations)} of {initialisations}", share)

    one_step = OneStep.of(network, train, most)
    jobs = {f"start {k}": (one_step, network, (seed, k), one_step_iterations) for k in range(initialisations)}
    starts = made(trained_once, jobs, one_step, started)
    order = sorted(range(len(starts)), key=lambda k: -starts[k].log_evidence)[:refined]
    chains = [starts[k] for k in order]
    stages: list[Stage] = []
    best: tuple[float, Posterior] | None = None

    def keep(name: str, found: Sequence[Posterior]) -> None:
        nonlocal best
        for k, p in zip(order, found, strict=True):
            net = network.with_theta(p.theta)
            one, free = pooled([one_step_error(net, s) for s in chosen]), rate(net)
            free = free if np.isfinite(free) else float("inf")
            label = name if refined == 1 else f"start {k + 1}, {name}"
            stages.append(Stage(label, p.gamma, one, free))
            if best is None or free < best[0]:
                best = (free, p)

    keep("one step", chains)
    done = ""
    for k, horizon in enumerate(horizons):
        name = "whole" if horizon is None else f"{horizon} samples"
        tell(f"free run, {name}", 0.5 + 0.5 * k / len(horizons))
        done += f" {name}"
        longer = {
            f"start {j}{done}": (network, train, p, horizon, most, iterations)
            for j, p in zip(order, chains, strict=True)
        }
        chains = made(refine, longer, _segments(network, train, horizon, most))
        keep(name, chains)
    tell("evaluating", 1.0)
    assert best is not None
    result = network.with_theta(best[1].theta)
    commands = np.concatenate([s.i for s in train])
    span = float(commands.min()), float(commands.max())
    return FitNarx(result, *evaluate(result, train, validation, test), best[1], tuple(stages), span)


def trained_once(problem: OneStep, network: Network, seed: tuple[int, int], iterations: int) -> Posterior:
    """One step ahead, from random weights."""
    start = nn.nguyen_widrow(len(network.inputs), network.hidden, np.random.default_rng(seed))
    return minimise(problem, start, iterations=iterations)


def _segments(network: Network, train: Sequence[Series], horizon: int | None, most: int | None) -> FreeRun:
    skip = int(START / network.sample_time)
    return FreeRun.of(network, train, horizon, most, skip=skip, disturb=DISTURB)


_SMALL = tuple(f.name for f in fields(Posterior) if f.name not in ("theta", "normal"))


def _kept(posterior: Posterior) -> dict[str, Any]:
    """A posterior without J'J, which its weights give again."""
    return {"theta": posterior.theta.tolist()} | {name: getattr(posterior, name) for name in _SMALL}


def _read(problem: OneStep | FreeRun, found: Mapping[str, Any]) -> Posterior:
    theta = np.array(found["theta"], dtype=np.float64)
    with threadpool_limits(limits=1):
        normal = problem.normal(theta)[0]
    return Posterior(theta=theta, normal=normal, **{name: found[name] for name in _SMALL})
