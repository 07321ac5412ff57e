"""What a diagnosis says of parameters, ties and probabilities."""

from __future__ import annotations

from dataclasses import replace

from mrdamp.diagnosis.report.changes import Change, changes
from mrdamp.diagnosis.report.result import Candidate, Diagnosis, Gap, Named, Where
from mrdamp.diagnosis.report.sentence import sentence
from mrdamp.model import Effect, Model
from mrdamp.structures import dyke1996

LAW = {"c0a": 500.0, "c0b": 10.0, "fya": 20.0, "fyb": 100.0, "v_ref": 0.01}
NOMINAL = Model("bingham", LAW, (Effect("sensor_offset", {"f": 5.0}),))
CORRECTED = Model("bingham", {**LAW, "c0a": 600.0}, (Effect("driver_lag", {"tau": 0.02}),))


def found(**more: object) -> Diagnosis:
    named = Named("driver_lag", "driver", None, 0.6, {"tau": 0.02}, 0.5, {"tau": (0.01, 0.03)})
    plain = Diagnosis(
        "case", "damper", "either", "effect", (named,), (), (("driver_lag", "saturation", "sensor_lag"),),
        Where({"driver": 1.0}), Gap(0.2, 0.2, 0.1, 0.01, (0.09, 0.11), left_out=0.12), (), {}, CORRECTED,
        intervals={"c0a": (590.0, 610.0), "driver_lag_tau": (0.0, 1.0)},
        probabilities={"driver_lag": 0.6, "saturation": 0.3, "sensor_lag": 0.01, "none": 0.97},
    )  # fmt: skip
    return replace(plain, **more)  # type: ignore[arg-type]


def test_old_and_new_values_have_units_and_named_effects_come_first() -> None:
    assert changes(NOMINAL, found()) == [
        Change("driver_lag_tau", "s", None, 0.02, (0.01, 0.03)),
        Change("c0a", "N s/m", 500.0, 600.0, (590.0, 610.0)),
        Change("sensor_offset_f", "N", 5.0, None, None),
    ]
    assert changes(CORRECTED, found()) == []


def test_the_same_at_a_place_of_a_frame() -> None:
    frame = replace(NOMINAL, rig="frame", structure=dyke1996(), effects=())
    named = Named("storey_stiffness", "structure", 2, 1.0, {"e": -0.1}, 1.0)
    other = frame.with_effects([Effect("storey_stiffness", {"e": -0.1}, 2)])
    there = found(effects=(named,), corrected=other)
    assert changes(frame, there) == [Change("storey_stiffness_e@2", "", None, -0.1, None)]


def test_the_headline_has_ties_with_their_probabilities() -> None:
    said = sentence(found())
    assert "driver_lag (the coil current lags the command; probability 0.60)" in said
    assert "do not distinguish it from saturation (probability 0.30). Nearly the same as it: sensor_lag" in said
    assert "from 20.0 % to 10.0 %, 12.0 % on records left out of the fit; noise 1.0 %." in said
    assert "agrees with the rig (probability 0.97)" in sentence(found(verdict="none", effects=()))
    # What no candidate is established for need not be outside the catalogue.
    unknown = found(
        verdict="unknown", effects=(), probabilities={"unknown": 0.8, "driver_lag": 0.2},
        candidates=(Candidate(("unknown",), 0.8, 0.2), Candidate((), 0.1, 0.2), Candidate(("driver_lag",), 0.1, 0.2)),
    )  # fmt: skip
    likeliest = "established for the gap of 20.0 %; the most probable one is driver_lag (probability 0.20)."
    assert likeliest in sentence(unknown)
    # A cause's own probability counts: .12 of the friction, .08 of it beside a lag.
    sets = {("unknown",): 0.8, ("sensor_lag",): 0.09, ("seal_friction",): 0.04, ("driver_lag", "seal_friction"): 0.08}
    two = replace(
        unknown, candidates=tuple(Candidate(c, p, 0.2) for c, p in sets.items()),
        probabilities={"unknown": 0.8, "seal_friction": 0.12, "sensor_lag": 0.09, "driver_lag": 0.08},
    )  # fmt: skip
    assert "the most probable one is seal_friction (probability 0.12)." in sentence(two)
    assert "The best correction leaves 10.0 %, 12.0 % on records left out of the fit." in sentence(unknown)
    rival = {"what": "an end stop", "gap": 0.1, "nearest_gap": 0.15}
    outside = replace(unknown, outside=rival)
    assert sentence(outside).endswith("A cause outside the catalogue has probability 0.80.")
