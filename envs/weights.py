"""Weights of a reward's parts: their range, and how they come from names and values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from mrdamp.errors import InputError, require_kind

_UNIT = 100.0  # of returns


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Base of weights, one a part and each at least 0, with an exponent above 0 to 20.

    A part is worth 100 times its weight times its mean over the episode, or its sum where it is one of `summed`: the
    structure that criteria are relative to has a return of -100 with weights of 1 in all, however long the load is.

    parts: the fields that are weights; each is in `info` as `reward_` and its name, and their sum is the reward.
    """

    current: float = 0.0
    power: float = 0.0
    exponent: float = 2.0

    parts: ClassVar[tuple[str, ...]]
    summed: ClassVar[tuple[str, ...]] = ("energy",)

    def __post_init__(self) -> None:
        for part in self.parts:
            if not 0 <= getattr(self, part) < math.inf:
                raise InputError(f"reward: weight {part} is {getattr(self, part)}; allowed: >= 0")
        if not 0 < self.exponent <= 20:
            raise InputError(f"reward: exponent is {self.exponent}; allowed: above 0 to 20")

    @property
    def signed(self) -> NDArray[np.float64]:
        """(parts,) sign and weight of each part: energy is a gain, all others are costs."""
        return np.array([(_UNIT if part == "energy" else -_UNIT) * getattr(self, part) for part in self.parts])

    @classmethod
    def of(cls, given: Self | Mapping[str, Any] | None) -> Self:
        """Weights as they are given, from names and values, or the default. Raises InputError."""
        require_kind(f"a {cls.__name__}, or numbers by name", (cls, Mapping), reward=given)
        return given if isinstance(given, cls) else cls.from_dict(given or {})  # type: ignore[arg-type]

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """From names and values, as in YAML. Raises InputError for an unknown one."""
        known = {f.name for f in fields(cls)}
        for name in data:
            if name not in known:
                raise InputError(f"reward: {name!r} is unknown; allowed: {', '.join(sorted(known))}")
        return replace(cls(), **data)


Of = TypeVar("Of", bound=Weights)


#: Fields of `info` about the damper; every reward has them last.
DAMPER = ("mean_power", "mean_current", "dissipated_energy")


class PartScore(Generic[Of]):
    """Base of the rewards of n rows. values (n, kept) are their whole state, the reference first, the
    load's periods last.

    NAMES: columns of `info`, the parts of the reward first.
    """

    NAMES: tuple[str, ...]
    kept: ClassVar[int]

    def __init__(self, weights: Of, n: int) -> None:
        self.weights = weights
        self.values = np.ones((n, self.kept))
        self._signed = weights.signed
        self._averaged = np.array([part not in weights.summed for part in weights.parts])
        # As plain numbers, and their sum as NumPy adds it, for a single row.
        self._signs: list[tuple[float, bool]] = list(
            zip(self._signed.tolist(), self._averaged.tolist(), strict=True)
        )
        self._parts = np.zeros(len(self._signs))

    def start(self, row: int, reference: Sequence[float] | NDArray[np.float64], periods: int) -> None:
        """Starts a row. reference: (3,) of its reward; periods: of control, that the load lasts."""
        self.values[row] = 0.0
        self.values[row, : len(reference)] = reference
        self.values[row, -1] = periods

    def _weights(self) -> NDArray[np.float64]:
        """(n, parts), of a control period."""
        return np.where(self._averaged, self._signed / self.values[:, -1:], self._signed)

    def _weighed(self, parts: Sequence[float]) -> list[float]:
        """The parts of a single row times its weights, in plain numbers."""
        periods = float(self.values[0, -1])
        return [p * (sign / periods if mean else sign) for p, (sign, mean) in zip(parts, self._signs, strict=True)]

    def _info(self) -> NDArray[np.float64]:
        """(n, names) to be filled."""
        return np.empty((len(self.values), len(self.NAMES)))
