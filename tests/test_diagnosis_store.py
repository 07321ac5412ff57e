"""What an interrupted diagnosis leaves: fits that are taken up where they stood, to the last bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.fits.least_squares import Fit, fit, taken_up
from mrdamp.diagnosis.fits.store import Kept, Store
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model import Model
from toy_rig import toy

LAW = {"c0a": 700.0, "c0b": 800.0, "fya": 70.0, "fyb": 620.0, "v_ref": 0.03}


def through_a_file(found: Fit, path: Path) -> Kept:
    case = Case("toy", path.parent, Model("bingham", LAW), toy({}).records, ())
    Store.of(path, case).put("fit", found.point, found.converged, found.at, found.iterations)
    kept = Store.of(path, case).get("fit")
    assert kept is not None
    return kept


@pytest.mark.parametrize("frozen", [False, True])
def test_a_fit_is_taken_up_to_the_last_bit(frozen: bool, tmp_path: Path) -> None:
    rig = toy({"gain": 3.1, "cubic": 0.3})
    hypothesis = Hypothesis(rig.nominal, tuple(t for t in rig.terms if t.effect == "cubic"))
    problem, start = Problem(rig), hypothesis.start()
    known = None
    if frozen:
        known = problem.jacobian(hypothesis, start, problem.residuals(hypothesis, start)[0], range(1))
    found = fit(problem, hypothesis, start, tolerance=0.5, known=known, frozen=frozen)
    point, converged, at, iterations = through_a_file(found, tmp_path / "fits.json")
    assert iterations == found.iterations > 0
    assert not np.array_equal(point, at)  # the last step set out from elsewhere
    fresh = problem.jacobian(hypothesis, found.point, found.residual)
    assert not np.array_equal(fresh, found.jacobian)
    again = taken_up(problem, hypothesis, point, at, known, converged=converged)
    assert (again.cost, again.converged) == (found.cost, found.converged)
    for name in ("point", "residual", "jacobian"):
        np.testing.assert_array_equal(getattr(again, name), getattr(found, name), err_msg=name)


def test_what_is_kept_is_of_the_same_case_or_none(tmp_path: Path) -> None:
    path = tmp_path / "fits.json"
    case = Case("toy", path.parent, Model("bingham", LAW), toy({}).records, ())
    Store.of(path, case).put("fit", np.array([1.0, 2.0]), True)
    kept = Store.of(path, case).get("fit")
    assert kept is not None
    np.testing.assert_array_equal(kept.at, kept.point)
    other = replace(case, model=Model("bingham", LAW | {"c0a": 701.0}))
    assert Store.of(path, other).get("fit") is None
    path.write_text(path.read_text()[:40])
    assert Store.of(path, case).get("fit") is None
