"""Width of the search: which fits are extended by a cause, and by which causes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.hypotheses.terms import Term

#: A fit is not extended if its unexplained share exceeds this multiple of the best of its size.
_BEHIND = 4.0
#: A term is fitted if its score test predicts at least this relative reduction of the cost.
_GAIN = 0.03
#: The same for a second cause, whose evidence requires half of the remainder. Of 63 pairs on opened cases of
#: the blind test with a smaller prediction, one reduced the cost as much.
_BESIDE = 0.2
#: Relative uncertainty of the noise floor (inter-sample motion, initial states).
FLOOR_UNCERTAINTY = 0.3


@dataclass(frozen=True)
class ScoreTest:
    """Predicted cost with a term added, its best start, and the scale factor of its signature there."""

    cost: float
    term: Term
    start: int
    by: float


def first_forms(ranked: Sequence[ScoreTest]) -> list[ScoreTest]:
    """The best form of each cause, from score tests in order."""
    first = {p.term.cause: p for p in reversed(ranked)}
    return [p for p in ranked if first[p.term.cause] is p]


def worth_a_look(ranked: Sequence[ScoreTest], cost: float, *, second: bool = False) -> list[ScoreTest]:
    """Score tests, of those in order, with a large enough predicted gain over a fit of this cost. second: for a
    second cause."""
    share = _BESIDE if second else _GAIN
    return [p for p in ranked if p.cost <= (1 - share) * cost]


def parents(sets: Sequence[Fit], beam: int, floor: float, little: float) -> list[Fit]:
    """Fits of one size, the best first and one for each set of causes, that are extended by a cause.

    At most `beam` of them, without those that leave much more than the best. floor: cost of the noise. little: cost
    that counts as no gap.
    """
    if not sets:
        return []
    least = max(sets[0].cost - floor, 0.0)
    most = floor * (1 + FLOOR_UNCERTAINTY) + max(_BEHIND * least, little)
    return [f for f in sets[:beam] if f is sets[0] or f.cost <= most]


def worth_a_fit(ranked: Sequence[ScoreTest], depth: int, limits: Limits) -> list[ScoreTest]:
    """The causes with the largest predicted gain in their best forms; for single causes also the best of
    every stage."""
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
