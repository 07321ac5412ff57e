"""Which way the diagnosis' terms and numbers point: strokes of trapped gas, what all of a frame's numbers share."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.diagnosis.evidence.structure_numbers import deviations
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.hypotheses.damper_effects import damper_terms
from mrdamp.diagnosis.hypotheses.frame_effects import structure_coordinates
from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Sizes
from mrdamp.model import core
from mrdamp.structures import dyke1996

SIZES = Sizes(500.0, 0.01, 0.1, 2.0, 2.0, 50.0, 2e-3)
BINGHAM = {"c0a": 500.0, "c0b": 0.0, "fya": 100.0, "fyb": 0.0, "v_ref": 1e-3}


@pytest.mark.parametrize(("form", "weak"), [("extension", {1}), ("compression", {-1})])
def test_trapped_gas_takes_force_off_the_strokes_of_its_name(form: str, weak: set[int]) -> None:
    """After a turn the force comes back over 2 mm: less of it in extension (positive), compression, or both."""
    (term,) = (t for t in damper_terms(SIZES) if t.effect == "trapped_gas" and t.form == form)
    gas = {"trapped_gas_d": 0.5, "trapped_gas_s_g": 2e-3, **term.fixed}
    t = np.arange(2000) * 1e-3
    x, v = 0.01 * np.sin(2 * np.pi * t), 0.02 * np.pi * np.cos(2 * np.pi * t)
    with_gas, without = (
        core.run("bingham", p, 1e-3, x, v, u=np.zeros_like(t), columns=("force",))["force"]
        for p in (BINGHAM | gas, BINGHAM)
    )
    lost = 1 - with_gas / without
    later = t > 0.3  # after the first turn
    moving = np.abs(v) > 1e-3
    found = {sign for sign in (-1, 1) if lost[later & moving & (np.sign(v) == sign)].max() > 0.4}
    assert found == weak
    assert lost[later & moving].min() > -1e-9


@pytest.mark.parametrize("shared", [0.0, 0.2, -0.3])
def test_what_all_masses_and_stiffnesses_share_is_no_deviation(shared: float) -> None:
    """A frame heavier and stiffer by one factor moves as before; the storey that differs beside it is left."""
    nominal = structure_coordinates(dyke1996())
    wanted = np.array([0.0 if c.name.startswith("damping") else shared for c in nominal])
    odd = next(k for k, c in enumerate(nominal) if c.name == "stiffness@2")
    wanted[odd] += np.log(0.8)
    point = np.array([c.point(c.start * np.exp(x)) for c, x in zip(nominal, wanted, strict=True)])
    n = len(nominal)
    found = deviations(Fit(Hypothesis(nominal), point, 1e-3, np.zeros(n), np.eye(n)))
    expected = np.zeros(n)
    expected[odd] = np.log(0.8)
    assert found.names == tuple(c.name for c in nominal)
    np.testing.assert_allclose(found.values, expected, atol=1e-12)
