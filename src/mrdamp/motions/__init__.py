"""Ground motions: recorded ones from CSV and PEER files, artificial ones of a Kanai-Tajimi spectrum."""

from __future__ import annotations

from mrdamp.motions.motion import TIME_SCALE, GroundMotion, embedded_motion, kanai_tajimi, read_motion

__all__ = ["TIME_SCALE", "GroundMotion", "embedded_motion", "kanai_tajimi", "read_motion"]
