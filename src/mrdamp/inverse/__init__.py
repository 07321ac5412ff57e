"""The inverse model: from a wanted force and the motion to the command, and how well it tracks in MuJoCo."""

from mrdamp.inverse.base import Inverse, command_range
from mrdamp.inverse.law import LawInverse
from mrdamp.inverse.shadow import Shadow

__all__ = ["Inverse", "LawInverse", "Shadow", "command_range"]
