"""Other laws of a frame's damper beside a cause that has the form of a law.

A yield force that depends on the velocity is what another law gives. Without a baseline such a cause is established
only if no other law, identified on the same records, makes it needless.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrdamp.diagnosis.attribution.baseline_law import LAWS, fitted_along, identified, richest
from mrdamp.diagnosis.attribution.frame_damper import damper_alone, with_law
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.constants import LAW_FORMS, LAW_NEEDLESS, MATERIAL
from mrdamp.diagnosis.fits.final import FinalFit, heldout
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.frame import FrameRig
from mrdamp.diagnosis.problem.make import with_model
from mrdamp.diagnosis.problem.residuals import Problem, pooled
from mrdamp.model import Model
from mrdamp.model.core import Array

#: Local fits of each law.
_STARTS = 2


@dataclass(frozen=True)
class OtherLaw:
    """A law that makes causes needless.

    model: the simulator with this law, identified on all records. causes: of the fit that have the form of a law.
    others: the fit's other causes. gap, left: of this law, and of the fit on left-out records. left_out (blocks,):
    gaps of the law alone with each record left out of its identification in turn; infinite if the others do not
    suffice, and beside other causes.
    """

    model: Model
    causes: tuple[str, ...]
    others: frozenset[str]
    gap: float
    left: float
    left_out: Array

    def to_dict(self, handed_over: bool = False) -> dict[str, Any]:
        """Entry of `diagnosis.json`. handed_over: the corrected simulator has this law."""
        own = {"law": self.model.law, "gap": self.gap, "without": list(self.causes), "gap_with": self.left}
        return {**own, "handed_over": handed_over}


def other_law(case: Case, problem: Problem, chosen: Fit, threads: int = 1) -> OtherLaw | None:
    """The law that explains more than the causes of `chosen` in LAW_FORMS, or None.

    Every law of LAWS is identified on the damper's measured stroke and force, with the richest dependence on the
    command that the records show. In the frame, with the fit's other causes, it has to leave less than LAW_NEEDLESS
    of the cost that the fit leaves on left-out records. problem: residuals of the search. threads: for the fits. None
    also if the damper's stroke or force was not measured.
    """
    causes = tuple(c for c in chosen.hypothesis.causes if c in LAW_FORMS)
    rig, extras = problem.rig, fitted_along(case.model)
    if not causes or extras is None or not isinstance(rig, FrameRig):
        return None
    needed = {"force_N", *(f"floor{k}_displacement_m" for k in rig.structure.damper_between if k)}
    if not all(needed <= set(r.channels) for r in case.records):
        return None
    kept = [t for t in chosen.hypothesis.terms if t.cause not in causes]
    names = {c.name for t in kept for c in t.coordinates}
    held = {name: value for name, value in chosen.settings.items() if name in names}
    alone = damper_alone(case).records

    how = {"extras": extras, "hold": bool(case.model.hold), "threads": threads}
    each = {law: identified(law, alone, dependence=richest(alone), starts=_STARTS, **how) for law in LAWS}
    laws = {law: found for law, found in each.items() if found is not None}
    models = {law: with_law(rig.nominal_model, found) for law, found in laws.items()}
    costs = {law: problem.cost(gaps_with(problem, model, held)) for law, model in models.items()}
    left = heldout(problem, chosen)
    law = min(costs, key=lambda name: costs[name], default="")
    if not law or not costs[law] < LAW_NEEDLESS * problem.cost(left):
        return None
    gap, before = (pooled(gaps) for gaps in (gaps_with(problem, models[law], held), left))
    left_out = np.full(len(problem.blocks), np.inf)
    for k in problem.records if not kept else ():
        rest, start = [r for j, r in enumerate(alone) if j != k], laws[law].attributes
        found = identified(law, rest, dependence=richest(rest), start=start, starts=1, **how)
        if found is not None:
            own = [b.record == k for b in problem.blocks]
            left_out[own] = gaps_with(problem, with_law(rig.nominal_model, found))[own]
    return OtherLaw(models[law], causes, frozenset(t.cause for t in kept), gap, before, left_out)


def law_handed_over(other: OtherLaw, final: FinalFit) -> FinalFit | None:
    """The simulator with another law, in place of the final one; None if it leaves more of left-out records than that,
    or takes less than MATERIAL of the nominal squares off."""
    own = final.problem
    nominal = pooled(own.gaps(own.nominal()))
    if not pooled(other.left_out) < min(pooled(final.heldout), (1 - MATERIAL) ** 0.5 * nominal):
        return None
    problem = own.like(with_model(own.rig, other.model))
    return FinalFit(fit(problem, Hypothesis(()), np.zeros(0), most=0), other.left_out, problem)


def gaps_with(problem: Problem, model: Model, held: Mapping[str, float] | None = None) -> Array:
    """(blocks,) gaps of another simulator of the frame, with `held` settings of effects."""
    other = problem.like(with_model(problem.rig, model))
    return other.gaps(other.of_settings([dict(held or {})])[0])
