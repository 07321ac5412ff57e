"""Identification of force laws from records: fits, one fit per command, the papers' comparison of laws."""

from __future__ import annotations

import sys

from mrdamp.identify.fit import (
    Fit,
    Problem,
    RecordError,
    compare_dependences,
    descend,
    error,
    identify,
    model_of,
    pooled,
    simulate,
)
from mrdamp.shown import CalledPackage

__all__ = [
    "Fit",
    "Problem",
    "RecordError",
    "compare_dependences",
    "descend",
    "error",
    "identify",
    "model_of",
    "pooled",
    "simulate",
]

sys.modules[__name__].__class__ = CalledPackage  # `mrdamp.identify(...)` is `mrdamp.api.identify`
