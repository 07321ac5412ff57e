"""A lesser cause beside one that explains most: what a fit leaves may be little, and yet more than noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mrdamp.diagnosis.fits.least_squares import Fit

if TYPE_CHECKING:
    from mrdamp.diagnosis.fits.beam import Promise
    from mrdamp.diagnosis.fits.search import Search

#: A cause is fitted where it promises this relative fall of what the fit leaves, and so many of them, the best first.
_PROMISE, _MOST = 0.2, 2


def others(search: Search, found: Fit) -> list[Promise]:
    """What every cause that a fit has not promises on top of it, best first."""
    return search.screen(found, search.beside(found.hypothesis.causes))


def try_lesser(search: Search, found: Fit) -> None:
    """Fits the most promising causes beside those of a fit, and keeps what is found."""
    seen: set[str] = set()
    for promise in others(search, found):
        if len(seen) == _MOST or promise.cost > (1 - _PROMISE) * found.cost:
            break
        if promise.term.cause not in seen:
            seen.add(promise.term.cause)
            hypothesis, start = search.start_from(found, promise.term, promise.start, promise.by)
            search.keep(search.fitted(hypothesis, start, most=8, stage=" beside"))
