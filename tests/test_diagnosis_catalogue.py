"""The catalogue of a damper's effects, for records of any size and sampling."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.damper_effects import damper_terms
from mrdamp.diagnosis.hypotheses.outside import PLAIN, command_rivals, force_rivals, plain
from mrdamp.diagnosis.hypotheses.outside_storeys import storey_rivals
from mrdamp.diagnosis.hypotheses.terms import Sizes
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model import Model
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
