"""Which fits get a cause added, and when a search need go no further."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from mrdamp.diagnosis.fits.beam import parents
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.fits.table import FitTable
from mrdamp.diagnosis.problem.residuals import Problem
from toy_rig import toy


def fit_of(cost: float, *causes: str) -> Fit:
    return cast(Fit, SimpleNamespace(cost=cost, hypothesis=SimpleNamespace(causes=causes)))


@pytest.mark.parametrize(
    ("fits", "chosen"),
    [
        ([(0.1, "a"), (0.3, "b"), (0.5, "c")], [0, 1]),  # what leaves five times as much
        ([(0.1, "a"), (0.11, "b"), (0.12, "c"), (0.13, "d")], [0, 1, 2]),
        ([(0.0101, "a"), (0.0125, "b"), (0.014, "c")], [0, 1]),  # within the noise floor's penalty
        ([(0.0101, "a"), (0.0101, "b"), (0.0101, "c")], [0, 1, 2]),
        ([], []),
    ],
)
def test_causes_are_added_to_fits_that_come_near_the_best(fits: list[Any], chosen: list[int]) -> None:
    ranked = [fit_of(*f) for f in fits]
    found = parents(ranked, 3, 0.01, 1e-4)
    assert [ranked.index(f) for f in found] == chosen


def test_each_set_of_causes_is_there_in_its_best_form_alone() -> None:
    ranked = [fit_of(*f) for f in ((0.1, "a"), (0.11, "a"), (0.12, "a", "b"), (0.2, "b"), (0.3, "b"))]
    table = cast(FitTable, SimpleNamespace(ranked=lambda free: ranked))
    assert [f.cost for f in FitTable.sets(table, True, 1)] == [0.1, 0.2]
    assert [f.cost for f in FitTable.sets(table, True, 1, lambda f: -f.cost)] == [0.3, 0.11]


@pytest.mark.parametrize(("established", "parent"), [("late", "late"), ("cubic", "cubic")])
def test_a_cause_that_channels_establish_is_extended_first_beside_a_wrong_law(established: str, parent: str) -> None:
    search = Search(Problem(toy({"cubic": 0.6, "late": 6.0, "outside": 0.3})), 1e-6)
    search.direct = {established: 100.0}
    search.extend(False, 1)
    assert search.inexact
    search.extend(False, 2, Limits(beam=1, additions=1))
    (pair,) = (f.hypothesis.causes for f in search.ranked(False) if len(f.hypothesis.causes) == 2)
    assert pair[0] == parent
