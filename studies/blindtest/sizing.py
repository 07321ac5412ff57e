"""Size of a cause: the one that gives the gap drawn for the case."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.errors import InputError
from studies.blindtest.rig import Array

_SKIP = 50  # samples at the start that are excluded from gaps
_SMALLEST, _STEPS = 0.004, 8
#: Least gap due to a cause, as a multiple of the noise, and largest gap due to a weak one.
_WEAK = (1.5, 3.0)
#: Label of a rig whose only difference is its own law.
OWN = "~own"


class Faint(InputError):
    """A case with a cause that is not visible."""


@dataclass(frozen=True)
class Task:
    """Content of a case.

    label: `none`, `parameters`, an effect, two joined by `+`, or `~` and a cause outside the catalogue; in a
    frame with `@` and its place. weak: a gap just above the noise. misfit: the rig's law is not the
    simulator's; the label `~own` is then a rig without another cause, and weak means below the law's own
    error.
    """

    name: str
    rig: str
    label: str
    weak: bool = False
    misfit: bool = False

    @property
    def parts(self) -> list[str]:
        """The causes of the label."""
        return [] if self.label in ("none", "parameters", OWN) else self.label.removeprefix("~").split("+")

    @property
    def mounted(self) -> bool:
        """True if the damper has a compliant mount."""
        return any(part in ("mount_compliance", "backlash") for part in self.parts)

    @property
    def outside(self) -> bool:
        """True if the cause is not in the catalogue."""
        return self.label.startswith("~") and self.label != OWN


def relative(simulated: Array, measured: Array) -> float:
    """RMS error over the RMS of the measurement."""
    error = (simulated - measured)[_SKIP:]
    return float(np.sqrt(np.mean(error**2) / np.mean(measured[_SKIP:] ** 2)))


def pooled(gaps: list[float]) -> float:
    """Root mean square of gaps."""
    return float(np.sqrt(np.mean(np.square(gaps))))


def total(gaps: list[float]) -> float:
    """Root of the sum of squared gaps: the gap of several tests and channels in the shared scorer."""
    return float(np.sqrt(np.sum(np.square(gaps))))


def goal(rng: np.random.Generator, *, weak: bool, noise: float) -> float:
    """Gap to be reached, relative to the RMS. noise: of the measurement, relative to the RMS."""
    low, high = (_WEAK[0] * noise, _WEAK[1] * noise) if weak else (max(0.05, 4 * noise), 0.3)
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


#: Names of causes -> (measured, residual) per test and channel, on a rig with only these causes.
Residuals = Callable[[Sequence[str]], list[tuple[Array, Array]]]


def gap_by_cause(causes: Sequence[str], residuals: Residuals) -> dict[str, float]:
    """Gap (relative to the RMS) due to each of a case's causes: the part of the residual that vanishes
    without it."""
    everything = residuals(causes)
    found = {}
    for name in causes:
        others = [other for other in causes if other != name]
        left = [rest for _, rest in residuals(others)] if others else [np.zeros(1)] * len(everything)
        pairs = zip(everything, left, strict=True)
        found[name] = pooled([relative(force - (error - rest), force) for (force, error), rest in pairs])
    return found


def must_show(shares: Mapping[str, float], noise: float) -> None:
    """Raises Faint if a cause's gap is below the least one. shares: gap of each cause, relative to the RMS.
    """
    for cause, share in shares.items():
        if share < _WEAK[0] * noise:
            raise Faint(f"{cause}: opens a gap of {share:.4f} at a noise of {noise:.4f}")


def size_for(gap: Callable[[float], float], target: float) -> float:
    """The size from 0.004 to 1 at which an increasing gap equals the wanted one within 15 %; a limit if it is
    out of reach."""
    low, high = (np.log(_SMALLEST), np.log(1e-6)), (0.0, np.log(gap(1.0)))
    if high[1] <= np.log(target):
        return 1.0
    size = -1.0
    for step in range(_STEPS):
        found = size, float(np.log(max(gap(float(np.exp(size))), 1e-6)))
        if abs(found[1] - np.log(target)) < 0.15:
            break
        low, high = (found, high) if found[1] < np.log(target) else (low, found)
        share = (np.log(target) - low[1]) / (high[1] - low[1]) if step % 2 == 0 and low[1] > -13 else 0.5
        size = low[0] + float(np.clip(share, 0.1, 0.9)) * (high[0] - low[0])
    return float(np.exp(size))
