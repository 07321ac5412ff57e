"""The catalogue of effects, for records of any size and sampling, and which way its terms and numbers point."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.diagnosis.evidence.structure_numbers import deviations
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.damper_effects import damper_terms
from mrdamp.diagnosis.hypotheses.frame_effects import structure_coordinates
from mrdamp.diagnosis.hypotheses.outside import PLAIN, command_rivals, force_rivals, plain
from mrdamp.diagnosis.hypotheses.outside_storeys import storey_rivals
from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Sizes
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model import Model, core
from mrdamp.records import Record
from mrdamp.structures import dyke1996


@pytest.mark.parametrize("sample_time", [0.0002, 0.002, 0.005, 0.01, 0.05])
def test_every_effect_and_rival_has_starts_within_its_ranges_and_a_rival_has_words(
    sample_time: float,
) -> None:
    sizes = Sizes(800.0, 0.01, 0.1, 2.0, 2.0, 300.0, sample_time)
    terms = damper_terms(sizes)
    storeys = storey_rivals(dyke1996(), [2], np.full(3, 1e-3), np.full(3, 4e-3))
    assert all(plain(term).endswith("in storey 2") for term in storeys)
    rivals = (*command_rivals(sizes), *force_rivals(sizes))
    assert {term.cause for term in rivals} <= set(PLAIN)
    for term in (*terms, *rivals, *storeys):
        assert term.starts, term.name
        for start in term.starts:
            for c, value in zip(term.coordinates, start, strict=True):
                assert c.low <= value <= c.high, (term.name, c.name)
                assert c.low <= c.start <= c.high, (term.name, c.name)
    every = damper_terms(Sizes(800.0, 0.01, 0.1, 2.0, 2.0, 300.0, 0.001))
    assert {t.cause for t in terms} == {t.cause for t in every}


def test_resonances_beyond_what_is_sampled_are_left_out() -> None:
    names = [
        {t.name for t in damper_terms(Sizes(800.0, 0.01, 0.1, 2.0, 2.0, 300.0, dt))} for dt in (0.001, 0.01)
    ]
    assert names[0] - names[1] == {"moving_mass:in two clamps"}


@pytest.mark.parametrize(("wobble", "shown"), [(0.014, False), (0.2, True)])
def test_a_command_that_hardly_changes_shows_nothing_of_what_acts_while_it_changes(
    wobble: float, shown: bool
) -> None:
    t = np.arange(400) * 0.005
    model = Model("bingham", {"c0a": 500.0, "c0b": 0.0, "fya": 50.0, "fyb": 300.0, "v_ref": 0.005})
    records = []
    for k, level in enumerate((0.5, 1.0)):
        x = 0.01 * np.sin(2 * np.pi * t)
        u = level + wobble * np.cos(2 * np.pi * t)
        channels = {"displacement_m": x, "command": u, "force_N": 500 * np.gradient(x)}
        records.append(Record(f"{k}", None, 0.005, channels))
    search = Search(Problem(DamperRig(model, tuple(records))), 1e-6, Limits(base=0))
    effects = {term.effect for term in search.addable(())}
    assert {"seal_friction", "saturation", "channel_shift"} <= effects
    assert ({"driver_lag", "command_delay", "remanence"} <= effects) is shown
    assert shown or not {"driver_lag", "command_delay", "remanence"} & effects


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
