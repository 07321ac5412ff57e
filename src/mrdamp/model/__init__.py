"""A damper as a model file, and the C++ chain that is its physics.

`damper` is the model file, `attributes` the table of its numbers, `core` the chain's runs, `native` the C interface
below them, `citations` the sources.
"""

from __future__ import annotations

from mrdamp.model.damper import (
    FLOOR_SENSOR_EFFECTS,
    STRUCTURE_EFFECTS,
    Effect,
    Model,
    damper_effects,
    effect_parameters,
    effects_from,
    floor_channels,
)

__all__ = [
    "FLOOR_SENSOR_EFFECTS",
    "STRUCTURE_EFFECTS",
    "Effect",
    "Model",
    "damper_effects",
    "effect_parameters",
    "effects_from",
    "floor_channels",
]
