"""Structures that carry a damper: shear frames and quarter cars (`lumped`), and stay cables (`cables`)."""

from __future__ import annotations

from mrdamp.structures.lumped import GRAVITY, FloatArray, ShearFrame, dyke1996

__all__ = ["GRAVITY", "FloatArray", "ShearFrame", "dyke1996"]
