"""Other forms of the causes that were found in their place, and other causes in place of the weaker one."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from mrdamp.diagnosis.fits.beam import first_forms
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.screening import screen
from mrdamp.diagnosis.fits.table import FitTable
from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Term

#: A set of causes comes near another where it leaves less than so many times as much.
_RIVALS = 2.0
#: Steps of a fit that takes another form, which is given up where it leaves so many times as much after a few of them:
#: of 96 on opened cases of the blind test those that won left 1.1 times as much by then at most, and of the others none
#: that left more than twice as much came below 1.5.
_STEPS, _HOPELESS = 8, 2.0


def reform(table: FitTable, found: Fit, causes: Collection[str] | None = None) -> None:
    """Other forms of each cause of a fit in its place, those with the largest predicted gain; of those given alone."""
    tasks = []
    for term in found.hypothesis.terms:
        if causes is not None and term.cause not in causes:
            continue
        others = [t for t in table.problem.rig.terms if t.cause == term.cause and t.name != term.name]
        if not others:
            continue
        parent = lacking(table, found, term)
        for test in screen(table, parent, others)[: table.limits.reformed]:
            task = table.start_from(parent, test.term, test.start, test.by)
            if not table.went(*task, _STEPS):
                tasks.append(task)
    # Of a cause in another form the law's signatures are nearly the same.
    known = table.law_columns(found)
    bar = _HOPELESS * found.cost
    for again in table.map(
        lambda h, q: table.fitted(h, q, most=_STEPS, known=known, stage=" reformed", bar=bar), tasks
    ):
        table.keep(again)


def reform_rival(table: FitTable, best: Fit) -> None:
    """Other forms of the one cause in which the next best set of causes differs from the best, where it comes near:
    between two causes the right form decides."""
    causes = set(best.hypothesis.causes)
    for f in table.ranked(bool(best.hypothesis.nominal)):
        own = set(f.hypothesis.causes)
        if len(own) != len(causes) or len(own - causes) != 1:
            continue
        if table.unexplained(f) < _RIVALS * table.unexplained(best):
            reform(table, f, own - causes)
        return


def drop(table: FitTable, found: Fit) -> None:
    """A set without one of its causes, for each of them, from where it stands: a form that was found in the set may do
    without the other cause."""
    if len(found.hypothesis.causes) < 2:
        return
    tasks = []
    for term in found.hypothesis.terms:
        rest = lacking(table, found, term)
        if (
            bool(rest.hypothesis.nominal),
            frozenset(t.name for t in rest.hypothesis.terms),
        ) not in table.fits:
            tasks.append((rest.hypothesis, rest.point))
    for again in table.map(lambda h, q: table.fitted(h, q, most=8, stage=" dropped"), tasks):
        table.keep(again)


def lacking(table: FitTable, found: Fit, term: Term) -> Fit:
    """A fit without one of its terms, the other numbers where they stand."""
    hypothesis = found.hypothesis
    at, kept = len(hypothesis.nominal), np.ones(len(found.point), dtype=bool)
    for t in hypothesis.terms:
        if t is term:
            kept[at : at + len(t.coordinates)] = False
        at += len(t.coordinates)
    rest = Hypothesis(hypothesis.nominal, tuple(t for t in hypothesis.terms if t is not term))
    residual = table.problem.residuals(rest, found.point[kept])[0]
    cost = float(residual @ residual)
    return Fit(rest, found.point[kept], cost, residual, found.jacobian[:, kept])


def exchange(table: FitTable) -> None:
    """Other causes in place of the weaker one of the best pair, from where the pair's fit stands: what was added
    on top of a law that was held, or of the other cause in another form, may have mended those."""
    pairs = [f for free in (False, True) for f in table.ranked(free)[:1] if len(f.hypothesis.terms) > 1]
    if not pairs or not table.limits.exchanged or any(table.solved(f) for f in table.ranked(True)[:1]):
        return
    best = min(pairs, key=lambda f: (f.cost, f.hypothesis.name))
    parents = [lacking(table, best, term) for term in best.hypothesis.terms]
    parent = min(parents, key=lambda f: (f.cost, f.hypothesis.name))
    ranked = screen(table, parent, table.beside(best.hypothesis.causes))
    chosen = first_forms(ranked)[: table.limits.exchanged]
    tasks = [table.start_from(parent, p.term, p.start, p.by) for p in chosen]
    for again in table.map(lambda h, q: table.fitted(h, q, most=8, stage=" exchanged"), tasks):
        table.keep(again)
