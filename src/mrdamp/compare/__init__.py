"""Comparison of controllers: runs over motions and amplitudes, means with intervals, tables and a page."""

from __future__ import annotations

import sys

from mrdamp.compare.comparison import Comparison, compare
from mrdamp.compare.contenders import Contender, contenders
from mrdamp.compare.frame import FrameBench
from mrdamp.shown import CalledPackage

__all__ = ["Comparison", "Contender", "FrameBench", "compare", "contenders"]

sys.modules[__name__].__class__ = CalledPackage  # `mrdamp.compare(...)` is `mrdamp.api.compare`
