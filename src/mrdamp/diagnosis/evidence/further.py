"""Further causes beside one that is established: each against the fit before.

Pairs that explain nearly everything are found by the search. Beside a wrong law a second cause leaves much, and the fit
with the first cause is what it has to improve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from mrdamp.diagnosis.constants import CAUSE, LAW, MATERIAL, SECOND_CAUSE
from mrdamp.diagnosis.evidence.established import softmax, standing, utility
from mrdamp.diagnosis.evidence.judgement import scored
from mrdamp.diagnosis.evidence.penalties import gone, of_itself, of_law, unreferenced
from mrdamp.diagnosis.evidence.verdict import Decision
from mrdamp.diagnosis.fits.final import in_file, least_left_out
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Search

#: Largest number of causes.
_MOST = 3


def with_further(search: Search, fits: Sequence[Fit], decision: Decision) -> tuple[list[Fit], Decision]:
    """The fits and the decision with further causes that are established beside the named ones."""
    fits, decision = _freed(search, fits, decision)
    while decision.verdict == "effect" and len(decision.chosen.causes) < _MOST:
        parent = fits[decision.chosen.index]
        found = None if search.solved(parent) else _further(search, parent)
        if found is None:
            break
        fit, probability = found
        if gone(fit) and not gone(parent):  # it only led the causes before it to a better point
            fit, probability = search.without_last(fit), 0.0
            if not fit.cost < parent.cost:
                break
        # What was true of the set before is shared with the larger one.
        with_parent = [set(decision.chosen.causes) <= set(f.hypothesis.causes) for f in fits]
        mass = sum(p for p, own in zip(decision.probabilities, with_parent, strict=True) if own)
        shares = [
            p * (1 - probability * own) for p, own in zip(decision.probabilities, with_parent, strict=True)
        ]
        fits.append(fit)
        search.keep(fit)
        chosen = replace(scored([fit])[0], index=len(fits) - 1)
        left = max(fit.cost - decision.floor, 0.0) / decision.excess
        decision = replace(
            decision, chosen=chosen, probabilities=(*shares, mass * probability), unexplained=left
        )
    return fits, decision


def with_unnamed(search: Search, found: Fit) -> Fit:
    """A fit with one more effect that takes MATERIAL off its left-out squares, in the cells and in all; else as it is.

    Such an effect is handed over and not named: curves of the command in place of the law's coefficients, which a model
    file does not have, may explain as much.
    """
    if search.solved(found):
        return found
    tried = [f for f in search.beside(found) if in_file(search.problem.rig, f)]
    best = min(tried, key=search.left_out_cost, default=found)
    in_cells = search.ratio(search.predicted(best), search.predicted(found))
    in_all = search.left_out_cost(best) / search.left_out_cost(found)
    return best if max(in_cells, in_all) <= 1 - MATERIAL else found


def _freed(search: Search, fits: Sequence[Fit], decision: Decision) -> tuple[list[Fit], Decision]:
    """The fits with the named causes beside free nominal parameters, which no baseline determines, and the decision for
    these where they predict better. A search frees only the sets with the least costs."""
    found = fits[decision.chosen.index]
    causes = found.hypothesis.causes
    if decision.verdict != "effect" or search.own or search.solved(found) or search.smallest(True, causes):
        return list(fits), decision
    free = search.fitted(*search.with_free_law(found), most=8, stage=" freed")
    search.keep(free)
    decision = replace(decision, probabilities=(*decision.probabilities, 0.0))
    if least_left_out(search, found) is free:
        left = max(free.cost - decision.floor, 0.0) / decision.excess
        decision = replace(decision, chosen=replace(scored([free])[0], index=len(fits)), unexplained=left)
    return [*fits, free], decision


def _further(search: Search, parent: Fit) -> tuple[Fit, float] | None:
    """The best fit with the cause that is established beside those of a fit, and its probability; None without one."""
    tried = [f for f in search.beside(parent) if not (f.hypothesis.nominal and unreferenced(search.problem.rig, f))]
    numbers = len(parent.point)
    worth = []
    for f in tried:
        left, more = search.remains(f, parent), len(f.point) - numbers
        direct = search.direct.get(f.hypothesis.causes[-1], 0.0)
        unsure = search.inexact and not search.own
        penalty = of_itself(f, beside=len(parent.hypothesis.terms))
        penalty += of_law(search.problem.rig, f.hypothesis.causes[-1:]) if unsure else 0.0
        worth.append(utility(left, 1, more, penalty=penalty) - SECOND_CAUSE + direct)
    freed = None if parent.hypothesis.nominal else search.smallest(True, parent.hypothesis.causes)
    names: list[tuple[str, ...]] = [(f.hypothesis.causes[-1],) for f in tried]
    if freed is not None:
        names.append(("parameters",))
        worth.append(utility(search.remains(freed, parent), 0, 0, penalty=LAW if search.own else CAUSE))
    sets: dict[tuple[str, ...], float] = {}
    for name, p in zip([(), *names], softmax([0.0, *worth]), strict=True):
        sets[name] = sets.get(name, 0.0) + float(p)
    found = standing(sets)
    if found is None or not found.probability > 0.5:
        return None
    own = [k for k, f in enumerate(tried) if f.hypothesis.causes[-1] == found.causes[0]]
    return tried[max(own, key=lambda k: worth[k])], found.probability
