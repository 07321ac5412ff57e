"""A state estimator for tests of what comes after the estimate."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Known:
    """An estimator that knows the state."""

    def __init__(self, state: Array) -> None:
        self.state = state

    def reset(self) -> None:
        """Nothing to forget."""

    def __call__(self, y: Mapping[str, float]) -> Array:
        return self.state
