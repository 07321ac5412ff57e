"""Structures that carry a damper: shear frames and quarter cars (`frames`), and stay cables (`cables`)."""

from __future__ import annotations

from mrdamp.structures.frames import GRAVITY, FloatArray, ShearFrame, dyke1996

__all__ = ["GRAVITY", "FloatArray", "ShearFrame", "dyke1996"]
