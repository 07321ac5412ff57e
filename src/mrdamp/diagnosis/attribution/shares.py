"""Shares of the gap by part of the chain and by regime."""

from __future__ import annotations

from dataclasses import dataclass


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
