"""A second cause beside one that explains most: what a fit leaves may be little, and yet more than noise."""

from __future__ import annotations

from mrdamp.diagnosis.fits.beam import ScoreTest
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.screening import screen
from mrdamp.diagnosis.fits.table import FitTable

#: A cause is fitted where its score test predicts this relative fall of what the fit leaves; so many, best first.
_GAIN, _MOST = 0.2, 2


def others(table: FitTable, found: Fit) -> list[ScoreTest]:
    """Score tests of every cause that a fit has not, best first."""
    return screen(table, found, table.beside(found.hypothesis.causes))


def try_second_cause(table: FitTable, found: Fit) -> None:
    """Fits the causes with the largest predicted gain beside those of a fit, and keeps what is found."""
    tried: set[str] = set()
    for test in others(table, found):
        if len(tried) == _MOST or test.cost > (1 - _GAIN) * found.cost:
            break
        if test.term.cause not in tried:
            tried.add(test.term.cause)
            hypothesis, start = table.start_from(found, test.term, test.start, test.by)
            table.keep(table.fitted(hypothesis, start, most=8, stage=" beside"))
