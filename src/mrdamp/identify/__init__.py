"""Identification of force laws from records: fits, one fit per command, the papers' comparison of laws."""

from __future__ import annotations

from mrdamp.identify.fit import (
    Fit,
    Problem,
    Progress,
    RecordError,
    compare_dependences,
    descend,
    error,
    identify,
    model_of,
    pooled,
    simulate,
)

__all__ = [
    "Fit",
    "Problem",
    "Progress",
    "RecordError",
    "compare_dependences",
    "descend",
    "error",
    "identify",
    "model_of",
    "pooled",
    "simulate",
]
