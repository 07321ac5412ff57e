"""Has a cause changed since the baseline, or does the simulator miss it there too? One law is fitted to both states
together: with the cause in the case's records alone, in all records alike, and in all with another size in the case's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from operator import itemgetter
from typing import cast

import numpy as np
from scipy.special import expit

from mrdamp.diagnosis.constants import EVIDENCE_GAIN, NUMBER, SECOND_CAUSE, TEMPER, TIE_PROBABLE
from mrdamp.diagnosis.evidence.judgement import scored
from mrdamp.diagnosis.evidence.verdict import Decision, by_causes
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.left_out import cells, folds, predicted, ratio
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Hypothesis, Settings, Term
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.problem.rig import Rig, simulated_together
from mrdamp.model.core import Array
from mrdamp.records import Record

#: Mark of the settings that act on the case's records alone; a model's attribute has no blank.
_CHANGE = "changed "
#: Number of sets of causes that are looked at beside no gap.
_LIKELIEST = 3
#: Iterations of each fit.
_STEPS = 8
#: How a cause acts: its terms in a fit to both states.
_Acts = Callable[[Term], tuple[Term, ...]]


@dataclass(frozen=True)
class BothStates:
    """The records of a case, then those of its baseline, as far as residuals need a rig; the latter without what has
    changed."""

    case: Rig
    baseline: Rig

    @property
    def threads(self) -> int:
        """See `Rig`."""
        return self.case.threads

    @property
    def channels(self) -> tuple[str, ...]:
        """See `Rig`."""
        return self.case.channels

    @property
    def records(self) -> tuple[Record, ...]:
        """See `Rig`."""
        return (*self.case.records, *self.baseline.records)

    def measured(self, record: int) -> Array:
        """See `Rig`."""
        rig, own = self._at(record)
        return rig.measured(own)

    def conditions(self, record: int) -> dict[str, Array]:
        """See `Rig`."""
        rig, own = self._at(record)
        return rig.conditions(own)

    def simulate(self, settings: Sequence[Settings], record: int, *, coarse: bool = False) -> Array:
        """See `Rig`."""
        return self.simulate_together(settings, [record], coarse=coarse)[0]

    def simulate_together(
        self, settings: Sequence[Settings], records: Sequence[int], *, coarse: bool = False
    ) -> list[Array]:
        """See `Together`."""
        made: dict[int, Array] = {}
        for rig in (self.case, self.baseline):
            acting = [_acting(s, changed=rig is self.case) for s in settings]
            distinct = list({tuple(s.items()): s for s in acting}.values())
            order = [distinct.index(s) for s in acting]
            own = {record: at for record in records for of, at in [self._at(record)] if of is rig}
            runs = simulated_together(rig, distinct, list(own.values()), coarse=coarse)
            made |= {record: run[order] for record, run in zip(own, runs, strict=True)}
        return [made[record] for record in records]

    def rougher(self, terms: Sequence[Term]) -> None:
        """None: each fit has few steps."""

    def _at(self, record: int) -> tuple[Rig, int]:
        first = len(self.case.records)
        return (self.case, record) if record < first else (self.baseline, record - first)


def _acting(settings: Settings, *, changed: bool) -> Settings:
    """Settings of a state; those of what has changed take the place of what was before."""
    own = {name: value for name, value in settings.items() if not name.startswith(_CHANGE)}
    new = {name.removeprefix(_CHANGE): value for name, value in settings.items() if name.startswith(_CHANGE)}
    return own | new if changed else own


def _changed(term: Term) -> Term:
    """A term that acts on the case's records alone."""
    coordinates = tuple(replace(c, name=_CHANGE + c.name) for c in term.coordinates)
    fixed = {_CHANGE + name: value for name, value in term.fixed.items()}
    return replace(term, coordinates=coordinates, fixed=fixed)


def _new(term: Term) -> tuple[Term, ...]:
    return (_changed(term),)


def _missed(term: Term) -> tuple[Term, ...]:
    return (term,)


def _grown(term: Term) -> tuple[Term, ...]:
    return (term, _changed(term))


