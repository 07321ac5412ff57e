"""Controllers of MR dampers: constant commands, clipped-optimal and its kin, Lyapunov, skyhook, force tracking."""

from mrdamp.control.base import Controller
from mrdamp.control.clipped_optimal import (
    clipped_optimal,
    force_tracking,
    ideal_active,
    lyapunov,
    max_dissipation,
    modulated_optimal,
)
from mrdamp.control.force_control import ForceController, skyhook
from mrdamp.control.passive import Constant, passive_off, passive_on

__all__ = [
    "Constant",
    "Controller",
    "ForceController",
    "clipped_optimal",
    "force_tracking",
    "ideal_active",
    "lyapunov",
    "max_dissipation",
    "modulated_optimal",
    "passive_off",
    "passive_on",
    "skyhook",
]
