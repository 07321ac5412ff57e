"""The catalogue of a damper's effects, for records of any size and sampling."""

from __future__ import annotations

import pytest

from mrdamp.diagnosis.hypotheses.damper_effects import damper_terms
from mrdamp.diagnosis.hypotheses.terms import Sizes


@pytest.mark.parametrize("sample_time", [0.0002, 0.002, 0.005, 0.01, 0.05])
def test_every_effect_has_starts_within_its_ranges(sample_time: float) -> None:
    sizes = Sizes(800.0, 0.01, 0.1, 2.0, 2.0, 300.0, sample_time)
    terms = damper_terms(sizes)
    for term in terms:
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
