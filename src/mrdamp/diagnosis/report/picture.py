"""The picture of an answer."""

from __future__ import annotations

from matplotlib.figure import Figure

from mrdamp.diagnosis.report.result import Diagnosis
from mrdamp.pictures.diagnosis import chain


def chain_picture(found: Diagnosis) -> Figure:
    """The chain from command to sensor, with each stage's share of the correction, or of the gap."""
    of = "correction" if found.verdict == "effect" else "gap"
    return chain(found.where.stages, found.where.intervals, {e.stage for e in found.effects}, of)
