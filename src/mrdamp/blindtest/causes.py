"""Causes of the damper: each effect of the catalogue in the rig's own forms, at least two where that makes sense.

A form is a function of the scale of the case: it draws what is random about it and returns how its numbers follow
from one size, from 0 (neutral) to 1 (as strong as a rig would have it). Names with `sensor.`, `command.`,
`reading.` and `rod.` are the bench's (`bench.py`); all others are the rig's own (`rig.c`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mrdamp.blindtest import current_forms, fluid_forms, rod_forms, sensor_forms
from mrdamp.blindtest.rig import Numbers
from mrdamp.blindtest.scale import Form, Scale, Sized


@dataclass(frozen=True)
class Cause:
    """A cause as a label names it, with the stage that it sits in."""

    label: str
    stage: str
    sized: Sized


#: Effect -> its stage and its forms, each as likely as another.
EFFECTS: Mapping[str, tuple[str, tuple[Form, ...]]] = {
    **current_forms.EFFECTS,
    **fluid_forms.EFFECTS,
    **rod_forms.EFFECTS,
    **sensor_forms.EFFECTS,
}


def draw(rng: np.random.Generator, effect: str, scale: Scale) -> Cause:
    """An effect in one of its forms."""
    stage, forms = EFFECTS[effect]
    return Cause(effect, stage, forms[int(rng.integers(len(forms)))](rng, scale))


def merged(parts: list[Numbers]) -> dict[str, float]:
    """Numbers of several causes; none of them sets another's."""
    out: dict[str, float] = {}
    for part in parts:
        if out.keys() & part.keys():
            raise ValueError(f"two causes set {sorted(out.keys() & part.keys())}")
        out |= part
    return out
