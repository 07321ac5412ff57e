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
from mrdamp.errors import InputError
from mrdamp.model import Effect, Model, core, effect_parameters, effects_from
from mrdamp.structures import dyke1996
from refusals import refuses

BINGHAM = {"c0a": 500.0, "c0b": 100.0, "fya": 50.0, "fyb": 200.0, "v_ref": 0.005}


def frame_model(effects: tuple[Effect, ...] = ()) -> Model:
    return Model("bingham", BINGHAM, effects, "frame", dyke1996())


def test_parameters_of_an_effect() -> None:
    assert effect_parameters("joint_friction") == ("coulomb", "width", "presliding")
    assert effect_parameters("sensor_gain", placed=True) == ("g",)


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


NO_LIST: tuple[object, ...] = ({}, None, 5, True)
STRUCTURE = dyke1996().to_dict()


def framed(effects: Sequence[object] = (), **change: object) -> dict[str, object]:
    return bingham(structure=STRUCTURE | change, effects=list(effects)) | {"rig": "frame"}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "empty"),
        ("{", "no JSON"),
        ("[]", "'nominal'"),
        (json.dumps(case(format=2)), "format is 2; allowed: 1"),
        (json.dumps(case(rig="bridge")), "damper, frame"),
        (json.dumps(case(rig="frame")), "structure has no mass_kg"),
        (json.dumps(case(nominal={"law": "maxwell", "parameters": {}})), "modified_bouc_wen"),
        (json.dumps(case(nominal={"law": "bingham", "parameters": {"c0a": 1.0}})), "c0b"),
        (json.dumps(case(nominal={"law": "bingham", "parameters": {**BINGHAM, "k1": 1.0}})), "'k1'"),
        (json.dumps(case(nominal={"law": "bingham", "parameters": {**BINGHAM, "v_ref": -1.0}})), "outside"),
        (
            json.dumps(case(nominal={"law": "bingham", "parameters": {**BINGHAM, "c0a": "x"}})),
            "finite number",
        ),
        (json.dumps(case(nominal={"law": "narx", "parameters": {}})), "weights"),
        (json.dumps(bingham(effect=[])), "'effect' is unknown; .*; nearest: effects"),
        (json.dumps(bingham(parametres={})), "'parametres' is unknown; .*; nearest: parameters"),
        (json.dumps(bingham({"fyaa": 1.0})), "'fyaa' is none of law bingham; .*; nearest: fya"),
        (json.dumps(bingham(effects=[{"name": "driver_lagg"}])), "'driver_lagg' is unknown; .*; nearest: driver_lag"),
        (json.dumps(bingham(effects=[{"name": "driver_lag", "parameters": {"taw": 1}}])), "'taw' .*; nearest: tau"),
        (json.dumps(bingham(effects=[{"name": "driver_lag", "parameter": {}}])), "nearest: parameters"),
        *((json.dumps(bingham(effects=value)), "effects is .*; allowed: a list") for value in NO_LIST),
        (json.dumps(bingham(effects=[5])), "an effect is 5; allowed: an object"),
        (json.dumps(bingham({"c0a": -1000})), "c0a is -1000: c0 is -1000 at command 0; allowed: at least 0"),
        (json.dumps(bingham({"c0a": True})), "c0a is True; allowed: a finite number"),
        (json.dumps(bingham({"c0a": 1e308})), r"c0a is 1e\+308; allowed: a finite number"),
        (json.dumps(bingham({"c0a": 10**400})), "whole number of 401 digits"),
        (json.dumps(bingham({"c0a": math.nan})), "it holds NaN"),
        (json.dumps(bingham()).replace('"c0a"', '"c0a": 1, "c0a"'), "'c0a' stands twice"),
        (json.dumps(case(model={})), "both are in it"),
        (json.dumps(case(sample_rate_hz="x")), "sample_rate_hz is 'x'; allowed: a positive number"),
        (json.dumps(case(sample_rate_hz=-1)), "sample_rate_hz is -1; allowed: a positive number"),
        (json.dumps(framed(mass_kg=[98.0, 98.0, True])), "mass_kg is .*; allowed: a list of finite numbers"),
        (json.dumps(framed(mass_kg=["1", "1", "1"])), "mass_kg is .*; allowed: a list of finite numbers"),
        (json.dumps(framed(mass_kgs=[1.0])), "'mass_kgs' is unknown; .*; nearest: mass_kg"),
        (json.dumps(framed(**dict.fromkeys(STRUCTURE, [1.0] * 3000))), "3000 storeys; allowed are 1 to 200"),
        (
            json.dumps(framed([{"name": "storey_stiffness", "place": 1, "parameters": {"e": -2}}])),
            "stiffness_n_m of storey 1 is -516000; it must be a finite number above 0",
        ),
        (
            json.dumps(framed([{"name": "floor_mass", "place": 2, "parameters": {"dm": -1e6}}])),
            "mass_kg of storey 2 is .*; it must be a finite number above 0",
        ),
        (json.dumps(bingham(effects=[])).replace("[]", "[" * 100_000 + "]" * 100_000), "nested too deeply"),
    ],
)
def test_a_bad_file_is_told_in_a_line_with_its_name(tmp_path: Path, content: str, said: str) -> None:
    path = tmp_path / "case.json"
    path.write_text(content)
    with pytest.raises(InputError, match=r"case\.json") as caught:
        Model.read(path)
    assert re.search(said, str(caught.value))
    assert len(str(caught.value)) < 900
    assert "\n" not in str(caught.value)


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
    with pytest.raises(InputError) as caught:
        frame_model((effect,))
    assert said in str(caught.value)


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
