"""A least command for weak motion, where the damper's force without current is more than is ever wanted.

An MR damper that moves less than its yield displacement is a spring behind a dashpot, stiffer with the field on. A
wanted force below that without current commands nothing; the least command keeps the damper stiff there, and fades
out as the force grows, before it would add to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mrdamp.errors import InputError, require_positive


@dataclass(frozen=True)
class LeastCommand:
    """level max(0, 1 - peak / fade), peak being the leaky peak of the damper's |force| (`Observer.peaks`).

    level: A or V, at rest; fade: N. Raises InputError.
    """

    level: float
    fade: float

    def __post_init__(self) -> None:
        require_positive("least command", level=self.level, fade=self.fade)

    def __call__(self, peak: ArrayLike) -> NDArray[np.float64]:
        """Commands (...) for leaky peaks of the force (...), N."""
        return np.asarray(self.level * np.maximum(0.0, 1.0 - np.asarray(peak, dtype=np.float64) / self.fade))

    def to_dict(self) -> dict[str, float]:
        """For JSON."""
        return {"level": self.level, "fade": self.fade}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> LeastCommand:
        """From `to_dict`. Raises InputError."""
        try:
            return cls(float(data["level"]), float(data["fade"]))
        except (TypeError, KeyError, ValueError) as error:
            raise InputError(f"least command: {error}") from None
