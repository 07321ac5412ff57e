"""How strong a cause is made: the size at which it opens the gap that was drawn for the case."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.blindtest.rig import Array
from mrdamp.errors import InputError

_SKIP = 50  # samples at the start that no gap counts
_SMALLEST, _STEPS = 0.004, 8
#: The least gap that a cause may open, in parts of the noise, and the most that a weak one is to open.
_WEAK = (1.5, 3.0)
#: Label of a rig that has nothing but a law of its own.
OWN = "~own"


class Faint(InputError):
    """A case with a cause that does not show."""


@dataclass(frozen=True)
class Task:
    """What a case is about.

    label: `none`, `parameters`, an effect, two joined by `+`, or `~` and a cause outside the catalogue; in a frame
    with `@` and its place. weak: a gap just above the noise. misfit: the rig's law is not the simulator's; then the
    label `~own` is a rig with nothing else, and weak is below what the law itself leaves.
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
        """The damper hangs on something that gives way."""
        return any(part in ("mount_compliance", "backlash") for part in self.parts)

    @property
    def outside(self) -> bool:
        """The cause is not in the catalogue."""
        return self.label.startswith("~") and self.label != OWN


def relative(simulated: Array, measured: Array) -> float:
    """RMS error over the RMS of the measurement."""
    error = (simulated - measured)[_SKIP:]
    return float(np.sqrt(np.mean(error**2) / np.mean(measured[_SKIP:] ** 2)))


def pooled(gaps: list[float]) -> float:
    """Root mean square of gaps."""
    return float(np.sqrt(np.mean(np.square(gaps))))


def total(gaps: list[float]) -> float:
    """Root of the sum of squares of gaps: what the shared scorer calls the gap of several tests and channels."""
    return float(np.sqrt(np.sum(np.square(gaps))))


def goal(rng: np.random.Generator, *, weak: bool, noise: float) -> float:
    """The gap to open, of the RMS; `noise`: that of the measurement, of the RMS too."""
    low, high = (_WEAK[0] * noise, _WEAK[1] * noise) if weak else (max(0.05, 4 * noise), 0.3)
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


#: Names of causes -> (measured, residual) per test and channel, on a rig with these causes only.
Residuals = Callable[[Sequence[str]], list[tuple[Array, Array]]]


def shares_shown(causes: Sequence[str], residuals: Residuals) -> dict[str, float]:
    """Gap (of the RMS) due to each of a case's causes: the part of the residual that vanishes without that cause."""
    everything = residuals(causes)
    found = {}
    for name in causes:
        others = [other for other in causes if other != name]
        left = [rest for _, rest in residuals(others)] if others else [np.zeros(1)] * len(everything)
        pairs = zip(everything, left, strict=True)
        found[name] = pooled([relative(force - (error - rest), force) for (force, error), rest in pairs])
    return found


def must_show(shares: Mapping[str, float], noise: float) -> None:
    """shares: the gap that each cause opens, of the RMS; Faint where one is less than a weak cause is to open."""
    for cause, share in shares.items():
        if share < _WEAK[0] * noise:
            raise Faint(f"{cause}: opens a gap of {share:.4f} at a noise of {noise:.4f}")


def size_for(gap: Callable[[float], float], wanted: float) -> float:
    """The size from 0.004 to 1 at which a growing gap is the wanted one to 15 %; an end where it is out of reach."""
    low, high = (np.log(_SMALLEST), np.log(1e-6)), (0.0, np.log(gap(1.0)))
    if high[1] <= np.log(wanted):
        return 1.0
    size = -1.0
    for step in range(_STEPS):
        found = size, float(np.log(max(gap(float(np.exp(size))), 1e-6)))
        if abs(found[1] - np.log(wanted)) < 0.15:
            break
        low, high = (found, high) if found[1] < np.log(wanted) else (low, found)
        share = (np.log(wanted) - low[1]) / (high[1] - low[1]) if step % 2 == 0 and low[1] > -13 else 0.5
        size = low[0] + float(np.clip(share, 0.1, 0.9)) * (high[0] - low[0])
    return float(np.exp(size))
