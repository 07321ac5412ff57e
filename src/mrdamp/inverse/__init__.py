"""The inverse model: from a wanted force and the motion to the command, and how well it tracks in MuJoCo."""

from mrdamp.inverse.baselines import Inverse, command_range
from mrdamp.inverse.tracking import ForcePredictor, LawInverse

__all__ = ["ForcePredictor", "Inverse", "LawInverse", "command_range"]
