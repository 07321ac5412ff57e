"""A second cause in addition to one that explains most of the gap: the remainder may be small and still
exceed the noise."""

from __future__ import annotations

from mrdamp.diagnosis.fits.beam import ScoreTest
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.screening import screen
from mrdamp.diagnosis.fits.table import FitTable

#: Least predicted relative reduction of the remainder for a fit; number of causes fitted, best first.
_GAIN, _MOST = 0.2, 2


def others(table: FitTable, found: Fit) -> list[ScoreTest]:
    """Score tests of every cause that a fit does not contain, best first."""
    return screen(table, found, table.addable(found.hypothesis.causes))


def try_second_cause(table: FitTable, found: Fit) -> None:
    """Fits the causes with the largest predicted gain in addition to those of a fit, and keeps the results.
    """
    tried: set[str] = set()
    for test in others(table, found):
        if len(tried) == _MOST or test.cost > (1 - _GAIN) * found.cost:
            break
        if test.term.cause not in tried:
            tried.add(test.term.cause)
            hypothesis, start = table.start_from(found, test.term, test.start, test.by)
            table.keep(table.fitted(hypothesis, start, most=8, stage=" beside"))
