"""The corrected simulator: the chosen causes fitted to all records with the full step, and corrections of
their form."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from mrdamp.diagnosis.fits.alternative_forms import others
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.regimes import by_record, left_out
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.problem.rig import Rig
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array

#: A correction of the form is kept if it reduces the excess on left-out records by this share.
_WORTH = 0.15
_ROUNDS = 2
#: Number of other fits of the same causes that are tried with the full step if the chosen one is worse than
#: nominal.
_OTHERS = 3
#: A fit is accepted unchanged if the full step changes its cost by less than this share of the cost or of the
#: excess.
_SAME, _NOTHING = 0.02, 1e-5
#: Further iterations of a fit that had not converged; iterations of a fit to excerpts on the whole records.
_THROUGH, _WHOLE_STEPS = 8, 3
#: Free nominal parameters must reduce the mean square on left-out folds by this share.
_FREER = 0.1


@dataclass(frozen=True)
class FinalFit:
    """The final fit, the names of terms that correct a form without being reported as causes, and gaps
    (blocks,) on left-out records."""

    fit: Fit
    corrections: tuple[str, ...]
    heldout: Array
    problem: Problem


def heldout(problem: Problem, found: Fit) -> Array:
    """Gaps (blocks,) with each record left out in turn."""
    return left_out(problem, found, by_record(problem))


def refine(search: Search, chosen: Fit) -> tuple[Fit, tuple[str, ...]]:
    """Frees the nominal parameters and adds unreported terms if this improves left-out records."""
    best = chosen
    corrections: tuple[str, ...] = ()
    score = _cost(search, chosen)
    for _ in range(_ROUNDS):
        if search.solved(best):
            break
        trials: list[tuple[Fit, tuple[str, ...]]] = []
        if not best.hypothesis.nominal:
            free = search.fitted(*search.with_free_law(best), most=6, stage=" freed")
            trials.append((free, corrections))
        for test in others(search, best)[:2]:
            if test.cost > (1 - _WORTH / 3) * best.cost:
                continue
            hypothesis, start = search.start_from(best, test.term, test.start, test.by)
            found = search.fits.get(hypothesis.key) or search.fitted(
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
    *,
    mend: bool = True,
    rig: Rig | None = None,
) -> FinalFit:
    """The chosen fit with corrections of its form (`mend`), fitted with the full step of the chain, as the
    handed-over simulator runs.

    If the result is worse than the nominal simulator, the same causes are fitted in other forms or with fixed
    or free nominal parameters, and the best of these is returned. rig: with the whole records, if the search
    used excerpts. If no fit reaches the noise, the form is not corrected. The result is then the fit of the
    chosen causes, with fixed or free nominal parameters, with the least error on left-out folds.
    """
    chosen = _converged(search, chosen)
    corrections: tuple[str, ...] = ()
    best = chosen
    if mend and search.inexact:
        best = least_left_out(search, chosen)
    elif mend:
        best, corrections = refine(search, chosen)
    whole = None if rig is None or rig is search.problem.rig else rig
    if whole is not None:
        return _of_whole(search, _converged(search, best), whole)
    final = _with_full_step(search, _converged(search, best), corrections)
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


def least_left_out(search: Search, chosen: Fit) -> Fit:
    """The fit of the chosen causes with the least error on left-out folds, of those that a model file takes.

    Nominal parameters stay fixed unless free ones reduce the error by _FREER: they were identified on this
    rig.
    """
    causes, rig = set(chosen.hypothesis.causes), search.problem.rig
    found = {
        free: min(
            [f for f in search.ranked(free) if set(f.hypothesis.causes) == causes and in_file(rig, f)][:_OTHERS],
            key=search.left_out_cost,
            default=None,
        )
        for free in (False, True)
    }
    fixed_law, free = found[False], found[True]
    if fixed_law is None or free is None:
        return fixed_law or free or chosen
    better = search.left_out_cost(free) < (1 - _FREER) * search.left_out_cost(fixed_law)
    return free if better else fixed_law


def in_file(rig: Rig, found: Fit) -> bool:
    """True if a model file takes the simulator of a fit: no coefficient is negative at both ends of the command."""
    with suppress(InputError):
        Model.from_dict(rig.model(found.settings).to_dict())
        return True
    return False


def _of_whole(search: Search, found: Fit, rig: Rig) -> FinalFit:
    """A fit of excerpts, continued on the whole records with the full step of the chain."""
    problem = Problem.thinned(rig, trust=search.problem.trust)
    steps = 0 if not found.hypothesis.coordinates else _WHOLE_STEPS
    final = fit(problem, found.hypothesis, found.point, most=steps)
    return FinalFit(final, (), heldout(problem, final), problem)


def _converged(search: Search, found: Fit) -> Fit:
    """A fit that the search stopped before convergence, continued."""
    if found.converged or not found.hypothesis.coordinates:
        return found
    further = search.fitted(found.hypothesis, found.point, most=_THROUGH, stage=" through")
    return min(further, found, key=lambda f: f.cost)


def _with_full_step(search: Search, found: Fit, corrections: tuple[str, ...]) -> FinalFit:
    fine = search.problem.like(coarse=False)
    final = replace(fit(fine, found.hypothesis, found.point, most=0), converged=found.converged)
    # If the step of the search was small enough, its fit is the result.
    if abs(final.cost - found.cost) > max(_SAME * found.cost, _NOTHING * search.excess):
        known = search.law_columns(found)
        final = fit(fine, found.hypothesis, found.point, most=2, known=known, frozen=known is not None)
    return FinalFit(final, corrections, heldout(fine, final), fine)


def _square(gaps: Array) -> float:
    return float(np.mean(gaps**2))


def _cost(search: Search, found: Fit) -> float:
    return search.problem.cost(heldout(search.problem, found))
