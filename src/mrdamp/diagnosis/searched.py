"""What a search found, in one form for a damper and a frame, and what is concluded from it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mrdamp.diagnosis.attribution.baseline_law import BaselineLaw
from mrdamp.diagnosis.attribution.frame_laws import OtherLaw
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.channels.comparison import Compared
from mrdamp.diagnosis.evidence.consistency import RegimeEstimate
from mrdamp.diagnosis.evidence.verdict import Decision
from mrdamp.diagnosis.fits.final import FinalFit
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.problem.noise import Noise
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.problem.rig import Rig
from mrdamp.diagnosis.report.result import Where
from mrdamp.model.core import Array

Progress = Callable[[str, float], None]


def silent(what: str, share: float) -> None:
    """Progress that nobody looks at."""


@dataclass(frozen=True)
class Searched(ABC):
    """A completed search.

    case: as compared (a frame's averaged). rig: with whole records. floor (blocks,): gaps due to noise alone.
    baseline: residuals of the baseline's records, None without any. compared: channels that see the same. notes: of
    the audit. again: the law identified again on the baseline, which the case's model then has. beyond: how all records
    leave the regimes of the baseline; empty if some do not. covered: number of records in these regimes, and of all.
    before: gap of the given simulator on the baseline, by its file; None without one. uncovered: residuals of the
    records outside these regimes; None if there are none, or all are.
    """

    case: Case
    rig: Rig
    search: Search
    noise: Noise
    floor: Array
    baseline: Problem | None
    compared: tuple[Compared, ...]
    notes: list[str]
    again: BaselineLaw | None
    beyond: str
    covered: tuple[int, int]
    before: float | None
    uncovered: Problem | None

    @abstractmethod
    def judged(self, progress: Progress) -> tuple[list[Fit], Decision, OtherLaw | None]:
        """All fits, the decision over them, and the law identified on the records themselves that makes a judged cause
        needless."""

    @abstractmethod
    def where(self, chosen: Fit, verdict: str, causes: Mapping[str, float]) -> Where:
        """Where in the chain the gap lies, of a verdict and its fit. causes: stated probabilities."""


@dataclass(frozen=True)
class Concluded:
    """The decision over all fits of a search after every check, and the simulator that follows from it.

    regimes: estimates of each cause that was most probable before the checks. final: of the search. other: a law that
    makes a cause needless. handed: the simulator that is handed over, `final` or the one with the other law.
    """

    fits: list[Fit]
    decision: Decision
    regimes: Mapping[str, tuple[RegimeEstimate, ...]]
    final: FinalFit
    handed: FinalFit
    other: OtherLaw | None

    @property
    def chosen(self) -> Fit:
        """The fit behind the verdict."""
        return self.fits[self.decision.chosen.index]
