"""What a study of proposed tests comes to: chances, intervals and kept rows, against figures worked out by hand."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pytest

from modules import TOOLS, loaded

study = loaded(TOOLS / "next_test_study.py")


def outcome(resolved: bool, margin: float, behind: float = 1.0) -> object:
    return study.Outcome("driver_lag" if resolved else "none", resolved, margin, behind)


def row(proposed: object, *others: object) -> object:
    return study.Row(
        "case_01", "driver_lag", "none", "6 s", ("driver_lag",), outcome(False, -5), proposed, others
    )


def test_the_chance_of_so_many_is_the_binomials() -> None:
    half = [np.array([0.5, 0.5])] * 4
    assert study.at_least(half, 3) == pytest.approx(5 / 16)
    assert study.at_least(half, 0) == pytest.approx(1.0)
    dice = [np.full(6, 1 / 6)] * 2  # places 0 to 5: a sum of 10 is two sixes
    assert study.at_least(dice, 10) == pytest.approx(1 / 36)


def test_the_table_counts_what_was_resolved_and_how_often_by_chance() -> None:
    good = row(
        outcome(True, 9.0, 4.0), outcome(False, 1.0, 1.0), outcome(True, 3.0, 2.0), outcome(False, -2.0, 1.0)
    )
    poor = row(
        outcome(False, -1.0, 1.0),
        outcome(True, 2.0, 2.0),
        outcome(False, -1.0, 2.0),
        outcome(False, -3.0, 1.0),
    )
    text = study.table([good, poor])
    assert "| driver_lag | none | resolved | 1 of 3 | 9.0, 1.0 | 4.00, 1.00 |" in text
    assert "| driver_lag | none | none | 1 of 3 | -1.0, -1.0 | 1.00, 2.00 |" in text
    assert "proposed: 1 of 2 resolved, 0.50" in text
    assert "random: 2 of 6 resolved, 0.33" in text
    # Of four tests of each case two and one settle it: 1 - (1/2) (3/4).
    assert f"p = {1 - 0.5 * 0.75:.2g}" in text
    assert "smaller margin: 4 of 6 (1 the same" in text
    assert "1.41 (" in text  # geometric mean of 4 and 1/2


def test_a_row_is_read_as_it_was_kept() -> None:
    made = row(outcome(True, 9.0), outcome(False, 1.0))
    assert study.Row.of(json.loads(json.dumps(asdict(made)))) == made  # type: ignore[call-overload]
