"""Whether a cause is established where the law itself is not the rig's.

No simulator meets the noise then, and what a cause leaves says little. What counts is how much more evidence it has
than doing without it, and than any other cause has in its place.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from mrdamp.diagnosis.constants import ESTABLISHED, TIED_BY_NATURE

#: Log odds beyond which a comparison counts as decided: over fewer causes, and over other ones, which may be none.
_MOST, _MOST_OTHERS = 12.0, 6.0


@dataclass(frozen=True)
class Standing:
    """How a set of causes stands beside its rivals: log odds (nats) over doing with less (fewer of its causes, or none
    with the nominal numbers as they are, or free), and over the best set with another cause in the place of one of its;
    probability: that it is established."""

    causes: tuple[str, ...]
    over_fewer: float
    over_others: float
    probability: float


def standing(known: Mapping[tuple[str, ...], float]) -> Standing | None:
    """Of the most probable set that is established, or of the most probable one where none is; None without any cause.

    known: probability by set of causes, `()` and `("parameters",)` among them, largest first.
    """
    found = [_of_set(causes, known) for causes in known if causes not in ((), ("parameters",))]
    return next((s for s in found if s.probability > 0.5), found[0] if found else None)


def _of_set(causes: tuple[str, ...], known: Mapping[tuple[str, ...], float]) -> Standing:
    own = set(causes)
    fewer = [p for other, p in known.items() if other == ("parameters",) or set(other) < own]
    others = [p for other, p in known.items() if _instead(own, set(other))]
    over_fewer = _log_odds(known[causes], max(fewer, default=0.0))
    over_others = min(_log_odds(known[causes], max(others, default=0.0)), _MOST_OTHERS)
    constant, per_fewer, per_other = ESTABLISHED
    logit = constant + per_fewer * over_fewer + per_other * over_others
    return Standing(causes, over_fewer, over_others, 1 / (1 + math.exp(-logit)))


def _instead(own: set[str], other: set[str]) -> bool:
    """True where a set has other causes in place of one of the set's own; one tied with it by nature does not count."""
    if other in (set(), {"parameters"}) or own <= other:
        return False
    lacking, added = own - other, other - own
    effects = {c.partition("@")[0] for c in lacking | added}
    return bool(added) and not any(effects <= tie for tie in TIED_BY_NATURE)


def _log_odds(one: float, other: float) -> float:
    return min(math.log(max(one, 1e-30)) - math.log(max(other, 1e-30)), _MOST)
