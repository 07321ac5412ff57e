"""What holds for every law and every effect of the C table, a new one included.

The sizes are those of a damper of 800 N with a stroke of 10 mm. A law is taken where a fit of it would begin, an effect
at each start of its forms in the catalogue of a diagnosis.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from dampers import rms
from excitation import Array, multisine, wave
from mrdamp.diagnosis.hypotheses.damper_effects import damper_terms
from mrdamp.diagnosis.hypotheses.terms import STAGES, Sizes, Term
from mrdamp.identify.laws import Scales, parametric, space
from mrdamp.model import Effect, Model, core, effects_from
from mrdamp.model.attributes import attributes, effects, law_row
from mrdamp.model.citations import references

FORCE, STROKE, VELOCITY, COMMAND = 800.0, 0.01, 0.1, 1.5
SCALES = Scales(FORCE, VELOCITY, STROKE, COMMAND)
TERMS = damper_terms(Sizes(FORCE, STROKE, VELOCITY, 2.0, COMMAND, 300.0, 0.001))
DT = 1e-3  # s
COLUMNS = ("force", "current", "field", "temperature")
MOTION, LEVEL = multisine(0.6 * STROKE, 0.4, 4.0, seed=3), wave(0.1 * COMMAND, COMMAND, 1.1)


@cache
def damper(law: str) -> dict[str, float]:
    of = space(law, SCALES)
    return of.attributes(of.start)


@cache
def sampled(dt: float, end: float = 2.0) -> tuple[Array, Array, Array, Array]:
    """x (m), v (m/s), a (m/s2) and the command, (n,) each."""
    t = np.arange(round(end / dt) + 1, dtype=np.float64) * dt
    return (*MOTION.sample(t), LEVEL.sample(t))


def run(law: str, settings: dict[str, float], dt: float = DT) -> dict[str, Array]:
    x, v, a, u = sampled(dt)
    return core.run(law, damper(law) | settings, dt, x, v, a, u, columns=COLUMNS)


def settings_of(term: Term, start: tuple[float, ...]) -> dict[str, float]:
    names = (c.name for c in term.coordinates)
    return dict(term.fixed) | dict(zip(names, start, strict=True))


@pytest.mark.parametrize("law", core.laws())
def test_a_law_has_a_source_and_equations(law: str) -> None:
    assert references()[law]
    assert all(source.title and source.authors and 1900 < source.year < 2100 for source in references()[law])
    assert "`" in law_row(law, "equations")


@pytest.mark.parametrize("law", parametric())
def test_the_search_of_a_law_is_of_its_parameters(law: str) -> None:
    """They are all found, none twice, and a point of the search is that of the damper made of it."""
    of = space(law, SCALES)
    assert set(damper(law)) >= set(core.law_parameters(law)) - {"x0"}
    assert set(damper(law)) <= {*core.law_parameters(law), *core.law_options(law)}
    for share in (0.2, 0.5, 0.9):
        point = np.full(len(of.coordinates), share)
        np.testing.assert_allclose(of.point(of.attributes(point)), point, atol=1e-9)
        core.vector(law, of.attributes(point))


@pytest.mark.parametrize("law", parametric())
def test_a_law_takes_energy_and_a_finer_step_changes_nothing(law: str) -> None:
    """Over the whole motion it cannot give back more than it took; 1 % is what the documentation says of a step."""
    _, v, _, _ = sampled(DT)
    force = run(law, {})["force"]
    work = np.cumsum(force * v) * DT
    assert work[-1] > 0
    fine = run(law, {"substep": 2e-5}, DT / 8)["force"][::8]
    assert rms(force - fine) < 0.01 * rms(fine)


@pytest.mark.parametrize("law", parametric())
def test_a_pack_of_dampers_has_the_bits_of_each_alone(law: str) -> None:
    x, v, a, u = sampled(DT, 0.3)
    for term in (None, *(next(t for t in TERMS if t.effect == name) for name in effects())):
        settings = settings_of(term, term.starts[0]) if term else {}
        sets = np.array([core.vector(law, damper(law) | settings)] * 9)
        sets[:, core.attribute_index()["c0a"]] *= np.linspace(1.0, 1.5, 9)
        one, most = (core.run_many(law, sets, DT, x, u, v=v, a=a, lanes=lanes) for lanes in (1, 0))
        np.testing.assert_array_equal(one, most, err_msg=term.name if term else law)


@pytest.mark.parametrize("name", effects())
def test_an_effect_is_of_a_stage_and_in_the_catalogue(name: str) -> None:
    row = effects()[name]
    assert row.stage in STAGES
    assert len(row.words.split()) > 2
    assert row.equations
    terms = [term for term in TERMS if term.effect == name]
    assert terms
    assert {term.stage for term in terms} == {row.stage}
    ranges = {row.name: row for row in attributes() if row.group == name}
    for c in (c for term in terms for c in term.coordinates):
        assert ranges[c.name].minimum <= c.low < c.high <= ranges[c.name].maximum, c.name


@pytest.mark.parametrize("law", ["bingham", "modified_bouc_wen"])
@pytest.mark.parametrize("term", [term for term in TERMS if term.effect in effects()], ids=lambda term: term.name)
def test_each_form_shows_and_a_finer_step_does_not(law: str, term: Term) -> None:
    """Some start of a form changes the force by a thousandth; a quarter of the step changes it by 3 % at most."""
    plain, shown = run(law, {})["force"], []
    for start in term.starts:
        settings = settings_of(term, start)
        force = run(law, settings)["force"]
        shown.append(rms(force - plain) / rms(plain))
        fine = run(law, settings | {"substep": 1e-4}, DT / 4)["force"][::4]
        assert rms(force - fine) < 0.03 * rms(fine), start
    assert max(shown) > 1e-3


@pytest.mark.parametrize("name", effects())
def test_a_model_file_keeps_an_effect(name: str) -> None:
    term = next(t for t in TERMS if t.effect == name)
    settings = settings_of(term, term.starts[0])
    model = Model("bingham", damper("bingham"), effects_from(settings))
    assert [effect.name for effect in model.effects] == [name]
    again = Model.from_dict(model.to_dict())
    assert again.attributes == damper("bingham") | settings
    assert isinstance(again.effects[0], Effect)
