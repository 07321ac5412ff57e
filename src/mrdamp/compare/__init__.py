"""Comparison of controllers: runs over motions and amplitudes, means with intervals, tables and a page."""

from mrdamp.compare.comparison import Comparison, compare
from mrdamp.compare.contenders import Contender, contenders
from mrdamp.compare.frame import FrameBench

__all__ = ["Comparison", "Contender", "FrameBench", "compare", "contenders"]
