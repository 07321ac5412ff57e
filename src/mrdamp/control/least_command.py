"""A least command for weak motion, where the damper's force without current is more than is ever wanted.

An MR damper that moves less than its yield displacement is a spring behind a dashpot, stiffer with the field on. A
wanted force below that without current commands nothing; the least command keeps the damper stiff there, and fades
out as the force grows, before it would add to it. At rest it costs current for nothing: `rise` takes it away there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mrdamp.control.base import Controller, sensor_name
from mrdamp.errors import InputError, require_positive


@dataclass(frozen=True)
class LeastCommand:
    """level up(peak) down(peak), peak being the leaky peak of the damper's |force| (`Observer.peaks`).

    up rises linearly from 0 without force to 1 at `rise`; down is 1 up to `full` and falls linearly to 0 at `fade`.
    level: A or V; fade, full, rise: N, 0 <= full < fade, 0 <= rise <= fade; rise 0: the whole level at rest. Raises
    InputError.
    """

    level: float
    fade: float
    full: float = 0.0
    rise: float = 0.0

    def __post_init__(self) -> None:
        require_positive("least command", level=self.level, fade=self.fade)
        if not 0 <= self.full < self.fade or not 0 <= self.rise <= self.fade:
            raise InputError(
                f"least command: full is {self.full}, rise is {self.rise}; allowed: 0 or more, full below fade "
                f"({self.fade:g}), rise not above it"
            )

    def __call__(self, peak: ArrayLike) -> NDArray[np.float64]:
        """Commands (...) for leaky peaks of the force (...), N."""
        size = np.asarray(peak, dtype=np.float64)
        down = np.clip((self.fade - size) / (self.fade - self.full), 0.0, 1.0)
        up = np.minimum(size / self.rise, 1.0) if self.rise else 1.0
        return np.asarray(self.level * up * down)

    def to_dict(self) -> dict[str, float]:
        """For JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> LeastCommand:
        """From `to_dict`. Raises InputError."""
        try:
            rest = (float(data.get(name, 0.0)) for name in ("full", "rise"))
            return cls(float(data["level"]), float(data["fade"]), *rest)
        except (TypeError, KeyError, ValueError) as error:
            raise InputError(f"least command: {error}") from None


class AtLeast:
    """A controller whose command is never below the least one of each damper's leaky peak of |force|.

    leak: s, of the peaks; dampers: how many. Attributes: inner; name; period, s.
    """

    def __init__(self, inner: Controller, least: LeastCommand, leak: float, dampers: int = 1) -> None:
        self.inner, self.name, self.period = inner, inner.name, inner.period
        self._least, self._fall = least, math.exp(-inner.period / leak)
        self._forces = [sensor_name("force", k) for k in range(dampers)]
        self.reset()

    def reset(self) -> None:
        self.inner.reset()
        self._peaks: Any = 0.0

    def command(self, t: float, y: Mapping[str, float]) -> Any:
        forces = np.array([y[name] for name in self._forces])
        self._peaks = np.maximum(np.abs(forces), self._fall * self._peaks)
        least = self._least(self._peaks)
        return np.maximum(self.inner.command(t, y), least if len(least) > 1 else least[0])
