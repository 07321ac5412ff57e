"""Other laws of a frame's damper beside a cause that has the form of a law.

A yield force that depends on the velocity is what another law gives. Without a baseline such a cause is established
only if no other law, identified on the same records, makes it needless.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mrdamp.diagnosis.attribution.frame_damper import damper_alone, with_law
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.constants import LAW_FORMS, LAW_NEEDLESS
from mrdamp.diagnosis.fits.final import heldout
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.problem.baseline_law import LAWS, fitted_along
from mrdamp.diagnosis.problem.frame import FrameRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.errors import InputError
from mrdamp.identify import identify
from mrdamp.identify.laws import DEPENDENCES, Scales
from mrdamp.model.core import Array

#: Local fits of each law.
_STARTS = 2


@dataclass(frozen=True)
class OtherLaw:
    """A law that makes causes needless.

    causes: of the fit that have the form of a law. others: the fit's other causes. gap, left: of this law, and of the
    fit on left-out records.
    """

    law: str
    causes: tuple[str, ...]
    others: frozenset[str]
    gap: float
    left: float

    def to_dict(self) -> dict[str, Any]:
        """Entry of `diagnosis.json`."""
        return {"law": self.law, "gap": self.gap, "without": list(self.causes), "gap_with": self.left}


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
    found = {law: _gaps(case, rig, problem, law, extras, held, threads) for law in LAWS}
    left = heldout(problem, chosen)
    best = min(found, key=lambda law: problem.cost(found[law]))
    if not problem.cost(found[best]) < LAW_NEEDLESS * problem.cost(left):
        return None
    gap, before = (float(np.sqrt(np.mean(gaps**2))) for gaps in (found[best], left))
    return OtherLaw(best, causes, frozenset(t.cause for t in kept), gap, before)


def _gaps(
    case: Case,
    rig: FrameRig,
    problem: Problem,
    law: str,
    extras: tuple[str, ...],
    held: Mapping[str, float],
    threads: int,
) -> Array:
    """(blocks,) gaps of the law in the frame, with `held` settings of other causes; infinite without a fit."""
    alone = damper_alone(case)
    levels = Scales.of(alone.records).levels
    dependence = [name for name, need in DEPENDENCES.items() if need <= levels][-1]
    try:
        own = identify(law, alone.records, extras=extras, dependence=dependence, starts=_STARTS, threads=threads).model
    except InputError:
        return np.full(len(problem.blocks), np.inf)
    framed = Problem(
        replace(rig, nominal_model=with_law(rig.nominal_model, own)),
        problem.records,
        stride=problem.stride,
        coarse=problem.coarse,
        trust=problem.trust,
    )
    return framed.gaps(framed.of_settings([dict(held)])[0])
