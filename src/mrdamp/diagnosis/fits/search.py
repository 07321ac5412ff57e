"""Which causes explain the gap: screening by signatures, fits of what is promising, forward steps, drops, a beam.

Every set of causes is tried twice: with the nominal parameters held where their owner believes them, and with all of
them free. Held is the simpler statement by as many numbers as the law has, and where the owner is right it parts
causes that a free law would blur; free is what counts where he is not.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from mrdamp.core import Array
from mrdamp.diagnosis.constants import INEXACT
from mrdamp.diagnosis.fits.alternative_forms import drop, exchange, reform, reform_rival
from mrdamp.diagnosis.fits.beam import FLOOR_DOUBT, Promise, first_forms, parents, promising, worth_a_fit
from mrdamp.diagnosis.fits.cache import Seen
from mrdamp.diagnosis.fits.delay_clock import try_clock
from mrdamp.diagnosis.fits.least_squares import ROUGHLY, TOLERANCE, Fit, fit, taken_up
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.screening import screened
from mrdamp.diagnosis.fits.store import Store
from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Term
from mrdamp.diagnosis.problem.residuals import Problem

Progress = Callable[[str, float], None]

#: Free numbers alone may stand in for a cause: where they take most of a gap, but leave this share of the floor more
#: than it, causes are tried beside them.
_LAW_DOUBT, _STANDS_IN = 0.1, 0.3
#: Turns that a fit with free numbers is polished for, and the share that one has to take off for another.
_POLISHED, _GAINS = 4, 0.3
#: Beside a lesser parent, what promises to leave more than so many times what was found beside a better one is left.
_HOPELESS = 10.0
#: Nothing material is left for another cause below this unexplained share.
_SOLVED = 0.001
#: A second cause's price is paid where half is left (exp(-2 (CAUSE_PRICE + NUMBER_PRICE) / INDEPENDENT)); a pair that
#: leaves more than this share of what the best single cause leaves is not followed.
_PAYS = 0.6
#: Held causes that leave less than this are the right ones, or near: their law and forms are freed, nothing else tried.
_NEARLY = 0.02


@dataclass
class Search:
    """Fits of hypotheses on one problem. floor: the cost that noise alone leaves. rivals: fits of causes outside the
    catalogue; looks_like: the one of them that the verdict went by. steady: False where two runs of one test differ by
    more than their noise. seen: what was fitted and screened so far. direct: nats by cause that channels which see the
    same thing speak for it. own: cost of what the nominal simulator misses of the rig's baseline, 0 without one."""

    problem: Problem
    floor: float
    limits: Limits = field(default_factory=Limits)
    jobs: int = 1
    store: Store = field(default_factory=Store)
    fits: dict[tuple[bool, frozenset[str]], Fit] = field(default_factory=dict)
    failed: list[str] = field(default_factory=list)
    rivals: list[Fit] = field(default_factory=list)
    looks_like: Fit | None = None
    steady: bool = True
    seen: Seen = field(default_factory=Seen)
    direct: Mapping[str, float] = field(default_factory=dict)
    own: float = 0.0
    _fine_costs: dict[tuple[str, bytes], float] = field(default_factory=dict)
    _asked: bool = False

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
        """The nominal parameters alone, fitted."""
        return self.fits[True, frozenset()]

    @property
    def inexact(self) -> bool:
        """True where no fit so far meets the noise: the law is not the rig's, or the cause is not in the catalogue."""
        return min(f.cost for f in self.fits.values()) > INEXACT * self.floor

    def begin_with(self, term: Term) -> None:
        """Fits a term from its first start, with the law held and free, and keeps both."""
        q = np.array([c.point(v) for c, v in zip(term.coordinates, term.starts[0], strict=True)])
        for parent in (self.fits[False, frozenset()], self.base):
            start = np.concatenate([parent.point, q])
            found = self._try(parent.hypothesis.plus(term), start, self.law_columns(parent), np.inf)
            if found is not None:
                self.keep(found)

    def unexplained(self, found: Fit) -> float:
        """Share of the excess that a fit leaves."""
        return max(found.cost - self.floor, 0.0) / self.excess

    def start_from(self, found: Fit, term: Term, k: int, by: float = 1.0) -> tuple[Hypothesis, Array]:
        """A fit with a term added at one of its starts, its linear numbers stretched by a factor."""
        q = [
            c.point(v if c.log else c.start + by * (v - c.start))
            for c, v in zip(term.coordinates, term.starts[k], strict=True)
        ]
        return found.hypothesis.plus(term), np.concatenate([found.point, q])

    def beside(self, taken: Collection[str]) -> list[Term]:
        """Terms of the catalogue that may be added to causes."""
        return [t for t in self.problem.rig.terms if t.cause not in taken and not t.later]

    def screen(self, found: Fit, terms: Sequence[Term]) -> list[Promise]:
        """What each term promises on top of a fit, best first.

        A score test with a signature of finite size: the change that the term makes at a start, less what the free
        coordinates can make themselves, stretched to the residual (backwards too, where the term has two signs).
        """
        key = (found.name, found.point.tobytes(), tuple(t.name for t in terms))
        if key not in self.seen.screens:
            self.seen.screens[key] = screened(self, found, terms)
        return self.seen.screens[key]

    def run(self, progress: Progress = lambda what, share: None) -> None:
        """Held singles, then held pairs, then both with the nominal parameters free; what is solved ends it."""
        for number, (free, depth) in enumerate(product((False, True), range(1, self.limits.depth + 1))):
            if self.solved(self.base) and (free or depth > 1):
                if (1 + _LAW_DOUBT) * self.floor < self.base.cost < _STANDS_IN * self.nominal_cost:
                    self.extend(True, 1)
                break
            if free and depth > 1 and self.inexact and not self.pair_pays(False):
                break
            beside = self.best(True, 1)
            if free and depth > 1 and beside is not None and self.solved(beside):
                break
            before = self.best(False)
            if before is not None and (self.solved(before) or (free and self.unexplained(before) < _NEARLY)):
                break
            if depth > 1 and not free and self.explained_outside():
                self.free_best()
                return
            count = ("one cause", "two causes", "three causes")[depth - 1]
            law = "free" if free else "held"
            progress(f"{count}, nominal parameters {law}", number / (2 * self.limits.depth))
            self.extend(free, depth)
            single = self.best(free, 1)
            if depth == 1 and single is not None and not self.solved(single):
                reform(self, single)
        if self.pair_pays(False):
            self.free_parts()
        self.free_best()
        for free in (False, True):
            best = self.best(free) if self.pair_pays(free) else self.best(free, 1)
            if best is not None and not self.solved(best):
                reform(self, best)
                reform_rival(self, best)
        if self.pair_pays(False) or self.pair_pays(True):
            exchange(self)
        for free in (False, True):
            best = self.best(free)
            if best is not None:
                drop(self, best)
        if not any(self.solved(f) for free in (False, True) for f in self.ranked(free)[:1]):
            self.outside()

    def pair_pays(self, free: bool) -> bool:
        """True where the best pair of causes leaves so much less than the best single one that it can be worth the
        price of another cause, in the form that is right; and little, where nothing meets the noise."""
        single, pair = self.best(free, 1), self.best(free, 2)
        if single is None or pair is None:
            return False
        if self.inexact and self.unexplained(pair) > 2 * _NEARLY:
            return False
        return pair.cost - self.floor < _PAYS * (single.cost - self.floor)

    def free_parts(self) -> None:
        """Each cause of the best held set alone, with the law free: numbers that are a little off look like a second
        cause, and the two have to be weighed."""
        best = self.best(False)
        if best is None or len(best.hypothesis.causes) < 2:
            return
        tasks = []
        low = len(best.hypothesis.nominal)
        for term in best.hypothesis.terms:
            count = len(term.coordinates)
            hypothesis = self.base.hypothesis.plus(term)
            start = np.concatenate([np.zeros(len(self.base.point)), best.point[low : low + count]])
            low += count
            if (True, frozenset([term.name])) not in self.fits:
                tasks.append((hypothesis, start, None, np.inf))
        for found in self.map(self._try, tasks):
            if found is not None:
                self.keep(found)

    def free_best(self) -> None:
        """The best sets of each size that were held, with the law free from there: where its numbers are a little off,
        a set that explains most is not found on top of a law that was bent to do without it. Where one cause beside
        free numbers leaves nothing, only the best causes alone: others may leave nothing either."""
        if any(self.solved(f) for f in self.ranked(False)[:1]):
            return
        tasks = []
        alone = any(self.solved(f) for f in self.ranked(True)[:1])
        most = 1 if alone or not self.pair_pays(False) else self.limits.depth
        for depth in range(1, most + 1):
            sets: dict[frozenset[str], Fit] = {}
            for held in self.ranked(False):
                if len(held.hypothesis.causes) == depth:
                    sets.setdefault(frozenset(held.hypothesis.causes), held)
            for held in list(sets.values())[: self.limits.freed]:
                hypothesis = Hypothesis(self.base.hypothesis.nominal, held.hypothesis.terms)
                start = np.concatenate([np.zeros(len(hypothesis.nominal)), held.point])
                tasks.append((hypothesis, start))
        for found in self.map(lambda h, q: self.fitted(h, q, most=8, stage=" freed"), tasks):
            self.keep(found)

    def explained_outside(self) -> bool:
        """True where a cause outside the catalogue leaves nothing and none in it comes near: two of those can say no
        more, with more numbers."""
        if min(self.unexplained(f) for f in self.fits.values()) < _NEARLY:
            return False
        self.outside()
        return any(self.solved(f) for f in self.rivals)

    def outside(self) -> None:
        """Causes outside the catalogue, the most promising alone, with the nominal parameters held and free; asked for
        once."""
        if self._asked:
            return
        self._asked = True
        held = self.fits[False, frozenset()]
        ranked = promising(self.screen(held, self.problem.rig.rivals), held.cost)
        chosen = first_forms(ranked)[: self.limits.rivals]
        tasks = [(*self.start_from(held, p.term, p.start, p.by), None, np.inf) for p in chosen]
        self.rivals = [f for f in self.map(self._try, tasks) if f is not None]
        self.rivals.sort(key=lambda f: (f.cost, f.hypothesis.name))
        tasks = []
        for found in self.rivals[: self.limits.freed]:
            free = Hypothesis(self.base.hypothesis.nominal, found.hypothesis.terms)
            tasks.append((free, np.concatenate([np.zeros(len(free.nominal)), found.point]), None, np.inf))
        self.rivals += [f for f in self.map(self._try, tasks) if f is not None]

    def solved(self, found: Fit) -> bool:
        """True where nothing material is left for another cause to explain.

        A piston between a mount and a damper is stepped too coarsely in a search to tell: what comes near is looked at
        with the full step.
        """
        if self._little(found.cost):
            return True
        mounted = any(t.stage == "mount" for t in found.hypothesis.terms)
        if not (mounted and self.problem.coarse and self.unexplained(found) < _NEARLY):
            return False
        key = (found.name, found.point.tobytes())
        if key not in self._fine_costs:
            p = self.problem
            fine = Problem(p.rig, p.records, stride=p.stride, trust=p.trust)
            r = fine.residuals(found.hypothesis, found.point)[0]
            self._fine_costs[key] = float(r @ r)
        return self._little(self._fine_costs[key])

    def _little(self, cost: float) -> bool:
        return cost - self.floor < _SOLVED * self.excess + FLOOR_DOUBT * self.floor

    def extend(self, free: bool, depth: int) -> None:
        smaller = [f for f in self.ranked(free) if len(f.hypothesis.causes) == depth - 1]
        least = np.inf  # of what was found beside a better parent
        for parent in parents(smaller, self.limits.beam, self.floor, _SOLVED * self.excess):
            taken = set(parent.hypothesis.causes)
            ranked = self.screen(parent, self.beside(taken))
            ranked = promising(ranked, parent.cost, beside=depth > 1)
            tasks: dict[frozenset[str], tuple[Hypothesis, Array, Array | None, float]] = {}
            for promise in worth_a_fit(ranked, depth, self.limits):
                hypothesis, start = self.start_from(parent, promise.term, promise.start, promise.by)
                key = frozenset(t.name for t in hypothesis.terms)
                hopeless = promise.cost - self.floor > _HOPELESS * max(
                    least - self.floor, _SOLVED * self.excess
                )
                if (free, key) not in self.fits and not hopeless:
                    tasks.setdefault(key, (hypothesis, start, self.law_columns(parent), parent.cost))
            for found in self.map(self._try, list(tasks.values())):
                if found is not None:
                    self.keep(found)
                    least = min(least, found.cost)
        if free:
            best = [f for f in self.ranked(True) if len(f.hypothesis.causes) == depth][: self.limits.polished]
            for found in self.map(self._polish, [(f,) for f in best]):
                self.keep(found)
        try_clock(self, self.best(free, depth))

    def _polish(self, found: Fit) -> Fit:
        """With the law's signatures taken anew, as often as that takes a good part off."""
        for turn in range(_POLISHED):
            better = self.fitted(found.hypothesis, found.point, most=4, stage=f" polished {turn}")
            found, before = min(better, found, key=lambda f: f.cost), found
            if found.cost > (1 - _GAINS) * before.cost:
                break
        return found

    @staticmethod
    def law_columns(found: Fit) -> Array | None:
        """Columns of a fit's Jacobian for the nominal parameters; None where they are held."""
        count = len(found.hypothesis.nominal)
        return found.jacobian[:, :count] if count else None

    def _try(self, hypothesis: Hypothesis, start: Array, known: Array | None, bar: float) -> Fit | None:
        try:
            most = 8 if hypothesis.nominal else 15  # evidence goes by the logarithm of what is left
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
        """A fit from a start, or what an interrupted run had found for it. known: columns of the Jacobian that stay as
        they are (of the nominal parameters, at the parent's fit). bar: the parent's cost, to get below. tolerance: see
        `fit`."""
        name = f"{'free' if hypothesis.nominal else 'held'} {hypothesis.name}{stage}"
        if (name, start.tobytes()) not in self.seen.fits:
            found = self._fitted(name, hypothesis, start, most, known, bar, tolerance)
            self.seen.fits[name, start.tobytes()] = found
        return self.seen.fits[name, start.tobytes()]

    def went(self, hypothesis: Hypothesis, start: Array, steps: int) -> bool:
        """True where a fit of a held law from this very start went so many steps: again it would come no further."""
        found = self.seen.fits.get((f"held {hypothesis.name}", start.tobytes()))
        return not hypothesis.nominal and found is not None and found.iterations >= steps

    def _fitted(
        self,
        name: str,
        hypothesis: Hypothesis,
        start: Array,
        most: int,
        known: Array | None,
        bar: float,
        tolerance: float,
    ) -> Fit:
        if known is None and hypothesis.nominal:
            # Once, at the start: a law has a dozen numbers, whose signatures change little on the way.
            rough = self.problem.rougher(hypothesis)
            known = rough.jacobian(
                hypothesis,
                start,
                rough.residuals(hypothesis, start)[0],
                range(len(hypothesis.nominal)),
            )
        kept = self.store.get(name)
        if kept is not None and kept.point.shape == start.shape:
            ended = taken_up(self.problem, hypothesis, kept.point, kept.at, known, converged=kept.converged)
            return replace(ended, iterations=kept.iterations)
        found = fit(
            self.problem,
            hypothesis,
            start,
            most=most,
            tolerance=tolerance,
            known=known,
            frozen=known is not None,
            bar=bar,
        )
        self.store.put(name, found.point, found.converged, found.at, found.iterations)
        return found

    def keep(self, found: Fit) -> None:
        """Takes a fit in, where it is the best of its terms."""
        key = (bool(found.hypothesis.nominal), frozenset(t.name for t in found.hypothesis.terms))
        if key not in self.fits or found.cost < self.fits[key].cost:
            self.fits[key] = found

    def ranked(self, free: bool) -> list[Fit]:
        """Fits of a flavour by cost."""
        return sorted(
            (f for (is_free, _), f in self.fits.items() if is_free == free),
            key=lambda f: (f.cost, f.hypothesis.name),
        )

    def smallest(self, free: bool, causes: Iterable[str]) -> Fit | None:
        """The best fit of exactly these causes."""
        wanted = set(causes)
        return next((f for f in self.ranked(free) if set(f.hypothesis.causes) == wanted), None)

    def best(self, free: bool, causes: int | None = None) -> Fit | None:
        """The best fit of a flavour, with so many causes."""
        return next(
            (f for f in self.ranked(free) if causes is None or len(f.hypothesis.causes) == causes), None
        )

    def map(self, function: Callable[..., Any], jobs: Iterable[tuple[Any, ...]]) -> list[Any]:
        """What a function gives for each tuple of arguments, side by side in threads."""
        tasks = list(jobs)
        if self.jobs == 1 or len(tasks) < 2:
            return [function(*task) for task in tasks]
        # The work is done in the C entry, outside the interpreter's lock.
        return list(Parallel(n_jobs=self.jobs, prefer="threads")(delayed(function)(*task) for task in tasks))
