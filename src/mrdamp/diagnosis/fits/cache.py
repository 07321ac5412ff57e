"""Completed fits and screenings of a search."""

from __future__ import annotations

from dataclasses import dataclass, field

from mrdamp.diagnosis.fits.beam import ScoreTest
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.model.core import Array


@dataclass
class Cache:
    """Fits and screenings with fixed or free nominal parameters; none is repeated.

    fits: by name and start. screens: by fit, its point and the terms. signatures: a term's change of the
    nominal simulator's residuals (samples,), by its name and start.
    """

    fits: dict[tuple[str, bytes], Fit] = field(default_factory=dict)
    screens: dict[tuple[str, bytes, tuple[str, ...]], list[ScoreTest]] = field(default_factory=dict)
    signatures: dict[tuple[str, int], Array] = field(default_factory=dict)

    def with_fixed_law(self) -> Cache:
        """Only entries with fixed nominal parameters: they do not depend on the range of free ones."""
        return Cache(
            {k: f for k, f in self.fits.items() if not f.hypothesis.nominal},
            {k: p for k, p in self.screens.items() if k[0].startswith("held")},
            self.signatures,
        )
