"""Causes of the damper: each effect of the catalogue in the rig's own forms, with at least two forms if
possible.

A form is a function of the case's scale. It draws its random parameters and returns the rig's parameters as a
function of one size, from 0 (neutral) to 1 (as strong as in a real rig). Names with `sensor.`, `command.`,
`reading.` and `rod.` belong to the bench (`bench.py`), all others to the rig (`rig.c`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from studies.blindtest import current_forms, fluid_forms, rod_forms, sensor_forms
from studies.blindtest.rig import Numbers
from studies.blindtest.scale import Form, Scale, Sized


@dataclass(frozen=True)
class Cause:
    """A cause by its label's name, and its stage."""

    label: str
    stage: str
    sized: Sized


#: Effect -> its stage and its forms, which are equally likely.
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
    """Parameters of several causes; no two causes share one."""
    out: dict[str, float] = {}
    for part in parts:
        if out.keys() & part.keys():
            raise ValueError(f"two causes set {sorted(out.keys() & part.keys())}")
        out |= part
    return out
