"""The predicted gain of each term of the catalogue on top of a fit, by the change that it makes to a run.

A change on top of another cause is nearly the one that the term makes to the nominal simulator, which is known from
the first screening: it predicts which terms are worth a run of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mrdamp.diagnosis.fits.beam import ScoreTest
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.table import FitTable
from mrdamp.diagnosis.hypotheses.terms import Term
from mrdamp.model.core import Array

#: A signature is stretched by no more than this when it is screened.
_STRETCH = 4.0
#: So many of the terms with the largest predicted gain get runs of their own, the others stand with the prediction.
#: Of 70 screenings on opened cases of the blind test the best term was among the first two in all but one.
_LOOKED_AT = 16
#: Nothing is predicted where free numbers have moved by more than this (RMS share): the simulator is another one then.
_MOVED = 0.4


def screen(table: FitTable, found: Fit, terms: Sequence[Term]) -> list[ScoreTest]:
    """Score test of each term on top of a fit, best first.

    A score test with a signature of finite size: the change that the term makes at a start, less what the free
    coordinates can make themselves, stretched to the residual (backwards too, where the term has two signs).
    """
    key = (found.name, found.point.tobytes(), tuple(t.name for t in terms))
    if key not in table.cache.screens:
        table.cache.screens[key] = _screened(table, found, terms)
    return table.cache.screens[key]


def _screened(table: FitTable, found: Fit, terms: Sequence[Term]) -> list[ScoreTest]:
    left = _Left(found)
    known = table.cache.signatures
    nominal = not found.hypothesis.nominal and not found.hypothesis.terms
    predicted: dict[str, ScoreTest] = {}
    if not nominal and found.move <= _MOVED:
        for term in terms:
            if all((term.name, k) in known for k in range(len(term.starts))):
                predicted[term.name] = left.score_test(
                    term, [known[term.name, k] for k in range(len(term.starts))]
                )
    order = sorted(predicted.values(), key=lambda p: (p.cost, p.term.name))
    passed = {p.term.name for p in order[_LOOKED_AT:]}
    asked = [
        (term, k)
        for term in terms
        if term.name not in passed
        for k in range(len(term.starts))
        if not (nominal and (term.name, k) in known)
    ]
    rough = table.problem.rougher(found.hypothesis)
    before = found.residual
    if rough is not table.problem and asked:
        before = rough.residuals(found.hypothesis, found.point)[0]

    def change(term: Term, k: int) -> Array:
        hypothesis, point = table.start_from(found, term, k)
        return np.asarray(rough.residuals(hypothesis, point)[0] - before)

    changes = {(term.name, k): d for (term, k), d in zip(asked, table.map(change, asked), strict=True)}
    if nominal:
        known.update(changes)
        changes = known
    tests = [
        predicted[term.name]
        if term.name in passed
        else left.score_test(term, [changes[term.name, k] for k in range(len(term.starts))])
        for term in terms
    ]
    return sorted(tests, key=lambda p: (p.cost, p.term.name))


class _Left:
    """What a fit leaves, less what its own free coordinates can make."""

    def __init__(self, found: Fit) -> None:
        self.cost = found.cost
        self.basis = np.linalg.qr(found.jacobian)[0] if found.jacobian.shape[1] else found.jacobian
        self.residual = self._own(found.residual)

    def _own(self, change: Array) -> Array:
        return np.asarray(change - self.basis @ (self.basis.T @ change))

    def score_test(self, term: Term, changes: Sequence[Array]) -> ScoreTest:
        """Of a term with the change that it makes from each of its starts, from the best of those."""
        best: ScoreTest | None = None
        nearest = (np.inf, 0)
        for k, d in enumerate(changes):
            own = self._own(d)
            size, along = float(own @ own), float(own @ self.residual)
            cost, by = self.cost, 0.0
            if size > 1e-6 * float(d @ d):
                by = min(max(-along / size, -_STRETCH if term.two_sided else 0.0), _STRETCH)
                cost += by * (2 * along + by * size)
            if best is None or cost < best.cost:
                best = ScoreTest(cost, term, k, by)
            nearest = min(nearest, (2 * along + size, k))
        assert best is not None
        # Nothing of a start whose numbers go by their logarithm can be stretched: the one that comes nearest.
        return replace(best, start=nearest[1]) if all(c.log for c in term.coordinates) else best
