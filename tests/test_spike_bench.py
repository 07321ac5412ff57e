"""The bench of measured records with injected effects: cases with none, one and two effects."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from modules import TOOLS, loaded
from mrdamp.identify import identify
from mrdamp.model import Model
from mrdamp.records import RecordSet, embedded

bench = loaded(TOOLS / "spike_bench.py")


@cache
def records() -> RecordSet:
    found: RecordSet = bench.records_of("embedded")
    return RecordSet("embedded", found.train[:4], found.validation[:2])


@cache
def simulator() -> Model:
    return identify("bouc_wen", embedded().train[:4], dependence="linear", starts=1, threads=1).model


@cache
def made(*effects: str) -> Any:
    found = bench.make("embedded", effects, simulator(), records(), "all", np.random.default_rng(3))
    assert found is not None
    return found


def mass_ratio(case: Any) -> float:
    """Mass by a regression of the added force on the acceleration, over the one put in; below 1 by the displacement's
    noise."""
    own = records().train[0]
    acceleration = np.gradient(np.gradient(own.displacement)) / own.sample_time**2
    added = np.asarray(case.records[0].channel("force_N")) / case.label["size"].get("g", 1.0) - own.channel("force_N")
    return float(np.polyfit(acceleration[50:-50], added[50:-50], 1)[0]) / float(case.label["size"]["m"])


def test_a_control_has_the_records_themselves() -> None:
    case = made()
    assert case.label["label"] == "~own"
    assert case.label["gap"] == case.label["base"]
    for own, other in zip(records().train, case.records, strict=True):
        assert np.array_equal(own.channel("force_N"), other.channel("force_N"))


def test_a_sensors_effect_is_put_in_after_a_force_on_the_rod() -> None:
    """In the other order the mass would be smaller by the gain."""
    one, two = made("moving_mass"), made("sensor_gain", "moving_mass")
    assert (one.label["label"], two.label["label"]) == ("moving_mass", "sensor_gain+moving_mass")
    assert (one.label["stages"], two.label["stages"]) == (["mechanics"], ["mechanics", "sensor"])
    for case in (one, two):
        assert case.label["gap"] > bench.SHOWN * case.label["base"]
    assert abs(np.log(two.label["size"]["g"])) > 0.1
    assert mass_ratio(one) == pytest.approx(0.85, abs=0.05)
    assert mass_ratio(two) == pytest.approx(mass_ratio(one), rel=0.03)


@pytest.mark.slow
def test_a_bent_simulator_was_identified_with_the_effect() -> None:
    """It is nearer to the records with the effect than the one from before."""
    effects = ("moving_mass",)
    bent = bench.make("embedded", effects, simulator(), records(), "all", np.random.default_rng(3), bent=True)
    assert bent is not None
    assert bent.label["size"] == made(*effects).label["size"]
    assert bent.label["gap"] > bench.SHOWN * bent.label["base"]
    before, after = (bench.test_gap(m, bent.records) for m in (simulator(), bent.model))
    assert after < 0.9 * before


def test_pairs_have_effects_of_two_stages_that_the_set_lacks() -> None:
    drawn = bench.slots(12, 2, 6, ["embedded", "nees"], np.random.default_rng(1))
    assert [len(effects) for _, effects in drawn] == [0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 2, 2]
    for name, effects in drawn:
        assert not set(effects) & set(bench.RIGS[name].also)
        assert len({bench.FORMS[e].stage for e in effects}) == len(effects)
