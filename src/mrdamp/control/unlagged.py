"""The force before the lag of its sensor."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from mrdamp.errors import InputError


class Unlagged:
    """Measurements whose forces, held over the control period, give the readings of their sensors.

    Exact for such a force and a first-order lag. period, sensor_lag: s; with no lag the measurements are left as they
    are. Raises InputError.
    """

    def __init__(self, period: float, sensor_lag: float) -> None:
        if not 0 <= sensor_lag < math.inf:
            raise InputError(f"a force sensor's lag is {sensor_lag}; allowed: a number >= 0, s")
        self._kept = math.exp(-period / sensor_lag) if sensor_lag > 0 else 0.0
        self.reset()

    def reset(self) -> None:
        self._forces: Mapping[str, float] = {}

    def __call__(self, y: Mapping[str, float]) -> Mapping[str, float]:
        forces = {name: value for name, value in y.items() if re.fullmatch(r"force(_\d+)?", name)} if self._kept else {}
        if not forces:
            return y
        before = self._forces or forces
        self._forces = forces
        return {**y, **{name: (f - self._kept * before[name]) / (1.0 - self._kept) for name, f in forces.items()}}
