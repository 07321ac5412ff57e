"""The rig of a case."""

from __future__ import annotations

from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.frame import FrameRig
from mrdamp.diagnosis.problem.rig import Rig


def make_rig(case: Case, threads: int = 1) -> Rig:
    """The rig of a case. threads: number of simulations in parallel."""
    kind = FrameRig if case.model.rig == "frame" else DamperRig
    return kind(case.model, case.records, threads=threads)
