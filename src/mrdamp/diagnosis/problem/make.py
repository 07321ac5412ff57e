"""The rig of a case, and of another simulator."""

from __future__ import annotations

from dataclasses import replace

from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.frame import FrameRig
from mrdamp.diagnosis.problem.rig import Rig
from mrdamp.model import Model


def make_rig(case: Case, threads: int = 1) -> Rig:
    """The rig of a case. threads: number of simulations in parallel."""
    kind = FrameRig if case.model.rig == "frame" else DamperRig
    return kind(case.model, case.records, threads=threads)


def with_model(rig: Rig, model: Model) -> Rig:
    """The rig of a case with another simulator. A damper's motion is the one that suits this simulator."""
    if isinstance(rig, FrameRig):
        return replace(rig, nominal_model=model)
    return DamperRig(model, rig.records).with_motion()
