"""Structures that carry a damper: shear frames (`frames`), stay cables (`cables`) and quarter cars (`cars`)."""

from __future__ import annotations

from mrdamp.structures.frames import GRAVITY, FloatArray, ShearFrame, dyke1996

__all__ = ["GRAVITY", "FloatArray", "ShearFrame", "dyke1996"]
