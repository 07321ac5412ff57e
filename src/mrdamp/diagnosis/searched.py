"""What a search hands on: the same of a damper and of a frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.evidence.verdict import Decision
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.problem.noise import Noise
from mrdamp.diagnosis.problem.rig import Rig
from mrdamp.diagnosis.report.result import Diagnosis
from mrdamp.model.core import Array

Judged = tuple[list[Fit], Decision]


@dataclass(frozen=True)
class Searched:
    """A search that is through.

    case: as it is compared (a frame's in means); rig: with the whole records. floor (blocks,): gaps that noise alone
    leaves; base (channels,): gap that the nominal simulator leaves of the rig's baseline; notes: of the audit. judge:
    all fits and the decision over them; complete: the answer with what this rig alone can say, given the
    decision's fit.
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