def since_baseline(search: Search, baseline: Problem | None, fits: Sequence[Fit], decision: Decision) -> Decision:
    """The decision with the probability of each named cause, or of the likeliest ones beside no gap, times that of a
    change.

    To have changed is held to be rarer than to be missed in both states, by SECOND_CAUSE: on opened measured sets the
    evidence of right changes is above 9 nats in 27 of 29 (others -3, 3), of invented ones below 2 in 4 of 6 (11, 21);
    of nine causes that simulators of unchanged rigs miss, admitted to have grown, at most 1.6.
    """
    if baseline is None:
        return decision
    asked = [decision.chosen.index] if decision.verdict == "effect" else []
    if decision.verdict == "none":
        for causes, p in list(by_causes(scored(fits), decision.probabilities).items())[: 1 + _LIKELIEST]:
            own = [k for k, f in enumerate(fits) if causes and tuple(sorted(f.hypothesis.causes)) == causes]
            asked += [max(own, key=lambda k: decision.probabilities[k])] if own and p > TIE_PROBABLE else []
    changed: dict[str, float] = {}
    for k in asked:
        nats = evidence_of_change(fits[k], search.base.hypothesis.nominal, search.problem, baseline)
        changed = {c: float(expit((n - SECOND_CAUSE) / TEMPER)) for c, n in nats.items()} | changed
    return of_changes(decision, fits, changed) if changed else decision


def of_changes(decision: Decision, fits: Sequence[Fit], changed: Mapping[str, float]) -> Decision:
    """The decision with the probabilities `changed` of causes to be changes: what a set of causes loses goes to the one
    without the cause, or to an unknown cause; where there is no gap, to none."""
    shares, unknown = np.array(decision.probabilities), decision.unknown
    none = decision.verdict == "none"
    for cause, p in changed.items():
        for k in [k for k, f in enumerate(fits) if cause in f.hypothesis.causes]:
            lost, shares[k] = (1 - p) * shares[k], p * shares[k]
            rest = set(fits[k].hypothesis.causes) - {cause}
            alike = [i for i, other in enumerate(fits) if (rest or none) and set(other.hypothesis.causes) == rest]
            if alike:
                shares[max(alike, key=lambda i: shares[i])] += lost
            else:
                unknown += (1 - decision.unknown) * lost
    shares /= max(float(shares.sum()), 1e-300)
    return replace(decision, probabilities=tuple(map(float, shares)), unknown=unknown, changed=changed)


def evidence_of_change(
    found: Fit, nominal: tuple[Coordinate, ...], case: Problem, baseline: Problem
) -> dict[str, float]:
    """Evidence (nats), by cause of a fit, that it has changed over that it is missed in both states.

    All hypotheses have one law with free parameters (`nominal`) and the causes, and are compared by what each predicts
    of left-out records, in the mean over the cells of each state. A cause that has grown costs NUMBER for each of its
    parameters more than one that is new. Beside a cause that is missed the others are judged with it in both states.
    baseline: residuals of the baseline's records.
    """
    problem = Problem(cast(Rig, BothStates(case.rig, baseline.rig)), stride=case.stride, coarse=True)
    first = len(case.rig.records)
    of_case = np.concatenate([np.full(b.span.stop - b.span.start, b.record < first) for b in problem.blocks])
    cell, left, terms = cells(problem), folds(problem), found.hypothesis.terms
    law, own = np.split(found.point, [len(found.hypothesis.nominal)])
    law = law if len(law) else np.zeros(len(nominal))
    points = np.split(own, np.cumsum([len(t.coordinates) for t in terms])[:-1])
    states = [(of, np.unique(cell[of], return_inverse=True)[1]) for of in (of_case, ~of_case)]

    @cache
    def fitted(how: tuple[_Acts, ...]) -> tuple[Fit, Array]:
        """The fit with causes that act so, and its left-out residuals (samples,)."""
        parts = [(made, q) for t, q, acts in zip(terms, points, how, strict=True) for made in acts(t)]
        start = np.concatenate([law, *(q for _, q in parts)])
        made = fit(problem, Hypothesis(nominal, tuple(t for t, _ in parts)), start, most=_STEPS)
        return made, predicted(problem, made, left)

    def evidence(place: int, how: tuple[_Acts, ...]) -> tuple[float, _Acts]:
        """Nats of a cause, the others acting so, and how it acts by these."""
        tried = [fitted((*how[:place], acts, *how[place + 1 :])) for acts in (_new, _grown, _missed)]
        least = min((f for f, _ in tried), key=lambda f: f.cost).residual
        *changed, missed = (residual for _, residual in tried)
        nats = [
            -EVIDENCE_GAIN * sum(np.log(ratio(one[of], missed[of], numbers, least[of])) for of, numbers in states)
            for one in changed
        ]
        best, acts = max((nats[0], _new), (nats[1] - NUMBER * len(terms[place].coordinates), _grown), key=itemgetter(0))
        return float(best), acts if best > SECOND_CAUSE else _missed

    how: tuple[_Acts, ...] = (_new,) * len(terms)
    how = tuple(evidence(place, how)[1] for place in range(len(terms)))
    return {t.cause: evidence(place, how)[0] for place, t in enumerate(terms)}
