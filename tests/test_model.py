"""Models and their files: what is written is read again, what is wrong is told in a line."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrdamp import sets
from mrdamp.model import Effect, Model, core, effects_from
from mrdamp.structures import dyke1996
from refusals import refusal_of, refuses

BINGHAM = {"c0a": 500.0, "c0b": 100.0, "fya": 50.0, "fyb": 200.0, "v_ref": 0.005}


def frame_model(effects: tuple[Effect, ...] = ()) -> Model:
    return Model("bingham", BINGHAM, effects, "frame", dyke1996())


def test_a_model_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    effects = (
        Effect("driver_lag", {"tau": 0.01}),
        Effect("storey_stiffness", {"e": -0.2}, 2),
        Effect("sensor_gain", {"g": 1.1}, 3),
    )
    model = frame_model(effects)
    model.write(tmp_path / "corrected.json")
    read = Model.read(tmp_path / "corrected.json")
    assert read.to_dict() == {**model.to_dict(), "name": read.name}
    assert read.attributes == {**BINGHAM, "driver_lag_tau": 0.01}


def test_structure_effects_change_the_frame_where_they_are_placed() -> None:
    plain = dyke1996()
    effects = (
        Effect("storey_stiffness", {"e": -0.25}, 2),
        Effect("storey_damping", {"e": 1.0}, 1),
        Effect("joint_friction", {"coulomb": 30.0}, 3),
        Effect("floor_mass", {"dm": 12.0}, 1),
        Effect("sensor_gain", {"g": 0.9}, 2),
        Effect("sensor_offset", {"f": 0.05}, 3),
    )
    frame = frame_model(effects).frame
    np.testing.assert_allclose(frame.stiffness, plain.stiffness * [1, 0.75, 1])
    np.testing.assert_allclose(frame.damping, plain.damping * [2, 1, 1])
    np.testing.assert_allclose(frame.mass, plain.mass + np.array([12, 0, 0]))
    assert frame.friction is not None
    np.testing.assert_allclose(frame.friction, [0, 0, 30])
    assert frame.acc_gain is not None
    np.testing.assert_allclose(frame.acc_gain, [1, 0.9, 1])
    assert frame.acc_offset is not None
    np.testing.assert_allclose(frame.acc_offset, [0, 0, 0.05])


def test_every_shipped_set_makes_a_model() -> None:
    for name in sets.names():
        found = sets.load(name)
        model = Model(found.law, dict(found.parameters), effects_from(found.attributes()))
        assert model.attributes == found.attributes()


def case(**change: object) -> dict[str, object]:
    nominal = {"law": "bingham", "parameters": BINGHAM}
    return {"name": "x", "format": 1, "rig": "damper", "nominal": nominal} | change


def bingham(parameters: Mapping[str, object] | None = None, **change: object) -> dict[str, object]:
    return case(nominal={"law": "bingham", "parameters": {**BINGHAM, **(parameters or {})}} | change)


STRUCTURE = dyke1996().to_dict()


def framed(effects: Sequence[object] = (), **change: object) -> dict[str, object]:
    return bingham(structure=STRUCTURE | change, effects=list(effects)) | {"rig": "frame"}


def placed(name: str, place: int | None = None, **parameters: float) -> dict[str, object]:
    return {"name": name, "parameters": parameters} | ({} if place is None else {"place": place})


LAG = {"name": "driver_lag"}
BEYOND = "it must be a finite number above 0"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "empty"),
        ("{", "no JSON"),
        ("[]", "'nominal'"),
        (case(format=2), "format is 2; allowed: 1"),
        (case(rig="bridge"), "damper, frame"),
        (case(rig="frame"), "structure has no mass_kg"),
        (case(nominal={"law": "maxwell", "parameters": {}}), "modified_bouc_wen"),
        (case(nominal={"law": "bingham", "parameters": {"c0a": 1.0}}), "c0b"),
        (bingham({"k1": 1.0}), "'k1'"),
        (bingham({"v_ref": -1.0}), "outside"),
        (bingham({"c0a": "x"}), "finite number"),
        (case(nominal={"law": "narx", "parameters": {}}), "weights"),
        (bingham(effect=[]), "'effect' is unknown; .*; nearest: effects"),
        (bingham(parametres={}), "'parametres' is unknown; .*; nearest: parameters"),
        (bingham({"fyaa": 1.0}), "'fyaa' is none of law bingham; .*; nearest: fya"),
        (bingham(effects=[{"name": "driver_lagg"}]), "'driver_lagg' is unknown; .*; nearest: driver_lag"),
        (bingham(effects=[placed("driver_lag", taw=1)]), "'taw' .*; nearest: tau"),
        (bingham(effects=[LAG | {"parameter": {}}]), "nearest: parameters"),
        (bingham(effects={}), "effects is .*; allowed: a list"),
        (bingham(effects=None), "effects is .*; allowed: a list"),
        (bingham(effects=[5]), "an effect is 5; allowed: an object"),
        (bingham(effects=[placed("driver_lag", tau=0.01)] * 2), "driver_lag stands there twice"),
        (bingham(structure={"mass_kg": [1.0]}), "allowed: rig 'frame'"),
        (bingham({"c0a": -1000}), "c0a is -1000: c0 is -1000 at command 0; allowed: at least 0"),
        (bingham({"c0a": True}), "c0a is True; allowed: a finite number"),
        (bingham({"c0a": 1e308}), r"c0a is 1e\+308; allowed: a finite number"),
        (bingham({"c0a": 10**400}), "whole number of 401 digits"),
        (bingham({"c0a": math.nan}), "it holds NaN"),
        (json.dumps(bingham()).replace('"c0a"', '"c0a": 1, "c0a"'), "'c0a' stands twice"),
        (case(model={}), "both are in it"),
        (case(sample_rate_hz="x"), "sample_rate_hz is 'x'; allowed: a positive number"),
        (case(sample_rate_hz=-1), "sample_rate_hz is -1; allowed: a positive number"),
        (framed(mass_kg=[98.0, 98.0, True]), "mass_kg is .*; allowed: a list of finite numbers"),
        (framed(mass_kg=["1", "1", "1"]), "mass_kg is .*; allowed: a list of finite numbers"),
        (framed(mass_kgs=[1.0]), "'mass_kgs' is unknown; .*; nearest: mass_kg"),
        (framed(**dict.fromkeys(STRUCTURE, [1.0] * 3000)), "3000 storeys; allowed are 1 to 200"),
        (framed([placed("storey_stiffness", 1, e=-2)]), f"stiffness_n_m of storey 1 is -516000; {BEYOND}"),
        (framed([placed("floor_mass", 2, dm=-1e6)]), f"mass_kg of storey 2 is .*; {BEYOND}"),
        (json.dumps(bingham(effects=[])).replace("[]", "[" * 100_000 + "]" * 100_000), "nested too deeply"),
    ],
)
def test_a_bad_file_is_told_in_a_line_with_its_name(
    tmp_path: Path, content: str | dict[str, object], said: str
) -> None:
    path = tmp_path / "case.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    text = refusal_of(path, lambda: Model.read(path))
    assert re.search(said, text)
    assert len(text) < 900


@pytest.mark.parametrize(
    ("effect", "said"),
    [
        (Effect("ghost", {}), "driver_lag"),
        (Effect("driver_lag", {"lag": 1.0}), "tau"),
        (Effect("driver_lag", {"tau": float("nan")}), "finite"),
        (Effect("driver_lag", {"tau": -1.0}), "driver_lag_tau"),
        (Effect("storey_stiffness", {"e": 0.1}), "place None"),
        (Effect("storey_stiffness", {"e": 0.1}, 4), "1 to 3"),
        (Effect("driver_lag", {"tau": 0.1}, 1), "no place"),
    ],
)
def test_a_bad_effect_is_told(effect: Effect, said: str) -> None:
    refuses(lambda: frame_model((effect,)), said)


def test_arrays_of_another_width_are_refused() -> None:
    """They would be read beyond their end."""
    one = core.vector("bingham", {"c0a": 500.0, "c0b": 0.0, "fya": 50.0, "fyb": 0.0, "v_ref": 0.01})
    several, x = np.repeat(one[None], 8, axis=0), np.sin(np.arange(50) / 5)
    for params in (several.reshape(16, -1), several.reshape(2, 4, -1), several[:, :10], np.array([])):
        refuses(partial(core.run_many, "bingham", params, 1e-3, x, x), re.escape(f"expected (sets, {len(one)})"))
    for name, value in (("lanes", 3), ("lanes", -1), ("threads", -1), ("substep", -1.0), ("substep", np.nan)):
        given: dict[str, Any] = {name: value}
        refuses(partial(core.run_many, "bingham", several, 1e-3, x, x, **given), f"{name} is {value}")
    several[5, core.attribute_index()["driver_lag_tau"]] = 11.0
    refuses(lambda: core.run_many("bingham", several, 1e-3, x, x), "record 0, set 5: driver_lag_tau = 11 is outside")
