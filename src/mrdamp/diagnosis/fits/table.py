"""The table of fits of one problem: the best fit of each set of terms, and how further fits are made."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from mrdamp.diagnosis.constants import EVIDENCE_GAIN, INEXACT, NUMBER, STALL_GAIN
from mrdamp.diagnosis.fits.beam import FLOOR_UNCERTAINTY, ScoreTest
from mrdamp.diagnosis.fits.least_squares import ROUGHLY, TOLERANCE, Fit, fit
from mrdamp.diagnosis.fits.left_out import (
    Curves,
    Mask,
    Numbers,
    beside_curves,
    cells,
    curves,
    folds,
    predicted,
    ratio,
)
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.stall import Stalls
from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Term
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array

#: A gap counts as explained below this unexplained share.
SOLVED = 0.001
#: Causes with fixed nominal parameters below this unexplained share are right or nearly so: only their
#: parameters and forms are then varied.
NEARLY = 0.02
#: Iterations of a fit that is to come to its end.
THROUGH = 15


def acts_while_it_changes(term: Term) -> bool:
    """True for a cause that acts only while the command changes."""
    return term.stage == "driver" or term.effect == "remanence"


@dataclass
class Cache:
    """Fits and screenings with fixed or free nominal parameters; none is repeated.

    fits: by name and start. screens: by fit, its point and the terms. signatures: a term's change of the
    nominal simulator's residuals (samples,), by its name and start.
    """

    fits: dict[tuple[str, bytes], Fit] = field(default_factory=dict)
    screens: dict[tuple[str, bytes, tuple[str, ...]], list[ScoreTest]] = field(default_factory=dict)
    signatures: dict[tuple[str, int], Array] = field(default_factory=dict)

    def with_fixed_law(self) -> Cache:
        """Only entries with fixed nominal parameters: they do not depend on the range of free ones."""
        return Cache(
            {k: f for k, f in self.fits.items() if not f.hypothesis.nominal},
            {k: p for k, p in self.screens.items() if k[0].startswith("held")},
            self.signatures,
        )


@dataclass
class FitTable:
    """Fits of hypotheses to one problem: the best of each set of terms, with fixed and with free nominal
    parameters.

    floor: cost of the noise. own: cost of the nominal simulator on the rig's baseline, 0 without one. failed: notes on
    fits that could not be made. cache: completed fits and screenings.
    """

    problem: Problem
    floor: float
    limits: Limits = field(default_factory=Limits)
    fits: dict[tuple[bool, frozenset[str]], Fit] = field(default_factory=dict)
    own: float = 0.0
    failed: list[str] = field(default_factory=list)
    cache: Cache = field(default_factory=Cache)
    _fine_costs: dict[tuple[str, bytes], float] = field(default_factory=dict)
    _predicted: dict[tuple[str, bytes], Array] = field(default_factory=dict)
    _best: tuple[Fit | None, Array] = (None, np.zeros(0))

    def __post_init__(self) -> None:
        rig = self.problem.rig
        self.residual = self.problem.residuals(Hypothesis(()), np.zeros(0))[0]
        self.nominal_cost = float(self.residual @ self.residual)
        held = Hypothesis(())
        self.keep(
            Fit(held, np.zeros(0), self.nominal_cost, self.residual, np.zeros((self.problem.samples, 0)))
        )
        free = Hypothesis(rig.nominal)
        self.keep(fit(self.problem, free, np.zeros(len(rig.nominal)), most=self.limits.base))

    @property
    def excess(self) -> float:
        """Cost of the nominal simulator beyond the noise."""
        return max(self.nominal_cost - self.floor, 1e-3 * self.floor, 1e-12)

    @property
    def base(self) -> Fit:
        """The fit of the nominal parameters alone."""
        return self.fits[True, frozenset()]

    @property
    def inexact(self) -> bool:
        """True if no fit so far reaches the noise: the law is not the rig's, or the cause is not in the
        catalogue."""
        return min(f.cost for f in self.fits.values()) > INEXACT * self.floor

    def unexplained(self, found: Fit) -> float:
        """Share of the excess that a fit leaves."""
        return max(found.cost - self.floor, 0.0) / self.excess

    @cached_property
    def cells(self) -> Numbers:
        """Number of the cell (samples,) of each residual."""
        return cells(self.problem)

    @cached_property
    def stalls(self) -> Stalls:
        """Measured travels at small force after a turn."""
        return Stalls.of(self.problem)

    @cached_property
    def folds(self) -> list[Mask]:
        """What is left out in turn."""
        return folds(self.problem)

    @cached_property
    def curves(self) -> Curves:
        """See `left_out.curves`; none if baseline records determine the law."""
        return Curves.none(self.problem.samples) if self.own else curves(self.problem, self.base)

    @cached_property
    def law_alone(self) -> Array:
        """Left-out residuals (samples,) of the nominal parameters alone. A free law may not have come to its end: a
        step of all parameters on each fold counts where it predicts better."""
        own = self.predicted(self.base)
        if not self.curves.prior.size:
            return own
        further = beside_curves(self.base, self.base, Curves.none(self.problem.samples), self.folds)
        return min((own, further), key=lambda r: self.ratio(r, self.residual))

    def predicted(self, found: Fit) -> Array:
        """Residuals (samples,) of a fit on folds that it was not fitted to."""
        key = (found.name, found.point.tobytes())
        if key not in self._predicted:
            self._predicted[key] = predicted(self.problem, found, self.folds)
        return self._predicted[key]

    def versions(self, found: Fit, *, fitted: bool = False) -> list[tuple[Array, bool]]:
        """Residuals (samples,) of a fit on folds that it was not fitted to (`fitted`: as fitted), and those with
        nominal parameters that are curves of the command (True)."""
        own = found.residual if fitted else self.predicted(found)
        if not self.curves.prior.size:
            return [(own, False)]
        folds = () if fitted else self.folds
        return [(own, False), (beside_curves(found, self.base, self.curves, folds), True)]

    def remains(self, found: Fit, before: Fit) -> float:
        """What a fit leaves of the left-out squares of another, each in the version that predicts better."""
        price = (1.0, self.price)  # without and with curves
        reference, curved = min(self.versions(before), key=lambda v: self.ratio(v[0], self.residual) * price[v[1]])
        return min(self.ratio(r, reference) * price[c] for r, c in self.versions(found)) / price[curved]

    @property
    def price(self) -> float:
        """Factor on what is left with curves of the command: their parameters cost NUMBER each, as those of a cause. Of
        42 opened cases without a baseline eight have another answer without it: six name a wrong cause, two miss one.
        Without curves, on a draw of another law, 7 of 11 causes are named for 9 and a remanence is invented twice.
        """
        return math.exp(NUMBER * len(self.curves.prior) / EVIDENCE_GAIN)

    @property
    def curved(self) -> float:
        """What curves of the command leave of the left-out squares of the law alone."""
        return self.ratio(self.versions(self.base)[-1][0], self.law_alone)

    def by_curves(self, hypothesis: Hypothesis) -> float:
        """Share of the left-out squares beyond the noise that curves of the command in place of the law's coefficients
        take off; 0 for a hypothesis that was not fitted here."""
        found = self.fits.get(hypothesis.key)
        if found is None:
            return 0.0
        own, *curved = (float(r @ r) for r, _ in self.versions(found))
        return max((own - c) / max(own - self.floor, 1e-300) for c in [own, *curved])

    def ratio(self, residual: Array, reference: Array) -> float:
        """Share of the squares of a reference (samples,) that a residual (samples,) leaves in the cells
        (`left_out.ratio`), and of those of its travels after a turn (`fits.stall`)."""
        best = min(self.fits.values(), key=lambda f: f.cost)
        if best is not self._best[0]:
            self._best = best, self.versions(best, fitted=True)[-1][0]
        left = ratio(residual, reference, self.cells, self._best[1])
        return float(left * self.stalls.left(residual, reference) ** (STALL_GAIN / EVIDENCE_GAIN))

    def left_out_cost(self, found: Fit) -> float:
        """Sum of squares of a fit on folds that it was not fitted to."""
        residual = self.predicted(found)
        return float(residual @ residual)

    def addable(self, taken: Collection[str]) -> list[Term]:
        """Terms of the catalogue that may be added to the causes `taken`; not what acts only while the command changes,
        if it hardly does."""
        rig = self.problem.rig
        terms = [t for t in rig.terms if t.cause not in taken and not t.later]
        return [t for t in terms if not acts_while_it_changes(t)] if rig.still else terms

    def start_from(self, found: Fit, term: Term, k: int, by: float = 1.0) -> tuple[Hypothesis, Array]:
        """Hypothesis and starting point for a fit with a term added at one of its starts; linear coordinates
        are scaled by `by`."""
        q = [
            c.point(v if c.log else c.start + by * (v - c.start))
            for c, v in zip(term.coordinates, term.starts[k], strict=True)
        ]
        return found.hypothesis.plus(term), np.concatenate([found.point, q])

    def solved(self, found: Fit) -> bool:
        """True if no material part of the gap is left for another cause.

        The coarse step of a search is inaccurate for a piston between a mount and a damper: a near fit is
        checked with the full step.
        """
        if self._little(found.cost):
            return True
        mounted = any(t.stage == "mount" for t in found.hypothesis.terms)
        if not (mounted and self.problem.coarse and self.unexplained(found) < NEARLY):
            return False
        key = (found.name, found.point.tobytes())
        if key not in self._fine_costs:
            r = self.problem.like(coarse=False).residuals(found.hypothesis, found.point)[0]
            self._fine_costs[key] = float(r @ r)
        return self._little(self._fine_costs[key])

    def _little(self, cost: float) -> bool:
        return cost - self.floor < SOLVED * self.excess + FLOOR_UNCERTAINTY * self.floor

    @staticmethod
    def law_columns(found: Fit) -> Array | None:
        """Columns of a fit's Jacobian for the nominal parameters; None if they are fixed."""
        count = len(found.hypothesis.nominal)
        return found.jacobian[:, :count] if count else None

    def tried(self, hypothesis: Hypothesis, start: Array, known: Array | None, bar: float) -> Fit | None:
        """A fit to the accuracy needed for a comparison of causes; None, with a note, if it fails. Arguments
        as in `fitted`."""
        try:
            most = 8 if hypothesis.nominal else 15  # the evidence depends on the logarithm of the cost
            return self.fitted(hypothesis, start, most=most, known=known, bar=bar, tolerance=ROUGHLY)
        except (np.linalg.LinAlgError, ValueError) as error:
            self.failed.append(f"{hypothesis.name}: the fit failed ({error})")
            return None

    def fitted(
        self,
        hypothesis: Hypothesis,
        start: Array,
        *,
        most: int,
        known: Array | None = None,
        stage: str = "",
        bar: float = np.inf,
        tolerance: float = TOLERANCE,
    ) -> Fit:
        """A fit from a start; none is made twice.

        known: constant columns of the Jacobian (of the nominal parameters, from the parent's fit). bar: the
        parent's cost, which has to be undercut. tolerance: see `fit`.
        """
        name = f"{'free' if hypothesis.nominal else 'held'} {hypothesis.name}{stage}"
        key = name, start.tobytes()
        if key in self.cache.fits:
            return self.cache.fits[key]
        if known is None and hypothesis.nominal:
            # Computed once at the start: the signatures of a dozen nominal parameters change little during
            # the fit.
            rough, law = self.problem.rougher(hypothesis), range(len(hypothesis.nominal))
            known = rough.jacobian(hypothesis, start, rough.residuals(hypothesis, start)[0], law)
        how: dict[str, Any] = {"known": known, "frozen": known is not None, "bar": bar}
        self.cache.fits[key] = fit(self.problem, hypothesis, start, most=most, tolerance=tolerance, **how)
        return self.cache.fits[key]

    def went(self, hypothesis: Hypothesis, start: Array, steps: int) -> bool:
        """True if a fit with fixed nominal parameters from this start has already used this many iterations.
        """
        found = self.cache.fits.get((f"held {hypothesis.name}", start.tobytes()))
        return not hypothesis.nominal and found is not None and found.iterations >= steps

    def keep(self, found: Fit) -> None:
        """Adds a fit to the table if it is the best of its terms."""
        key = found.hypothesis.key
        if key not in self.fits or found.cost < self.fits[key].cost:
            self.fits[key] = found

    def keep_fitted(self, tasks: Iterable[tuple[Hypothesis, Array]], **how: Any) -> None:
        """Fits hypotheses from their points and keeps the results. how: as in `fitted`."""
        for found in self.map(lambda h, q: self.fitted(h, q, **how), tasks):
            self.keep(found)

    def tried_all(self, tasks: Iterable[tuple[Hypothesis, Array, Array | None, float]]) -> list[Fit]:
        """Fits as in `tried`, without those that fail."""
        return [f for f in self.map(self.tried, tasks) if f is not None]

    def ranked(self, free: bool) -> list[Fit]:
        """Fits with free or fixed nominal parameters, by cost."""
        return sorted(
            (f for (is_free, _), f in self.fits.items() if is_free == free),
            key=lambda f: (f.cost, f.hypothesis.name),
        )

    def sets(self, free: bool, count: int, by: Callable[[Fit], float] | None = None) -> list[Fit]:
        """The best fit of each set of `count` causes, by cost or `by` another figure."""
        ranked = [f for f in self.ranked(free) if len(f.hypothesis.causes) == count]
        first: dict[frozenset[str], Fit] = {}
        for f in sorted(ranked, key=by) if by else ranked:
            first.setdefault(frozenset(f.hypothesis.causes), f)
        return list(first.values())

    def smallest(self, free: bool, causes: Iterable[str]) -> Fit | None:
        """The best fit of exactly these causes."""
        wanted = set(causes)
        return next((f for f in self.ranked(free) if set(f.hypothesis.causes) == wanted), None)

    def best(self, free: bool, causes: int | None = None) -> Fit | None:
        """The best fit with free or fixed nominal parameters, and with `causes` causes if given."""
        return next(
            (f for f in self.ranked(free) if causes is None or len(f.hypothesis.causes) == causes), None
        )

    @property
    def least(self) -> Fit:
        """The fit with the least cost."""
        return min(self.fits.values(), key=lambda f: (f.cost, f.hypothesis.name))

    def with_free_law(self, found: Fit) -> tuple[Hypothesis, Array]:
        """Hypothesis and starting point for the causes of a fit with fixed nominal parameters, beside free ones."""
        hypothesis = Hypothesis(self.base.hypothesis.nominal, found.hypothesis.terms)
        return hypothesis, np.concatenate([np.zeros(len(hypothesis.nominal)), found.point])

    def map(self, function: Callable[..., Any], tasks: Iterable[tuple[Any, ...]]) -> list[Any]:
        """Results of a function for each tuple of arguments, in parallel threads."""
        tasks, threads = list(tasks), self.problem.rig.threads
        if threads == 1 or len(tasks) < 2:
            return [function(*task) for task in tasks]
        # The work is done in the C entry, which releases the interpreter's lock.
        return list(Parallel(n_jobs=threads, prefer="threads")(delayed(function)(*task) for task in tasks))
