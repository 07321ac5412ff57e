"""Weights of a reward's parts: their range, and how they come from names and values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from mrdamp.errors import InputError


class Weights:
    """Base of a frozen dataclass of weights, one a part and each at least 0, with an exponent above 0 to 20.

    parts: the fields that are weights; each is in `info` as `reward_` and its name, and their sum is the reward.
    """

    parts: ClassVar[tuple[str, ...]]
    exponent: float

    def __post_init__(self) -> None:
        for part in self.parts:
            if not 0 <= getattr(self, part) < math.inf:
                raise InputError(f"reward: weight {part} is {getattr(self, part)}; allowed: >= 0")
        if not 0 < self.exponent <= 20:
            raise InputError(f"reward: exponent is {self.exponent}; allowed: above 0 to 20")

    @property
    def signed(self) -> NDArray[np.float64]:
        """(parts,) what each part is taken times: energy is a gain, all else costs."""
        return np.array([(1.0 if part == "energy" else -1.0) * getattr(self, part) for part in self.parts])

    @classmethod
    def of(cls, given: Self | Mapping[str, Any] | None) -> Self:
        """Weights as they are given, from names and values, or the default. Raises InputError."""
        return given if isinstance(given, cls) else cls.from_dict(given or {})  # type: ignore[arg-type]

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """From names and values, as in YAML. Raises InputError for an unknown one."""
        known = {f.name for f in fields(cls)}  # type: ignore[arg-type]
        for name in data:
            if name not in known:
                raise InputError(f"reward: {name!r} is unknown; allowed: {', '.join(sorted(known))}")
        return replace(cls(), **data)  # type: ignore[type-var]
