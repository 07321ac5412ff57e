"""Gain scheduling: weights of a policy that change with the size of a measurement, as that of a rough road."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mrdamp.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Schedule:
    """s from -1 to 1 over the logarithm of a signal's leaky peak (`Observer.peaks`), between low and high.

    signal: by name; low, high: its peaks at -1 and 1, in its unit. A policy's inputs h become [h, s h], so that a
    linear network has the weights w + s w'. Raises InputError.
    """

    signal: str
    low: float
    high: float

    def __post_init__(self) -> None:
        if not isinstance(self.signal, str) or not 0 < self.low < self.high < math.inf:
            raise InputError(
                f"schedule: {self.signal!r} from {self.low} to {self.high}; allowed: a signal, and 0 < low < high"
            )

    def share(self, peak: ArrayLike) -> Array:
        """s (...) for leaky peaks (...) of the signal."""
        least = np.maximum(np.asarray(peak, dtype=np.float64), self.low)
        return np.asarray(np.minimum(2 * np.log(least / self.low) / math.log(self.high / self.low) - 1, 1.0))

    def __call__(self, inputs: Array, peak: ArrayLike) -> Array:
        """(n, 2 k) of inputs (n, k) and peaks (n,)."""
        return np.concatenate([inputs, self.share(peak)[:, None] * inputs], axis=1)

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"signal": self.signal, "low": self.low, "high": self.high}

    @classmethod
    def from_dict(cls, data: Any) -> Schedule:
        """From `to_dict`. Raises InputError."""
        if not isinstance(data, Mapping) or set(data) != {"signal", "low", "high"}:
            raise InputError(f"schedule: {data!r}; allowed: signal, low and high")
        try:
            return cls(data["signal"], float(data["low"]), float(data["high"]))
        except (TypeError, ValueError) as error:
            raise InputError(f"schedule: {error}") from None
