"""Scale of a case, and forms whose parameters follow from one size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: Parameters of the truth for a size.
Sized = Callable[[float], dict[str, float]]


@dataclass(frozen=True)
class Scale:
    """Scales: RMS force (N), power (W), RMS stroke (m), acceleration (m/s2), largest command, and the mass of
    a piston behind a mount (kg), the least that the rig's step allows."""

    force: float
    power: float
    stroke: float
    acceleration: float
    command: float
    piston: float = 0.1


#: Draws the random parameters of a cause.
Form = Callable[[np.random.Generator, Scale], Sized]
