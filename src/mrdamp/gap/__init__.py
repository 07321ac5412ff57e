"""The sim-to-real gap of a controller: what it does in the simulator, on a rig that differs, and after a diagnosis."""

from mrdamp.gap.real import EFFECTS, RealFrame
from mrdamp.gap.study import Options, Study, study

__all__ = ["EFFECTS", "Options", "RealFrame", "Study", "study"]
