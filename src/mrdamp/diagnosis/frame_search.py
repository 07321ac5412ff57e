"""Searching a frame's catalogue: the nominal numbers held, effects are added one by one, best ones kept side by side.

A frame is seen by many channels at once, so a cause with one or two numbers either explains what every channel shows
or does not. A storey's stiffness, damping and mass are nominal numbers too; with all of them free nothing would be
left to name. Hence the nominal numbers are freed last (`recalibrated`), and compete as a hypothesis of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.core import Array
from mrdamp.diagnosis.fit import Fit, fit
from mrdamp.diagnosis.problem import Problem
from mrdamp.diagnosis.terms import Coordinate, Hypothesis, Term

Progress = Callable[[str, float], None]

#: Causes that are fitted after a screening: alone, and beside each of the best `_BEAM` before.
_SINGLES, _BEAM, _SECONDS = 6, 3, 4
_MOST = 12
#: A fit that leaves less than this share of the excess, with the next best prediction so many times as bad, ends
#: the round.
_CLEAR, _APART = 0.01, 5.0


@dataclass(frozen=True)
class Screened:
    """A term at the start that promises most: the cost it would leave, linearised, its number of the start."""

    cost: float
    start: int
    term: Term


def nothing(problem: Problem) -> Fit:
    """The nominal simulator as it is."""
    residual = problem.residuals(Hypothesis(()), np.zeros(0))[0]
    return Fit(Hypothesis(()), np.zeros(0), float(residual @ residual), residual, np.zeros((len(residual), 0)))


def screen(problem: Problem, base: Fit, terms: Sequence[Term]) -> list[Screened]:
    """One run for each start of each term beside `base`, whose own numbers give way linearly; best first."""
    starts = [(term, k) for term in terms for k in range(len(term.starts))]
    settings = []
    for term, k in starts:
        extended = base.hypothesis.plus(term)
        point = extended.start((0,) * len(base.hypothesis.terms) + (k,))
        point[: len(base.point)] = base.point
        settings.append(extended.settings(point))
    basis = np.linalg.qr(base.jacobian)[0] if base.jacobian.size else np.zeros((len(base.residual), 0))
    left = base.residual - basis @ (basis.T @ base.residual)
    best: dict[str, Screened] = {}
    for first in range(0, len(starts), 16):
        rows = problem.of_settings(settings[first : first + 16])
        for (term, k), row in zip(starts[first : first + 16], rows, strict=True):
            cost = _promise(row - base.residual, left, basis, term)
            if term.name not in best or cost < best[term.name].cost:
                best[term.name] = Screened(cost, k, term)
    return sorted(best.values(), key=lambda s: (s.cost, s.term.name))


def _promise(change: Array, left: Array, basis: Array, term: Term) -> float:
    """Cost that a change of the residual would leave at its best size, up to 3 times the one tried."""
    change = change - basis @ (basis.T @ change)
    size, along = float(change @ change), float(change @ left)
    if size < 1e-14:
        return float(left @ left)
    one_sided = term.effect != "sensor_gain" and (term.coordinates[0].low >= 0 or term.coordinates[0].log)
    amount = min(max(-along / size, 0.0 if one_sided else -3.0), 3.0)
    return float(left @ left) + 2 * amount * along + amount**2 * size


def extend(problem: Problem, base: Fit, chosen: Sequence[Screened], enough: float) -> list[Fit]:
    """Fits of `base` with each term added, all effects' numbers free. Ends when one leaves `enough` and is clear."""
    fits: list[Fit] = []
    for k, item in enumerate(chosen):
        extended = base.hypothesis.plus(item.term)
        start = extended.start((0,) * len(base.hypothesis.terms) + (item.start,))
        start[: len(base.point)] = base.point
        fits.append(fit(problem, extended, start, most=_MOST))
        best = min(f.cost for f in fits)
        ahead = chosen[k + 1].cost if k + 1 < len(chosen) else np.inf
        if best < enough and ahead > _APART * enough:
            break
    return sorted(fits, key=lambda f: f.cost)


def distinct(screened: Sequence[Screened], known: Sequence[str], most: int) -> list[Screened]:
    """The best `most` whose causes are not known and not twice among them."""
    out: list[Screened] = []
    for item in screened:
        if item.term.cause not in known and item.term.cause not in [o.term.cause for o in out]:
            out.append(item)
    return out[:most]


@dataclass(frozen=True)
class Found:
    """What a search fitted. floor: cost of noise alone. singles, pairs, triples: best first. recalibrated: all nominal
    numbers free and no effect. nominal: as it came."""

    floor: float
    nominal: Fit
    singles: tuple[Fit, ...]
    pairs: tuple[Fit, ...]
    triples: tuple[Fit, ...]
    recalibrated: Fit

    def left(self, found: Fit) -> float:
        """Share of the excess over the noise that a fit leaves."""
        return (found.cost - self.floor) / max(self.nominal.cost - self.floor, 1e-12)


def search(
    problem: Problem,
    terms: Sequence[Term],
    nominal: tuple[Coordinate, ...],
    floor: float,
    progress: Progress | None = None,
) -> Found:
    """Singles, pairs beside the best singles, a third beside the best pair, and the nominal numbers alone."""
    tell = progress or (lambda what, share: None)
    base = nothing(problem)
    excess = max(base.cost - floor, 0.0)
    enough = floor + _CLEAR * excess
    tell("screening", 0.05)
    first = distinct(screen(problem, base, terms), (), _SINGLES)
    tell("single effects", 0.15)
    singles = extend(problem, base, first, enough)
    tell("nominal numbers", 0.4)
    free = Hypothesis(nominal)
    recalibrated = fit(problem, free, np.zeros(len(nominal)), most=6)
    pairs: list[Fit] = []
    triples: list[Fit] = []
    if singles[0].cost > enough:
        for k, one in enumerate(singles[:_BEAM]):
            tell("pairs", 0.5 + 0.1 * k)
            second = distinct(screen(problem, one, terms), one.hypothesis.causes, _SECONDS)
            pairs += extend(problem, one, second, enough)
        pairs.sort(key=lambda f: f.cost)
        pairs = _unique(pairs)
        if pairs[0].cost > enough:
            tell("a third effect", 0.8)
            third = distinct(screen(problem, pairs[0], terms), pairs[0].hypothesis.causes, 3)
            triples = extend(problem, pairs[0], third, enough)
    return Found(floor, base, tuple(singles), tuple(pairs), tuple(triples), recalibrated)


def _unique(fits: Sequence[Fit]) -> list[Fit]:
    seen: set[frozenset[str]] = set()
    out = []
    for f in fits:
        causes = frozenset(f.hypothesis.causes)
        if causes not in seen:
            seen.add(causes)
            out.append(f)
    return out
