"""The order of a search in a frame: causes in faulty blocks first, then the damper's among them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mrdamp.diagnosis.fits.alternative_forms import reform
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Progress, Search
from mrdamp.diagnosis.fits.table import THROUGH
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.frame import FrameRig

#: Number of best fits with fixed nominal parameters that are repeated with free ones; share of the excess by
#: which another form of the same cause may be worse.
_FREED, _FORM = 2, 0.02
#: Two causes without free parameters are not tried if one cause with free parameters leaves less than this
#: share of the best one without.
_AHEAD = 0.3


@dataclass
class FrameSearch(Search):
    """A search on the records of a frame. Causes with a place are tried first: faulty blocks admit few of them, and if
    they explain the gap the damper's causes are skipped."""

    def run(self, progress: Progress = lambda what, share: None) -> None:
        """See `Search`. While only causes with a place are sought, the problem has a rig without the others."""
        rig, problem = self.problem.rig, self.problem
        assert isinstance(rig, FrameRig)
        at_fault = frozenset(_block_names(rig)) - rig.clean
        places = frozenset(b for b in at_fault if b != "damper")
        placed = replace(rig, placed=True)
        steps: tuple[tuple[str, FrameRig, bool, int], ...] = (
            ("storeys, floors and accelerometers", placed, bool(places), 1),
            ("two of them", placed, len(places) > 1, 2),
            ("one cause, the damper's among them", rig, True, 1),
            ("two causes", rig, True, 2),
        )
        damper_may_be_at_fault = any(b == "damper" or b.startswith("storey") for b in at_fault)
        law_explains_more = False
        for number, (what, sought, needed, depth) in enumerate(steps):
            if not needed or self._enough(at_fault, law=number > 2):
                continue
            problem.rig = sought
            if depth == 2:
                if damper_may_be_at_fault and self.explained_outside():
                    problem.rig = rig
                    return
                if law_explains_more and self._ahead():
                    continue
            progress(what, (number + 1) / 6)
            self.extend(False, depth)
            single = self.best(False, 1)
            if not sought.placed and depth == 1 and not self._enough(at_fault):
                if single is not None:
                    reform(self, single)
                if not self._enough(at_fault):
                    law = Hypothesis(rig.nominal), self.base.point
                    self.keep_fitted([law], most=THROUGH, stage=" through")
                    if self._enough(at_fault):
                        continue
                    # If free parameters explain more than any cause, they are combined with one cause before two
                    # causes are tried without them.
                    law_explains_more = self.base.cost < self.ranked(False)[0].cost
                    if law_explains_more:
                        self.extend(True, 1)
                        if self.solved(self.ranked(True)[0]):
                            break
            if not self._enough(at_fault):
                for f in [f for f in self.ranked(False) if f.hypothesis.terms][:_FREED]:
                    self._free(f)
        problem.rig = rig
        self._finish(progress, at_fault, law_explains_more=law_explains_more)
        if damper_may_be_at_fault and not self.solved(self.least):
            # A rival is fitted with free nominal parameters, as are the fits it is compared with.
            best = self.least
            if best.hypothesis.terms and not best.hypothesis.nominal:
                best = self._free(best)
            if not self.solved(best):
                self.outside()

    def _finish(self, progress: Progress, at_fault: frozenset[str], *, law_explains_more: bool) -> None:
        """Other parameters and forms beside the best fit."""
        if not law_explains_more and not self._enough(at_fault):
            progress("one cause beside other numbers", 5 / 6)
            self.extend(True, 1)
        if not self._enough(at_fault):
            reform(self, self.least)

    def _ahead(self) -> bool:
        """True if one cause with free parameters leaves much less than the best one without: two causes without
        would only stand in for the parameters."""
        free, fixed_law = self.best(True, 1), self.best(False, 1)
        if free is None or fixed_law is None:
            return False
        return self.unexplained(free) < _AHEAD * self.unexplained(fixed_law)

    def _enough(self, at_fault: frozenset[str], *, law: bool = True) -> bool:
        """True if the best fit leaves little and its causes act in every faulty block.

        law: accept free nominal parameters alone; they can imitate an effect of the damper that has not been
        tried.
        """
        fits = [f for f in self.fits.values() if law or f.hypothesis.terms or not f.hypothesis.nominal]
        best = min(fits, key=lambda f: (f.cost, f.hypothesis.name))
        solved = self.solved(best)
        if solved and at_fault <= {"damper"}:
            return True
        # The remainder may be small compared with an accelerometer's fault and still be the whole of the
        # damper's.
        covered: set[str] = {"damper"} if solved else set()
        for term in best.hypothesis.terms:
            if term.place is None:
                covered.add("damper")
            elif term.stage == "sensor":
                covered.add(f"accelerometer {term.place}")
            else:
                first = 1 if term.effect == "floor_mass" else term.place
                covered |= {f"storey {j}" for j in range(first, term.place + 1)}
        little = solved or self.unexplained(best) < _FORM
        return bool(best.hypothesis.terms) and at_fault <= covered and little

    def _free(self, fixed_law: Fit) -> Fit:
        """The same causes with free nominal parameters, which is kept."""
        found = self.fitted(*self.with_free_law(fixed_law), most=4, stage=" freed")
        self.keep(found)
        return found


def _block_names(rig: FrameRig) -> list[str]:
    floors = range(1, rig.structure.storeys + 1)
    return [f"{kind} {j}" for kind in ("accelerometer", "storey") for j in floors] + ["damper"]
