"""A lesser cause beside one that explains most: what a fit leaves may be little, and yet more than noise."""

from __future__ import annotations

from mrdamp.diagnosis.fits.beam import Promise
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.screening import screen
from mrdamp.diagnosis.fits.table import FitTable

#: A cause is fitted where it promises this relative fall of what the fit leaves, and so many of them, the best first.
_PROMISE, _MOST = 0.2, 2


def others(table: FitTable, found: Fit) -> list[Promise]:
    """What every cause that a fit has not promises on top of it, best first."""
    return screen(table, found, table.beside(found.hypothesis.causes))


def try_lesser(table: FitTable, found: Fit) -> None:
    """Fits the most promising causes beside those of a fit, and keeps what is found."""
    seen: set[str] = set()
    for promise in others(table, found):
        if len(seen) == _MOST or promise.cost > (1 - _PROMISE) * found.cost:
            break
        if promise.term.cause not in seen:
            seen.add(promise.term.cause)
            hypothesis, start = table.start_from(found, promise.term, promise.start, promise.by)
            table.keep(table.fitted(hypothesis, start, most=8, stage=" beside"))
