"""Search for the causes of a gap: score tests, fits of terms with a predicted gain, forward steps, removal, a
beam.

Every set of causes is fitted twice: with fixed nominal parameters and with free ones. The fixed fit is
simpler by the number of nominal parameters. If these are right, it separates causes that free parameters
would blur. If they are wrong, only the free fit is valid.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from mrdamp.diagnosis.constants import EVIDENCE_GAIN
from mrdamp.diagnosis.fits.alternative_forms import reform
from mrdamp.diagnosis.fits.beam import first_forms, parents, worth_a_fit, worth_a_look
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.limits import BESIDE, FREE, NARROW, Limits
from mrdamp.diagnosis.fits.sampled_delay import try_sampled_delay
from mrdamp.diagnosis.fits.screening import screen
from mrdamp.diagnosis.fits.table import NEARLY, SOLVED, FitTable
from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Term
from mrdamp.model.core import Array

Progress = Callable[[str, float], None]

#: Free parameters alone may imitate a cause. If they explain most of a gap but leave this share of the noise
#: floor as excess, causes are tried in addition.
_LAW_UNCERTAINTY, _STANDS_IN = 0.1, 0.3
#: Largest number of repetitions of a fit with free parameters; least relative reduction for another
#: repetition.
_POLISHED, _GAINS = 4, 0.3
#: For a worse parent, a term is skipped if its predicted cost exceeds this multiple of the cost found with a
#: better parent.
_HOPELESS = 10.0
#: A pair above this share of the best single cause's cost is not continued: a second cause has to pay for itself.
_PAYS = 0.6
#: Share of the excess below which a fit may become exact with another cause or form.
_NEARS = 0.15
#: Number of sets of causes that are tried in other forms: the right form decides between two that are close.
_REFORMED = 2


@dataclass
class Search(FitTable):
    """A table of fits and the strategy that fills it.

    rivals: fits of causes outside the catalogue; looks_like: the rival that decided the verdict. steady:
    False if two runs of one test differ by more than their noise. direct: nats, by cause, from channels that
    measure the same quantity, and from loops. missed: the simulator was identified on these records.
    """

    rivals: list[Fit] = field(default_factory=list)
    looks_like: Fit | None = None
    steady: bool = True
    direct: Mapping[str, float] = field(default_factory=dict)
    missed: bool = False
    _rivals_fitted: bool = False

    @property
    def reference(self) -> Array:
        """Residuals (samples,) that a correction has to improve on with left-out ones: of the nominal simulator, or, if
        that is a fit to these very records, left-out ones of its law fitted again where these are larger."""
        known = (self.residual, self.law_alone) if self.missed else (self.residual,)
        return max(known, key=lambda r: self.ratio(r, self.residual))

    def begin_with(self, terms: Sequence[Term]) -> None:
        """Fits terms from their first starts, with fixed and with free nominal parameters, and keeps both."""
        tasks = []
        for parent in (self.fits[False, frozenset()], self.base):
            hypothesis = Hypothesis(parent.hypothesis.nominal, tuple(terms))
            start = np.concatenate([parent.point, hypothesis.start()[len(parent.point) :]])
            tasks.append((hypothesis, start, self.law_columns(parent), np.inf))
        self.keep_tried(tasks)

    def keep_tried(self, tasks: Sequence[tuple[Hypothesis, Array, Array | None, float]]) -> list[Fit]:
        """Fits as in `tried_all`, which are kept."""
        found = self.tried_all(tasks)
        for one in found:
            self.keep(one)
        return found

    def run(self, progress: Progress = lambda what, share: None) -> None:
        """Single causes, then pairs, with fixed nominal parameters; then both with free ones. Ends as soon as
        the gap is explained."""
        for number, (free, depth) in enumerate(product((False, True), range(1, self.limits.depth + 1))):
            if self.solved(self.base) and (free or depth > 1):
                if (1 + _LAW_UNCERTAINTY) * self.floor < self.base.cost < _STANDS_IN * self.nominal_cost:
                    self.extend(True, 1)
                break
            if free and depth > 1 and self.inexact and not self.pair_pays(False):
                break
            second = self.best(True, 1)
            if free and depth > 1 and second is not None and self.solved(second):
                break
            before = self.best(False)
            if before is not None and (self.solved(before) or (free and self.unexplained(before) < NEARLY)):
                break
            if depth > 1 and not free and self.explained_outside():
                self.free_best()
                return
            count = ("one cause", "two causes", "three causes")[depth - 1]
            law = "free" if free else "held"
            progress(f"{count}, nominal parameters {law}", number / (2 * self.limits.depth))
            if self.inexact and (free or depth > 1):
                self.extend(free, depth, FREE if depth == 1 else NARROW)
            if not self.inexact or not (free or depth > 1) or self.nears_noise():
                self.extend(free, depth)
            single = self.best(free, 1)
            if depth == 1 and single is not None and not self.solved(single):
                reform(self, single)
        self.free_best()
        for free in (False, True):
            for found in self.sets(free, 2 if self.pair_pays(free) else 1)[:_REFORMED]:
                if not self.solved(found):
                    reform(self, found)
        if not any(self.solved(f) for free in (False, True) for f in self.ranked(free)[:1]):
            self.outside()

    def without_last(self, found: Fit) -> Fit:
        """The fit without its last cause, from where it is."""
        hypothesis = Hypothesis(found.hypothesis.nominal, found.hypothesis.terms[:-1])
        return self.fitted(hypothesis, found.point[: len(hypothesis.start())], most=_POLISHED, stage=" without")

    def nears_noise(self) -> bool:
        """True if a fit is so near the noise that the law may be the rig's and a wider search pays. A wrong
        law is bent by any cause."""
        return min(self.unexplained(f) for f in self.fits.values()) < _NEARS

    def pair_pays(self, free: bool) -> bool:
        """True if the best pair of causes reduces the cost of the best single one enough to outweigh its
        penalty in the right form, and explains most of the gap if no fit reaches the noise."""
        single, pair = self.best(free, 1), self.best(free, 2)
        if single is None or pair is None:
            return False
        if self.inexact and self.unexplained(pair) > 2 * NEARLY:
            return False
        return pair.cost - self.floor < _PAYS * (single.cost - self.floor)

    def free_best(self) -> None:
        """Fits the best sets of each size with free nominal parameters, starting from the fixed ones.

        With slightly wrong nominal parameters, a set that explains most is not found from a law that was
        fitted without it. If one cause with free parameters leaves nothing, only the best single causes are
        fitted: others may leave nothing either.
        """
        if any(self.solved(f) for f in self.ranked(False)[:1]):
            return
        tasks = []
        alone = any(self.solved(f) for f in self.ranked(True)[:1])
        most = 1 if alone or not self.pair_pays(False) else self.limits.depth
        for depth in range(1, most + 1):
            tasks += [self.with_free_law(f) for f in self.sets(False, depth)[: self.limits.freed]]
        self.keep_fitted(tasks, most=8, stage=" freed")

    def explained_outside(self) -> bool:
        """True if a cause outside the catalogue explains the gap and no single one in it comes near: pairs
        would only add parameters."""
        if min(self.unexplained(f) for f in self.fits.values()) < NEARLY:
            return False
        self.outside()
        return any(self.solved(f) for f in self.rivals)

    def outside(self) -> None:
        """Fits causes outside the catalogue, those with the largest predicted gain and the best one in all its forms,
        with fixed and free nominal parameters; only once."""
        if self._rivals_fitted:
            return
        self._rivals_fitted = True
        fixed_law = self.fits[False, frozenset()]
        ranked = worth_a_look(screen(self, fixed_law, self.problem.rig.rivals), fixed_law.cost)
        chosen = first_forms(ranked)[: self.limits.rivals]
        tasks = [(*self.start_from(fixed_law, p.term, p.start, p.by), None, np.inf) for p in chosen]
        self.rivals = self._by_cost(self.tried_all(tasks))
        if self.rivals and not self.solved(self.rivals[0]):
            (best,) = self.rivals[0].hypothesis.terms
            others = [t for t in self.problem.rig.rivals if t.cause == best.cause and t.name != best.name]
            tasks = [(*self.start_from(fixed_law, t, 0), None, np.inf) for t in others]
            self.rivals = self._by_cost([*self.rivals, *self.tried_all(tasks)])
        tasks = [(*self.with_free_law(f), None, np.inf) for f in self.rivals[: self.limits.freed]]
        self.rivals += self.tried_all(tasks)

    @staticmethod
    def _by_cost(found: Sequence[Fit]) -> list[Fit]:
        return sorted(found, key=lambda f: (f.cost, f.hypothesis.name))

    def extend(self, free: bool, depth: int, limits: Limits | None = None) -> None:
        """Adds a cause to the best sets of one fewer. limits: numbers of causes and forms; None: the search's
        own."""
        limits = limits or self.limits
        smaller = self.sets(free, depth - 1, self._log_cost if self.inexact else None)
        least = np.inf  # least cost found with a better parent
        for parent in parents(smaller, limits.beam, self.floor, SOLVED * self.excess):
            taken = set(parent.hypothesis.causes)
            ranked = screen(self, parent, self.addable(taken))
            ranked = worth_a_look(ranked, parent.cost, second=depth > 1)
            tasks: dict[tuple[bool, frozenset[str]], tuple[Hypothesis, Array, Array | None, float]] = {}
            for test in worth_a_fit(ranked, depth, limits):
                hypothesis, start = self.start_from(parent, test.term, test.start, test.by)
                beyond_reach = test.cost - self.floor > _HOPELESS * max(least - self.floor, SOLVED * self.excess)
                if hypothesis.key not in self.fits and not beyond_reach:
                    tasks.setdefault(hypothesis.key, (hypothesis, start, self.law_columns(parent), parent.cost))
            found = self.keep_tried(list(tasks.values()))
            least = min([least, *(f.cost for f in found)])
        if free:
            best = [f for f in self.ranked(True) if len(f.hypothesis.causes) == depth][: limits.polished]
            for polished in self.map(self._polish, [(f,) for f in best]):
                self.keep(polished)
        try_sampled_delay(self, self.best(free, depth))

    def beside(self, parent: Fit) -> list[Fit]:
        """Fits with one more cause than a fit, each of those with a predicted gain in its best form, by cost."""
        ranked = screen(self, parent, self.addable(parent.hypothesis.causes))
        chosen = worth_a_fit(worth_a_look(ranked, parent.cost), 2, BESIDE)
        known = self.law_columns(parent)
        tasks = [(*self.start_from(parent, p.term, p.start, p.by), known, parent.cost) for p in chosen]
        fits = self._by_cost(self.tried_all(tasks))
        best = self.map(self._polish, [(f,) for f in fits[: BESIDE.polished]])
        return self._by_cost([*best, *fits[BESIDE.polished :]])

    def _log_cost(self, found: Fit) -> float:
        """Negative evidence of a fit beside a wrong law, over EVIDENCE_GAIN and without penalties."""
        direct = sum(self.direct.get(cause, 0.0) for cause in found.hypothesis.causes)
        return math.log(self.ratio(found.residual, self.residual)) - direct / EVIDENCE_GAIN

    def _polish(self, found: Fit) -> Fit:
        """Repeats a fit with new signatures of the law while each repetition reduces the cost enough."""
        for turn in range(_POLISHED):
            better = self.fitted(found.hypothesis, found.point, most=4, stage=f" polished {turn}")
            found, before = min(better, found, key=lambda f: f.cost), found
            if found.cost > (1 - _GAINS) * before.cost:
                break
        return found
