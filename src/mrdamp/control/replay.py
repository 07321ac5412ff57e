"""A command sequence that is known in advance, played whatever is measured."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from mrdamp.errors import InputError


class Replay:
    """A `Controller` of commands (n,), A or V, each held over a period (s), the last one from there on.

    Raises InputError.
    """

    def __init__(self, commands: ArrayLike, period: float, name: str = "replay") -> None:
        values = np.asarray(commands, dtype=np.float64)
        if values.ndim != 1 or not len(values) or not np.isfinite(values).all():
            raise InputError(f"controller {name}: commands have shape {values.shape}; allowed: (n,), finite")
        if not 0 < period < np.inf:
            raise InputError(f"controller {name}: period is {period}; allowed: > 0 s")
        self.name, self.period = name, period
        self._commands: list[float] = values.tolist()
        self.reset()

    def reset(self) -> None:
        self._calls = 0

    def command(self, t: float, y: Mapping[str, float]) -> float:
        self._calls += 1
        return self._commands[min(self._calls, len(self._commands)) - 1]
