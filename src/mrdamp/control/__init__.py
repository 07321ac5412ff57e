"""Baseline controllers of MR dampers in frames: constant commands and clipped-optimal control."""

from mrdamp.control.base import Controller
from mrdamp.control.clipped_optimal import ClippedOptimal, clipped_optimal
from mrdamp.control.passive import Constant, passive_off, passive_on

__all__ = ["ClippedOptimal", "Constant", "Controller", "clipped_optimal", "passive_off", "passive_on"]
