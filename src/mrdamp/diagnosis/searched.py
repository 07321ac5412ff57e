"""Result of a search, in one form for a damper and a frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from mrdamp.diagnosis.attribution.frame_laws import OtherLaw
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.evidence.verdict import Decision
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.problem.baseline_law import BaselineLaw
from mrdamp.diagnosis.problem.noise import Noise
from mrdamp.diagnosis.problem.rig import Rig
from mrdamp.diagnosis.report.result import Diagnosis
from mrdamp.model.core import Array

Judged = tuple[list[Fit], Decision]


@dataclass(frozen=True)
class Searched:
    """A completed search.

    case: as compared (a frame's averaged). rig: with whole records. floor (blocks,): gaps due to noise alone.
    base (channels,): gap of the nominal simulator on the rig's baseline. notes: of the audit. judge: computes
    all fits and the decision. complete: adds what only this rig can provide to the answer, given the
    decision's fit. again: the law identified again on the baseline, which the case's model then has. others: laws
    identified on the records themselves that make a judged cause needless, at most one; `judge` fills it.
    """

    case: Case
    rig: Rig
    search: Search
    noise: Noise
    floor: Array
    base: Array
    notes: list[str]
    judge: Callable[[], Judged]
    complete: Callable[[Diagnosis, Fit], Diagnosis]
    again: BaselineLaw | None = None
    others: list[OtherLaw] = field(default_factory=list)
