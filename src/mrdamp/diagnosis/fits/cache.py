"""What a search has done already."""

from __future__ import annotations

from dataclasses import dataclass, field

from mrdamp.diagnosis.fits.beam import ScoreTest
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.model.core import Array


@dataclass
class Cache:
    """What was fitted and screened with the nominal parameters held or free, so that nothing is done twice.

    fits: by name and start; screens: by fit, its point and the terms; signatures: what a term changes in the nominal
    simulator's residuals (samples,), by its name and start.
    """

    fits: dict[tuple[str, bytes], Fit] = field(default_factory=dict)
    screens: dict[tuple[str, bytes, tuple[str, ...]], list[ScoreTest]] = field(default_factory=dict)
    signatures: dict[tuple[str, int], Array] = field(default_factory=dict)

    def held(self) -> Cache:
        """Only what had the nominal parameters held, which is the same whatever numbers those have."""
        return Cache(
            {k: f for k, f in self.fits.items() if not f.hypothesis.nominal},
            {k: p for k, p in self.screens.items() if k[0].startswith("held")},
            self.signatures,
        )
