"""The next test: the signal within the rig's limits that best separates what these records leave tied or
hidden.

Criterion: T-optimality (Atkinson, Fedorov 1975, doi:10.1093/biomet/62.1.57), the distance between one
simulator's response and the best fit of its rival to it. The rival's fit is linearised, and the existing
records constrain its parameters. For several pairs the product of their distances is maximised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mrdamp.diagnosis.evidence.verdict import Decision
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Settings, Term
from mrdamp.diagnosis.problem.designs import SECONDS, Design, Envelope, Signal, columns, drawn, neighbour
from mrdamp.diagnosis.problem.residuals import compared
from mrdamp.diagnosis.problem.rig import Rig
from mrdamp.errors import InputError
from mrdamp.model.core import Array

_SEED = 11
#: Numbers of random tests, of tests with a refitted rival, and of variations of the best ones; the same for a
#: confirmation test, if nothing is tied or hidden.
_EFFORT, _LITTLE = (24, 6, 8), (10, 3, 2)
#: Largest number of pairs; distance beyond which a pair counts as separated.
_PAIRS, _PARTED = 4, 10.0
#: Distance below which a pair cannot be separated.
_APART = 0.1
#: Step of the finite differences, in units of search.
_STEP = 0.05


@dataclass(frozen=True, eq=False)
class Steps:
    """Settings with one coordinate changed at a time, by `sizes` (coordinates,) in units of search."""

    settings: tuple[Settings, ...]
    sizes: Array

    @classmethod
    def of(cls, hypothesis: Hypothesis, point: Array, which: slice) -> Steps:
        """Steps from a point, away from a limit of the range. which: slice of the coordinates."""
        high = hypothesis.bounds()[1]
        sizes = np.where(point + _STEP <= high, _STEP, -_STEP)
        moved = [
            hypothesis.settings(point + size * row)
            for size, row in zip(sizes, np.eye(len(point)), strict=True)
        ]
        return cls(tuple(moved[which]), sizes[which])

    def columns(self, runs: Array, at: Array) -> Array:
        """Derivatives (coordinates, samples) from runs (coordinates, samples) and the run at the point; 0 for
        a diverged run."""
        return np.nan_to_num((runs - at) / self.sizes[:, None], posinf=0.0, neginf=0.0)


@dataclass(frozen=True, eq=False)
class Pair:
    """Two simulators to be separated: `one` may be true, and `rival` is fitted to it.

    names: of both. own: of the rival's own coordinates. known (columns, samples): derivatives of the rival's
    response to the existing records with respect to the nominal parameters and its own. apart (samples,):
    difference of the two there. Both are relative to the noise.
    """

    names: tuple[str, str]
    one: Settings
    rival: Settings
    own: Steps
    known: Array
    apart: Array

    @cached_property
    def curvature(self) -> Array:
        """(columns, columns): information of the existing records about the parameters."""
        out = self.known @ self.known.T
        return np.asarray(out + 1e-9 * max(float(np.trace(out)), 1e-12) * np.eye(len(out)))

    @cached_property
    def pull(self) -> Array:
        """(columns,): gradient of the existing records."""
        return np.asarray(self.known @ self.apart)

    def gained(self, j: Array, apart: Array) -> float:
        """Increase, by a test, of the least sum of squares to which the rival can be fitted.

        j (columns, samples), apart (samples,): as `known` and `apart`, for the test.
        """
        pull = self.pull + j @ apart
        explained = float(pull @ np.linalg.solve(self.curvature + j @ j.T, pull))
        before = float(self.pull @ np.linalg.solve(self.curvature, self.pull))
        return max(float(apart @ apart) - explained + before, 0.0)


@dataclass(frozen=True, eq=False)
class Bench:
    """A rig on which tests are simulated. law: steps of the nominal parameters from `middle`. noise
    (channels,): standard deviations."""

    rig: Rig
    middle: Settings
    law: Steps
    noise: Array

    def signal(self, design: Design) -> Signal:
        """A test's inputs, within the rig's limits."""
        return self.rig.admitted(design.signal(self.rig.envelope), self.middle)

    def distances(self, signal: Signal, pairs: Sequence[Pair], *, fitted: bool) -> Array:
        """RMS distance of each pair over the noise (pairs,). fitted: the rival is refitted to all records."""
        wanted: list[Sequence[Settings]] = [[p.one for p in pairs], [p.rival for p in pairs]]
        if fitted:
            wanted += [[self.middle], self.law.settings, *(p.own.settings for p in pairs)]
        runs = self._tried([s for some in wanted for s in some], signal)
        first = compared(runs.shape[2], self.rig.envelope.sample_time).start
        flat = (runs[:, :, first:] / self.noise[:, None]).reshape(len(runs), -1)
        ones, rivals, *steps = np.split(flat, np.cumsum([len(some) for some in wanted])[:-1])
        if not np.isfinite(flat[: 2 * len(pairs)]).all():
            return np.zeros(len(pairs))
        apart = [one - rival for one, rival in zip(ones, rivals, strict=True)]
        totals = [float(a @ a) for a in apart]
        if fitted:
            law = self.law.columns(steps[1], steps[0][0])
            own = [p.own.columns(*moved) for p, *moved in zip(pairs, steps[2:], rivals, strict=True)]
            totals = [p.gained(np.vstack([law, j]), a) for p, j, a in zip(pairs, own, apart, strict=True)]
        return np.sqrt(np.array(totals) / flat.shape[1])

    def _tried(self, settings: Sequence[Settings], signal: Signal) -> Array:
        """Runs (sets, channels, n); NaN for settings that the chain rejects, such as steps beyond its limits.
        """
        try:
            return self.rig.try_signal(settings, signal)
        except InputError:
            if len(settings) == 1:
                return np.full((1, len(self.rig.channels), len(signal.motion)), np.nan)
            return np.concatenate([self._tried([one], signal) for one in settings])


@dataclass(frozen=True, eq=False)
class Proposal:
    """A test with its predicted distances (pairs,)."""

    design: Design
    signal: Signal
    distances: Array


def best(
    bench: Bench, pairs: Sequence[Pair], envelope: Envelope, effort: tuple[int, int, int] = _EFFORT
) -> Proposal:
    """The best of some dozens of tests.

    All are ranked by the distance without refitting, the better ones with the rival refitted; then variations
    of the best are tried. effort: how many of each.
    """
    rng = np.random.default_rng(_SEED)
    designs = [drawn(rng, envelope) for _ in range(effort[0])]
    plain = [_value(bench.distances(bench.signal(d), pairs, fitted=False)) for d in designs]
    order = np.argsort(-np.array(plain), kind="stable")[: effort[1]]

    def proposal(design: Design) -> Proposal:
        signal = bench.signal(design)
        return Proposal(design, signal, bench.distances(signal, pairs, fitted=True))

    found = sorted((proposal(designs[k]) for k in order), key=lambda p: -_value(p.distances))
    for _ in range(effort[2]):
        other = found[int(rng.integers(len(found)))].design
        trial = proposal(neighbour(rng, found[0].design, other, envelope))
        if _value(trial.distances) > _value(found[0].distances):
            found = [trial, *found]
    return found[0]


def _value(distances: Array) -> float:
    """Sum of logarithms; a pair beyond the limit counts no more."""
    return float(np.sum(np.log(np.clip(distances, 1e-6, _PARTED))))


def next_test(
    search: Search,
    chosen: Fit,
    fits: Sequence[Fit],
    decision: Decision,
    ties: Sequence[Sequence[str]],
    hidden: Sequence[dict[str, Any]],
    noise: Array,
) -> tuple[dict[str, Any], dict[str, Array] | None]:
    """The next test for the report, and the columns of its CSV file. noise (channels,): standard deviations.
    """
    rig = search.problem.rig
    make = _Pairs(search, chosen, np.maximum(np.maximum(noise, _left(search, chosen)), 1e-12))
    pairs: list[Pair] = []
    reasons = []
    for tie in ties:
        pairs += [make.against(f) for f in make.tied(tie)]
    if ties:
        reasons.append(f"these records leave {' and '.join(ties[0])} tied")
    near = rival(chosen, [fits[k] for k in np.argsort(-np.array(decision.probabilities), kind="stable")])
    if decision.verdict == "unknown" and near is not None:
        pairs.append(make.against(near))
        reasons.append(f"to separate {' from '.join(pairs[-1].names)}, the nearest known causes")
    first: dict[str, Term] = {}  # cause of each stage
    for term in (t for t in rig.terms if any(t.cause == u["effect"] for u in hidden)):
        first.setdefault(term.stage, term)
    terms = list(first.values())[:_PAIRS]
    pairs += [make.unseen(t) for t in terms]
    if terms:
        reasons.append(f"these records hardly show {', '.join(t.cause for t in terms)}")
    effort = _EFFORT if pairs else _LITTLE
    if not pairs:
        if near is None:
            return {"why": "nothing is tied and nothing is unseen", "signal": "none"}, None
        pairs = [make.against(near)]
        reasons.append(f"nothing is tied; it would best separate {' from '.join(pairs[0].names)}")
    why = "; ".join(reasons)
    pairs, envelope = pairs[:_PAIRS], rig.envelope
    found = best(make.bench, pairs, envelope, effort)
    parted = found.distances[found.distances > _APART]
    for p, d in zip(pairs, found.distances, strict=True):
        why += f"; no test within these limits separates {' from '.join(p.names)}" if d <= _APART else ""
    test = {
        "why": why,
        "signal": f"{SECONDS:g} s: {found.design.text(envelope)}",
        "separation": float(parted.min() if len(parted) else found.distances.max()),
        "separates": [
            {"one": p.names[0], "rival": p.names[1], "separation": float(d)}
            for p, d in zip(pairs, found.distances, strict=True)
        ],
        "file": "next_experiment.csv",
    }
    return test, dict(columns(found.signal, envelope))


def rival(chosen: Fit, fits: Sequence[Fit]) -> Fit | None:
    """The first fit whose causes are neither a subset nor a superset of the chosen one's; for a chosen fit
    without causes, the first fit with any."""
    own = set(chosen.hypothesis.causes)
    for found in fits:
        causes = set(found.hypothesis.causes)
        if causes - own and not (own and own <= causes):
            return found
    return None


class _Pairs:
    """Pairs about the chosen fit, and the bench to simulate tests. noise (channels,) as in `Bench`."""

    def __init__(self, search: Search, chosen: Fit, noise: Array) -> None:
        self.search, self.chosen, problem = search, chosen, search.problem
        free = Hypothesis(problem.rig.nominal, chosen.hypothesis.terms)
        law = slice(len(free.nominal))
        point = chosen.point
        if not chosen.hypothesis.nominal:
            point = np.concatenate([np.zeros(len(free.nominal)), point])
        self.bench = Bench(problem.rig, free.settings(point), Steps.of(free, point, law), noise)
        self.steps = Steps.of(free, point, slice(len(free.nominal), None))
        # Residuals in noise standard deviations, all samples of the records.
        scale = np.empty(problem.samples)
        for b in problem.blocks:
            scale[b.span] = np.sqrt(problem.stride) / (problem.weights[b.span] * noise[b.channel])
        self.scale = scale
        self.law = chosen.jacobian[:, law] if chosen.hypothesis.nominal else search.base.jacobian

    def tied(self, tie: Sequence[str]) -> list[Fit]:
        """The best fits with another cause of a tie in place of the named one."""
        own = set(self.chosen.hypothesis.causes)
        named = next(c for c in tie if c in own)
        out = []
        for cause in (c for c in tie if c != named):
            wanted = (own - {named}) | {cause}
            alike = [self.search.smallest(free, wanted) for free in (False, True)]
            alike = [self.search.base] if cause == "parameters" else alike
            out += [f for f in alike if f is not None][:1]
        return out

    def against(self, rival: Fit) -> Pair:
        """The chosen simulator and a rival."""
        hypothesis = rival.hypothesis
        own = slice(len(hypothesis.nominal), None)
        names = (self.chosen.hypothesis.name, hypothesis.name)
        steps = Steps.of(hypothesis, rival.point, own)
        apart = self.scale * (self.chosen.residual - rival.residual)
        return Pair(names, self.chosen.settings, rival.settings, steps, self._known(rival), apart)

    def unseen(self, term: Term) -> Pair:
        """The chosen simulator with and without an effect that the records hardly show, at its usual size."""
        added = Hypothesis((), (term,))
        with_it = self.chosen.settings | added.settings(added.start())
        apart = self.scale * (self.search.problem.of_settings([with_it])[0] - self.chosen.residual)
        names = (term.cause, "none of it")
        return Pair(names, with_it, self.chosen.settings, self.steps, self._known(self.chosen), apart)

    def _known(self, rival: Fit) -> Array:
        own = rival.jacobian[:, len(rival.hypothesis.nominal) :]
        return np.asarray((np.hstack([self.law, own]) * self.scale[:, None]).T)


def _left(search: Search, chosen: Fit) -> Array:
    """RMS residual (channels,) of the chosen fit in the channels' units: model errors count as noise."""
    problem = search.problem
    squares: list[list[Array]] = [[] for _ in problem.rig.channels]
    for b in problem.blocks:
        squares[b.channel].append((chosen.residual[b.span] / problem.weights[b.span]) ** 2)
    return np.array([np.sqrt(np.mean(np.concatenate(s))) for s in squares])
