"""Another law, identified on the case's own records, as the corrected simulator of an answer without a cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mrdamp.diagnosis.attribution.frame_laws import OtherLaw
from mrdamp.diagnosis.constants import UNNAMED_GAP
from mrdamp.diagnosis.fits.final import FinalFit
from mrdamp.diagnosis.fits.least_squares import fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.frame import FrameRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.report.assembly import remaining
from mrdamp.diagnosis.report.file_gaps import predicted_gap
from mrdamp.diagnosis.report.result import Diagnosis, pooled, step


def with_other_law(found: Diagnosis, other: OtherLaw | None, search: Search, final: FinalFit) -> Diagnosis:
    """The answer with the simulator that has the other law, instead of the one that contains the needless cause.

    Unchanged without another law, with a named cause, and if the law leaves more of left-out records than the answer's
    simulator, or than UNNAMED_GAP of the nominal gap. search, final: of the answer.
    """
    own = final.problem
    if other is None or found.verdict != "unknown" or not isinstance(own.rig, FrameRig):
        return found
    gaps = other.left_out
    nominal = pooled(own.gaps(own.of_settings([{}])[0]))
    if not pooled(gaps) < min(pooled(final.heldout), UNNAMED_GAP * nominal):
        return found
    rig = replace(own.rig, nominal_model=other.model)
    problem = Problem(rig, own.records, stride=own.stride, coarse=own.coarse, trust=own.trust)
    alone = FinalFit(fit(problem, Hypothesis(()), np.zeros(0), most=0), (), gaps, problem)
    bar = step(f"law {other.law}", gaps)
    corrected = predicted_gap(other.model, own)
    left, ceiling = remaining(search, alone, found.gap.nominal, found.gap.noise_floor)
    return replace(
        found,
        corrected=other.model,
        gap=replace(found.gap, corrected=corrected, left_out=bar.gap, interval=bar.interval, ceiling=ceiling),
        waterfall=(found.waterfall[0], bar),
        remainder=left,
        corrections=(),
        intervals={},
        drawn=(),
        other_law=other.to_dict(handed_over=True),
        pictures={**found.pictures, "corrected": alone.fit.residual / problem.weights},
    )
