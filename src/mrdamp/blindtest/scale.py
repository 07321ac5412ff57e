"""What a cause's form is made of: the scale of the case that it is drawn for, and numbers that follow from one size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: Numbers of the truth for a size.
Sized = Callable[[float], dict[str, float]]


@dataclass(frozen=True)
class Scale:
    """What sizes are measured by: RMS force (N), power (W), RMS stroke (m), acceleration (m/s2), largest command, and
    the mass of a piston behind a mount (kg), as light as the steps of the rig allow."""

    force: float
    power: float
    stroke: float
    acceleration: float
    command: float
    piston: float = 0.1


#: Draws what is random about a cause.
Form = Callable[[np.random.Generator, Scale], Sized]
