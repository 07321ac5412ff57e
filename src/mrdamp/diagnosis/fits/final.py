"""The corrected simulator: the chosen causes fitted with the full step to all records, and what mends their form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.regimes import by_record, left_out, regime_cost
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.fits.second_cause import others
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.problem.rig import Rig
from mrdamp.model.core import Array

#: A correction of form stays where it takes this share off the held-out excess.
_WORTH = 0.15
_ROUNDS = 2
#: Other fits of the same causes that are fitted with the full step where the chosen one is worse than nothing.
_OTHERS = 3
#: Share of its cost, or of the excess, by which a fit may change with the full step and be taken as it is.
_SAME, _NOTHING = 0.02, 1e-5
#: Iterations that a fit which was still moving goes on for; those of a fit of excerpts on the whole records.
_THROUGH, _WHOLE_STEPS = 8, 3
#: Share of what is left of regimes left out that free numbers of the law have to take off.
_FREER = 0.1
#: Samples of residuals that the last fit keeps.
_SAMPLES = 20_000


@dataclass(frozen=True)
class FinalFit:
    """The final fit, the names of terms that mend a form and are not named, gaps (blocks,) on records left out."""

    fit: Fit
    corrections: tuple[str, ...]
    heldout: Array
    problem: Problem


def heldout(problem: Problem, found: Fit) -> Array:
    """Gaps (blocks,) with every record left out in turn."""
    return left_out(problem, found, by_record(problem))


def refine(search: Search, chosen: Fit) -> tuple[Fit, tuple[str, ...]]:
    """Frees the law's numbers, and adds terms that are not named, where records left out get better by it."""
    best = chosen
    corrections: tuple[str, ...] = ()
    score = _cost(search, chosen)
    for _ in range(_ROUNDS):
        if search.solved(best):
            break
        trials: list[tuple[Fit, tuple[str, ...]]] = []
        if not best.hypothesis.nominal:
            free = Hypothesis(search.problem.rig.nominal, best.hypothesis.terms)
            start = np.concatenate([np.zeros(len(free.nominal)), best.point])
            trials.append((search.fitted(free, start, most=6, stage=" freed"), corrections))
        for test in others(search, best)[:2]:
            if test.cost > (1 - _WORTH / 3) * best.cost:
                continue
            hypothesis, start = search.start_from(best, test.term, test.start, test.by)
            key = (bool(hypothesis.nominal), frozenset(t.name for t in hypothesis.terms))
            found = search.fits.get(key) or search.fitted(
                hypothesis, start, most=8, known=search.law_columns(best), stage=" mended"
            )
            trials.append((found, (*corrections, test.term.name)))
        scored = [(_cost(search, f), f, c) for f, c in trials]
        if not scored:
            break
        value, found, names = min(scored, key=lambda item: (item[0], item[1].hypothesis.name))
        if value - search.floor > (1 - _WORTH) * (score - search.floor):
            break
        best, score, corrections = found, value, names
    return best, corrections


def final_fit(
    search: Search,
    chosen: Fit,
    tell: Callable[[str], None] = lambda text: None,
    *,
    mend: bool = True,
    rig: Rig | None = None,
) -> FinalFit:
    """The chosen fit refined (`mend`), then fitted with the chain's own step as the handed-over simulator runs.

    Where that is worse than the nominal simulator (a form that the full step cannot follow), the same causes in other
    forms or with the law held or free are fitted in its place, and the least bad is handed over.

    rig: with the whole records, where the search went by excerpts. Where nothing meets the noise, nothing is mended: of
    the fits of the chosen causes, with the law held and free, the one that leaves least of regimes left out is taken.
    """
    chosen = _through(search, chosen)
    corrections: tuple[str, ...] = ()
    best = chosen
    if mend and search.inexact:
        best = steadiest(search, chosen)
    elif mend:
        best, corrections = refine(search, chosen)
    tell("final fit")
    whole = None if rig is None or rig is search.problem.rig else rig
    if whole is not None:
        return _of_whole(search, _through(search, best), whole)
    final = _with_full_step(search, _through(search, best), corrections)
    nominal = _square(search.problem.gaps(search.residual))
    if not mend or _square(final.heldout) <= nominal:
        return final
    causes = set(chosen.hypothesis.causes)
    fits = sorted((f for free in (False, True) for f in search.ranked(free)), key=lambda f: f.cost)
    others = [f for f in fits if set(f.hypothesis.causes) == causes and f is not best]
    for other in others[:_OTHERS]:
        again = _with_full_step(search, other, ())
        if _square(again.heldout) < _square(final.heldout):
            final = again
        if _square(final.heldout) <= nominal:
            break
    return final


def steadiest(search: Search, chosen: Fit) -> Fit:
    """Of the fits of the chosen causes the one that leaves least of regimes left out; with the law's numbers where
    their owner believes them, unless free ones leave less by _FREER: they were identified on this rig."""
    causes = set(chosen.hypothesis.causes)
    found = {
        free: min(
            [f for f in search.ranked(free) if set(f.hypothesis.causes) == causes][:_OTHERS],
            key=lambda f: regime_cost(search.problem, f),
            default=None,
        )
        for free in (False, True)
    }
    held, free = found[False], found[True]
    if held is None or free is None:
        return held or free or chosen
    better = regime_cost(search.problem, free) < (1 - _FREER) * regime_cost(search.problem, held)
    return free if better else held


def _of_whole(search: Search, found: Fit, rig: Rig) -> FinalFit:
    """A fit of excerpts taken on with the whole records and the chain's own step."""
    stride = max(1, round(sum(r.n for r in rig.records) * len(rig.channels) / _SAMPLES))
    problem = Problem(rig, stride=stride, trust=search.problem.trust)
    steps = 0 if not found.hypothesis.coordinates else _WHOLE_STEPS
    final = fit(problem, found.hypothesis, found.point, most=steps)
    return FinalFit(final, (), heldout(problem, final), problem)


def _through(search: Search, found: Fit) -> Fit:
    """A fit that a search broke off while it was still moving, taken to where it rests."""
    if found.converged or not found.hypothesis.coordinates:
        return found
    further = search.fitted(found.hypothesis, found.point, most=_THROUGH, stage=" through")
    return min(further, found, key=lambda f: f.cost)


def _with_full_step(search: Search, found: Fit, corrections: tuple[str, ...]) -> FinalFit:
    coarse = search.problem
    fine = Problem(coarse.rig, coarse.records, stride=coarse.stride, trust=coarse.trust)
    final = replace(fit(fine, found.hypothesis, found.point, most=0), converged=found.converged)
    # Where the steps of a search were good enough that is that.
    if abs(final.cost - found.cost) > max(_SAME * found.cost, _NOTHING * search.excess):
        known = search.law_columns(found)
        final = fit(fine, found.hypothesis, found.point, most=2, known=known, frozen=known is not None)
    return FinalFit(final, corrections, heldout(fine, final), fine)


def _square(gaps: Array) -> float:
    return float(np.mean(gaps**2))


def _cost(search: Search, found: Fit) -> float:
    return search.problem.cost(heldout(search.problem, found))
