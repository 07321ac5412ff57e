"""Whether a cause is established where the law itself is not the rig's.

No simulator meets the noise then, and what a cause leaves says little. What counts is how much better a set of causes
predicts records left out of its fit than the nominal simulator does, and than every other set: a conditional logit over
all sets that were fitted, with the nominal simulator as the answer "none of these".

Source of the model: McFadden (1974), Conditional logit analysis of qualitative choice behavior.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.diagnosis.constants import (
    LOGIT_CAUSE,
    LOGIT_GAIN,
    LOGIT_LAW,
    LOGIT_NUMBER,
    LOGIT_SECOND,
    TIED_BY_NATURE,
)
from mrdamp.model.core import Array

#: Of what the nominal simulator leaves; a fit that leaves less counts as this.
_LEAST = 1e-6


@dataclass(frozen=True)
class Standing:
    """causes: those established, or of the most probable set where none is; probability: that the least certain of them
    is at work; fewer: of no cause (the nominal simulator, or its numbers freed); others: of the best set without any of
    the causes (or one tied with them by nature)."""

    causes: tuple[str, ...]
    probability: float
    fewer: float
    others: float


def utility(left: float, causes: int, numbers: int, *, free: bool, penalty: float = 0.0) -> float:
    """Nats for a fit over the nominal simulator.

    left: cost on records left out of the fit, over the nominal simulator's; causes, numbers: of its effects, how many;
    free: the law's numbers are free; penalty: nats against it.
    """
    gain = -LOGIT_GAIN * math.log(max(left, _LEAST))
    price = LOGIT_CAUSE * causes + LOGIT_SECOND * (causes > 1) + LOGIT_NUMBER * numbers + LOGIT_LAW * free
    return gain - price - penalty


def softmax(utilities: Sequence[float] | Array) -> Array:
    """Probabilities (n,) of alternatives by their utilities (nats)."""
    u = np.asarray(utilities, dtype=np.float64)
    weights = np.exp(u - u.max())
    return np.asarray(weights / weights.sum())


def standing(sets: Mapping[tuple[str, ...], float]) -> Standing | None:
    """What is established, by the probabilities of the sets of causes (`()`: the nominal simulator, `("parameters",)`:
    its numbers freed); None where no set has a cause.

    A cause is established where the sets that have it, or one tied with it by nature, are together more probable than
    not; the most probable set says which of those that are tied it is.
    """
    found = [s for s in sorted(sets, key=lambda s: (-sets[s], s)) if _causes(s)]
    if not found:
        return None
    marginal = {c: _probability(sets, c) for s in found for c in s}
    top = next((s for s in found if all(marginal[c] > 0.5 for c in s)), None)
    if top is None:
        best = next((s for s in found if any(marginal[c] > 0.5 for c in s)), found[0])
        top = tuple(c for c in best if marginal[c] > 0.5) or best
    fewer = sum(p for s, p in sets.items() if not _causes(s))
    others = max((p for s, p in sets.items() if _causes(s) and not any(_has(s, c) for c in top)), default=0.0)
    return Standing(top, min(marginal[c] for c in top), fewer, others)


def _causes(causes: Collection[str]) -> bool:
    return bool(causes) and set(causes) != {"parameters"}


def _probability(sets: Mapping[tuple[str, ...], float], cause: str) -> float:
    return sum(p for s, p in sets.items() if _has(s, cause))


def _has(causes: Collection[str], cause: str) -> bool:
    """True where a set has a cause, or one that changes a record alike whatever is tested."""
    effect = cause.partition("@")[0]
    tied = {other for tie in TIED_BY_NATURE if effect in tie for other in tie}
    return any(c == cause or c.partition("@")[0] in tied for c in causes)
