"""Shares of the gap by part of the chain and by regime."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.diagnosis.evidence.resample import Interval, interval

Shares = dict[str, float]
Intervals = dict[str, Interval]


def of_total(values: Mapping[str, float], nothing: float = 0.0) -> Shares:
    """Shares that add up to 1; each is `nothing` if the total is."""
    total = sum(values.values())
    return {name: v / total if total > 0 else nothing for name, v in values.items()}


def intervals(drawn: Sequence[Shares]) -> Intervals:
    """95 % intervals of shares in bootstrap draws; none without draws."""
    return {name: interval(np.array([row[name] for row in drawn])) for name in drawn[0]} if drawn else {}


@dataclass(frozen=True)
class Measured:
    """A part of the chain between measured channels.

    share: of the nominal simulator's gap, by substitution of measured signals at both ends; interval: 95 %.
    The shares of a chain add up to 1; a negative share compensates another part's error. part_by: the channel
    that would separate its stages, if there is one.
    """

    between: str
    stages: tuple[str, ...]
    share: float
    interval: tuple[float, float]
    part_by: str = ""


@dataclass(frozen=True)
class Regime:
    """A region of the records whose share of the gap exceeds its share of the samples."""

    what: str
    share_of_gap: float
    share_of_samples: float
