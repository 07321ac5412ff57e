"""Choice of inputs, lags and hidden units on validation records: Chen, Ni and Or (2015), Figs. 6 to 8.

Three searches after each other: input sets at given lags and units, then the lag space, then the units.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp.errors import InputError
from mrdamp.identify import pooled
from mrdamp.narx.data import Series, lagged
from mrdamp.narx.evaluation import free_run_error, one_step_error
from mrdamp.narx.problems import OneStep
from mrdamp.narx.train import best_stage, blank, fingerprint, refine, trained_once
from mrdamp.parallel import Kept, Progress, finished, silent
from mrdamp.pictures import style

SETS = ("xv", "xF", "vF", "xvF")  # Fig. 6
SETS_CURRENT = ("xvi", "xiF", "viF", "xviF")  # the same under varying current
STEPS = ("inputs", "lags", "units")


class Candidate(NamedTuple):
    """One network to try: channels such as "viF", lag space, units per hidden layer."""

    channels: str
    lags: int
    hidden: tuple[int, ...]


@dataclass(frozen=True)
class Trial:
    """What a candidate reached: RMS error over the standard deviation of the force, one step ahead and in free
    run, on training and validation; gamma and the number of weights. In free run it is the stage that is best there on
    validation, as `train_narx` keeps it."""

    candidate: Candidate
    train_one: float
    validation_one: float
    train_free: float
    validation_free: float
    gamma: float
    weights: int
    seeds: tuple[Trial, ...] = ()

    @classmethod
    def over(cls, seeds: Sequence[Trial]) -> Trial:
        """The medians over the same candidate trained from several seeds."""
        numbers = {name: float(np.median([getattr(t, name) for t in seeds])) for name in _NUMBERS}
        return cls(seeds[0].candidate, **numbers, weights=seeds[0].weights, seeds=tuple(seeds))

    def to_dict(self) -> dict[str, Any]:
        """For JSON, of one seed."""
        return {name: getattr(self, name) for name in ("candidate", *_NUMBERS, "weights")}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Trial:
        """From `to_dict`."""
        channels, lags, hidden = data["candidate"]
        return cls(**{**data, "candidate": Candidate(channels, lags, tuple(hidden))})

    def score(self, by: str) -> float:
        """The validation error that is chosen by; a run away counts as infinite."""
        value = self.validation_free if by == "free_run" else self.validation_one
        return value if np.isfinite(value) else float("inf")

    def span(self, by: str) -> tuple[float, float]:
        """The least and the largest score over the seeds."""
        scores = [t.score(by) for t in self.seeds or (self,)]
        return min(scores), max(scores)


_NUMBERS = ("train_one", "validation_one", "train_free", "validation_free", "gamma")


def as_good(trials: Sequence[Trial], by: str) -> list[Trial]:
    """Those that the seeds do not tell from the best: their range over the seeds overlaps that of the best."""
    most = min(trials, key=lambda t: t.score(by)).span(by)[1]
    return [t for t in trials if t.span(by)[0] <= most]


@dataclass(frozen=True)
class Choice:
    """The chosen candidate, and the trials of the three searches in their order."""

    candidate: Candidate
    by: str
    inputs: tuple[Trial, ...]
    lags: tuple[Trial, ...]
    units: tuple[Trial, ...]


@dataclass(frozen=True)
class Effort:
    """How thoroughly a candidate is trained: random starts, steps one step ahead, free-run horizons and steps."""

    initialisations: int = 2
    one_step_iterations: int = 60
    horizons: tuple[int, ...] = (20, 100)
    iterations: int = 10
    most: int = 4000


def try_candidate(
    candidate: Candidate, train: Sequence[Series], validation: Sequence[Series], effort: Effort, seed: int
) -> Trial:
    """Trains one candidate and evaluates it; on one thread, so that the numbers do not depend on the workers."""
    with threadpool_limits(limits=1):
        net = blank(train, lagged(candidate.channels, candidate.lags), candidate.hidden)
        problem = OneStep.of(net, train, effort.most)
        steps, numbers = effort.one_step_iterations, range(effort.initialisations)
        found = [trained_once(problem, net, (seed, number), steps) for number in numbers]
        posterior = max(found, key=lambda p: p.log_evidence)
        one = net.with_theta(posterior.theta)
        stages = [posterior]
        # Without past forces a free run is the same as a prediction one step ahead.
        for horizon in effort.horizons if net.feedback else ():
            stages.append(refine(net, train, stages[-1], horizon, effort.most, effort.iterations))
        posterior = best_stage(net, stages, validation)
        free = net.with_theta(posterior.theta)
        train_one, validation_one, train_free, validation_free = (
            pooled([error(network, s) for s in part])
            for network, error in ((one, one_step_error), (free, free_run_error))
            for part in (train, validation)
        )
    gamma, weights = posterior.gamma, len(posterior.theta)
    return Trial(candidate, train_one, validation_one, train_free, validation_free, gamma, weights)


def select(
    train: Sequence[Series],
    validation: Sequence[Series],
    *,
    sets: Sequence[str] | None = None,
    lags: Sequence[int] = range(1, 9),
    units: Sequence[int] = range(1, 26),
    start: Candidate | None = None,
    by: str = "free_run",
    effort: Effort | None = None,
    seed: int = 0,
    seeds: int = 1,
    workers: int = 1,
    cache: Path | str | None = None,
    progress: Progress | None = None,
) -> Choice:
    """Chooses inputs, then lags, then hidden units, each by the validation error with the others held.

    train, validation: parts at one sample time. sets: channels to try; None: with the current where the command varies.
    lags, units: to try. start: lags and units while the inputs are chosen; None: 4 and 10, as in the paper. by:
    `free_run`, or `one_step` as in the paper. effort: how thoroughly each is trained. seed: gives the same choice for
    any number of workers (processes). seeds: how many times each candidate is trained, from this seed on; its median
    counts. cache: JSON file of finished trials, from which an interrupted search goes on. Raises InputError.
    """
    if by not in ("free_run", "one_step"):
        raise InputError(f"choice by '{by}'; allowed: free_run, one_step")
    if not train or not validation:
        raise InputError("choosing a network needs training and validation records")
    effort, first = effort or Effort(), start or Candidate("", 4, (10,))
    if sets is None:
        varies = np.ptp(np.concatenate([s.i for s in train])) > 0.0
        sets = SETS_CURRENT if varies else SETS
    store, mark = Kept(cache), fingerprint((train, validation), "select", asdict(effort))
    total = (len(sets) + len(lags) + len(units)) * seeds
    done, say = 0, progress or silent

    def search(what: str, candidates: Sequence[Candidate]) -> tuple[Trial, ...]:
        nonlocal done
        jobs = {
            f"{mark} {_id(c)} {seed + k}": (c, train, validation, effort, seed + k)
            for c in dict.fromkeys(candidates)
            for k in range(seeds)
        }

        def tell(count: int, made: Trial | None) -> None:
            told = name_of(what, made.candidate) if made else f"{len(jobs) - count} to train"
            say(f"{what}: {told}", (done + count) / total)

        found = finished(try_candidate, jobs, store, workers, tell, Trial.to_dict, Trial.from_dict)
        done += len(jobs)
        return tuple(Trial.over([found[f"{mark} {_id(c)} {seed + k}"] for k in range(seeds)]) for c in candidates)

    by_inputs = search("inputs", [Candidate(c, first.lags, first.hidden) for c in sets])
    channels = min(by_inputs, key=lambda t: t.score(by)).candidate.channels
    by_lags = search("lags", [Candidate(channels, lag, first.hidden) for lag in lags])
    lag = min(by_lags, key=lambda t: t.score(by)).candidate.lags
    by_units = search("units", [Candidate(channels, lag, (n, *first.hidden[1:])) for n in units])
    best = min(by_units, key=lambda t: t.score(by)).candidate
    return Choice(best, by, by_inputs, by_lags, by_units)


@style.styled
def draw_choice(choice: Choice) -> Figure:
    """The three courses (Figs. 6 to 8): training and validation error, one step ahead and in free run."""
    fig = style.figure(5.6)
    rows = style.axes_grid(fig, 3, 1)
    titles = ("Inputs", "Lags", "Hidden units")
    for k, (axes, what, trials) in enumerate(
        zip((row[0] for row in rows), STEPS, (choice.inputs, choice.lags, choice.units), strict=True)
    ):
        for j, (label, name) in enumerate(_LINES):
            values = [100.0 * min(getattr(t, name), 10.0) for t in trials]
            axes.plot(range(len(trials)), values, color=style.COLOURS[j // 2], ls=style.DASHES[j % 2],
                      marker=style.MARKERS[j], ms=3.5, label=label)  # fmt: skip
        spans = 100.0 * np.minimum([t.span(choice.by) for t in trials], 10.0)
        axes.fill_between(range(len(trials)), *spans.T, color=style.REFERENCE, alpha=0.3, lw=0)
        labels = [name_of(what, t.candidate) for t in trials]
        every = max(1, -(-len(labels) // 13))
        axes.set_xticks(range(0, len(labels), every), labels[::every])
        style.log_percent(axes)
        axes.set_ylabel("error, % of std")
        scores = [t.score(choice.by) for t in trials]
        axes.axvline(int(np.argmin(scores)), color=style.REFERENCE, lw=0.8, zorder=0)
        style.row_title(axes, axes, titles[k], f"chosen: {labels[int(np.argmin(scores))]}")
    handles, texts = rows[0][0].get_legend_handles_labels()
    style.legend(fig, handles, texts)
    return fig


_LINES = (
    ("one step, training", "train_one"),
    ("one step, validation", "validation_one"),
    ("free run, training", "train_free"),
    ("free run, validation", "validation_free"),
)


def name_of(what: str, c: Candidate) -> str:
    """Of a candidate in a search: what differs."""
    return {"inputs": c.channels, "lags": str(c.lags)}.get(what, "-".join(map(str, c.hidden)))


def _id(c: Candidate) -> str:
    return f"{c.channels} {c.lags} {'-'.join(map(str, c.hidden))}"
