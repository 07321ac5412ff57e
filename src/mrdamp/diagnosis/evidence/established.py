"""Evidence of sets of causes: what each predicts of left-out records.

A set of causes is compared with the nominal simulator and with every other fitted set. The model is a conditional logit
over all sets, with the nominal simulator as the alternative "no cause".

Source: McFadden (1974), Conditional logit analysis of qualitative choice behavior.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.diagnosis.constants import (
    CAUSE,
    EVIDENCE_GAIN,
    NUMBER,
    SECOND_CAUSE,
    TIED_BY_NATURE,
)
from mrdamp.model.core import Array

#: Lower limit of the cost ratio to the nominal simulator in the logarithm.
_LEAST = 1e-6


@dataclass(frozen=True)
class Standing:
    """Established causes and their probabilities.

    causes: the established ones, or those of the most probable set if none is. probability: of the least
    certain of them. fewer: of no cause (nominal simulator, or with free parameters). others: of the best set
    without any of the causes or those tied with them by nature.
    """

    causes: tuple[str, ...]
    probability: float
    fewer: float
    others: float


def utility(left: float, causes: int, numbers: int, *, penalty: float = 0.0) -> float:
    """Utility (nats) of a fit relative to the simulator without its causes.

    left: what the fit leaves of the left-out squares of that simulator (`fits.left_out.ratio`). causes, numbers: number
    of causes and of their parameters. penalty: nats against the fit.
    """
    gain = -EVIDENCE_GAIN * math.log(max(left, _LEAST))
    size = CAUSE * causes + SECOND_CAUSE * (causes > 1) + NUMBER * numbers
    return gain - size - penalty


def softmax(utilities: Sequence[float] | Array) -> Array:
    """Probabilities (n,) of alternatives from their utilities (nats)."""
    u = np.asarray(utilities, dtype=np.float64)
    weights = np.exp(u - u.max())
    return np.asarray(weights / weights.sum())


def standing(sets: Mapping[tuple[str, ...], float]) -> Standing | None:
    """Established causes, from the probabilities of the sets of causes; None if no set has a cause.

    sets: `()` is the nominal simulator, `("parameters",)` the one with free parameters. A cause is
    established if the sets with it, or with one tied with it by nature, have a total probability above one
    half. The most probable set decides between tied causes.
    """
    found = [s for s in sorted(sets, key=lambda s: (-sets[s], s)) if _causes(s)]
    if not found:
        return None
    marginal = {c: together(sets, c) for s in found for c in s}
    top = next((s for s in found if all(marginal[c] > 0.5 for c in s)), None)
    if top is None:
        best = next((s for s in found if any(marginal[c] > 0.5 for c in s)), found[0])
        top = tuple(c for c in best if marginal[c] > 0.5) or best
    fewer = sum(p for s, p in sets.items() if not _causes(s))
    others = max((p for s, p in sets.items() if _causes(s) and not any(_has(s, c) for c in top)), default=0.0)
    return Standing(top, min(marginal[c] for c in top), fewer, others)


def _causes(causes: Collection[str]) -> bool:
    return bool(causes) and set(causes) != {"parameters"}


def together(sets: Mapping[tuple[str, ...], float], cause: str) -> float:
    """Probability of a cause and of those that are tied with it by nature."""
    return sum(p for s, p in sets.items() if _has(s, cause))


def _has(causes: Collection[str], cause: str) -> bool:
    """True if a set contains a cause or one with the same signature in every test."""
    effect = cause.partition("@")[0]
    tied = {other for tie in TIED_BY_NATURE if effect in tie for other in tie}
    return any(c == cause or c.partition("@")[0] in tied for c in causes)
