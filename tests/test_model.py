"""Models and their files, and the published sets against the numbers as printed."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dampers import grid
from excitation import constant, multisine, sine
from mrdamp import sets
from mrdamp.model import Effect, Model, core, effects_from
from mrdamp.structures import dyke1996
from refusals import refusal_of, refuses
from twin_laws import value
from twins import simulate

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


BEYOND = "it must be a finite number above 0"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (case(rig="frame"), "structure has no mass_kg"),
        (case(nominal={"law": "maxwell", "parameters": {}}), "modified_bouc_wen"),
        (bingham({"fyaa": 1.0}), "'fyaa' is none of law bingham; .*; nearest: fya"),
        (bingham(effects=[placed("driver_lag", tau=0.01)] * 2), "driver_lag stands there twice"),
        (bingham(structure={"mass_kg": [1.0]}), "allowed: rig 'frame'"),
        (bingham({"c0a": -1000}), "c0a is -1000: c0 is -1000 at command 0; allowed: at least 0"),
        (json.dumps(bingham()).replace('"c0a"', '"c0a": 1, "c0a"'), "'c0a' stands twice"),
        (framed(**dict.fromkeys(STRUCTURE, [1.0] * 3000)), "3000 storeys; allowed are 1 to 200"),
        (framed([placed("storey_stiffness", 1, e=-2)]), f"stiffness_n_m of storey 1 is -516000; {BEYOND}"),
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


def test_arrays_of_another_width_are_refused() -> None:
    """They would be read beyond their end."""
    one = core.vector("bingham", {"c0a": 500.0, "c0b": 0.0, "fya": 50.0, "fyb": 0.0, "v_ref": 0.01})
    several, x = np.repeat(one[None], 8, axis=0), np.sin(np.arange(50) / 5)
    for params in (several.reshape(16, -1), several.reshape(2, 4, -1), several[:, :10], np.array([])):
        refuses(partial(core.run_many, "bingham", params, 1e-3, x, x), re.escape(f"expected (sets, {len(one)})"))
    for name, given_value in (("lanes", 3), ("lanes", -1), ("threads", -1), ("substep", -1.0), ("substep", np.nan)):
        given: dict[str, Any] = {name: given_value}
        refuses(partial(core.run_many, "bingham", several, 1e-3, x, x, **given), f"{name} is {given_value}")
    several[5, core.attribute_index()["driver_lag_tau"]] = 11.0
    refuses(lambda: core.run_many("bingham", several, 1e-3, x, x), "record 0, set 5: driver_lag_tau = 11 is outside")


ORDER: Mapping[str, tuple[str, ...]] = {
    "bingham": tuple("c0a c0b fya fyb v_ref".split()),
    "bouc_wen": tuple("c0a c0b alpha_a alpha_b gamma beta A n k0 x0".split()),
    "hyperbolic_tangent": tuple("k0a k0b k1a k1b c0a c0b c1a c1b m0 f0a f0b v_ref".split()),
    "modified_bouc_wen": tuple("c0a c0b c1a c1b k0 k1 x0 alpha_a alpha_b gamma beta A n".split()),
}
# as printed: N, cm, V
SPENCER_CM = {
    "c0a": 21.0, "c0b": 3.5, "c1a": 283.0, "c1b": 2.95, "k0": 46.9, "k1": 5.0, "x0": 14.3, "alpha_a": 140.0,
    "alpha_b": 695.0, "gamma": 363.0, "beta": 363.0, "A": 301.0, "n": 2.0,
}  # fmt: skip
FOAM_BOUC_WEN_CM = {
    "c0a": 0.0055, "c0b": 0.0055, "alpha_a": 1.8079, "alpha_b": 8.0802, "gamma": 84.0253, "beta": 46.0,
    "A": 80.7337, "n": 1.0, "k0": 0.0, "x0": 0.0,
}  # fmt: skip
FOAM_TANH_CM = {
    "k0a": 0.5383, "k0b": 0.0193, "k1a": -47.4474, "k1b": 148.4435, "c0a": 0.7494, "c0b": 0.0, "c1a": 0.0044,
    "c1b": 0.0385, "m0": 0.00008, "f0a": -1.3704, "f0b": 4.9328, "v_ref": 0.330,
}  # fmt: skip


@pytest.mark.parametrize("id", sets.names())
def test_set_is_complete(id: str) -> None:
    refuses(lambda: sets.load("rd8041"), f"rd8041.*{id}")
    found = sets.load(id)
    assert found.id == id
    model = Model(found.law, dict(found.parameters), effects_from(found.attributes()))
    assert model.attributes == found.attributes()
    names = tuple(found.parameters)
    assert names[: len(ORDER[found.law])] == ORDER[found.law]
    assert all(math.isfinite(number) for number in found.parameters.values())
    assert found.status in ("A", "B")
    assert found.sources
    assert found.notes
    assert found.command.min <= found.command.max
    if found.command.min < found.command.max:
        assert (found.parameters["command_min"], found.parameters["command_max"]) == (
            found.command.min,
            found.command.max,
        )
    else:  # fitted at one command: nothing may follow it
        assert all(
            number == 0.0 for name, number in found.parameters.items() if name in {"c0b", "alpha_b", "fyb"}
        )


def test_files_and_table_agree() -> None:
    folder = resources.files("mrdamp.sets")
    files = {f.name.removesuffix(".json") for f in folder.iterdir() if f.name.endswith(".json")}
    assert files == set(sets.names())
    table = folder.joinpath("README.md").read_text(encoding="utf-8")
    rows = [line.split("|") for line in table.splitlines() if line.startswith("| `")]
    assert {row[1].strip(" `") for row in rows} == files
    for row in rows:
        data = json.loads(folder.joinpath(f"{row[1].strip(' `')}.json").read_text(encoding="utf-8"))
        assert row[5].strip() == data["status"]
        assert f"`{data['law']}`" in row[3]


@pytest.mark.parametrize(
    ("id", "printed", "level"),
    [
        ("spencer1997_3kN", SPENCER_CM, 1.5),
        ("zapateiro_foam_bouc_wen", FOAM_BOUC_WEN_CM, 3.0),
        ("zapateiro_foam_tanh", FOAM_TANH_CM, 3.0),
    ],
)
def test_set_in_si_is_the_one_printed_in_cm(id: str, printed: Mapping[str, float], level: float) -> None:
    """Same newtons for the same motion, once in metres and once in centimetres."""
    t = grid(1e-3, 0.5)
    found = sets.load(id)
    si = simulate(found.law, found.parameters, multisine(0.003, 0.5, 8.0, seed=1), t, constant(level))
    cm = simulate(found.law, printed, multisine(0.3, 0.5, 8.0, seed=1), t, constant(level))
    np.testing.assert_allclose(si["force"], cm["force"], rtol=0.0, atol=1e-6 * np.max(np.abs(cm["force"])))


def test_dyke_is_spencer_without_preload() -> None:
    spencer, dyke = sets.load("spencer1997_3kN"), sets.load("dyke1996_3kN")
    assert {**spencer.parameters, "x0": 0.0} == dict(dyke.parameters)
    assert spencer.effects == dyke.effects
    assert dyke.effects["driver_lag"]["tau"] == pytest.approx(1.0 / 190.0)
    t = np.array([0.0, 1e-9])
    preload = simulate(spencer.law, spencer.parameters, sine(0.0, 1.0), t)["force"][0]
    assert preload == pytest.approx(-71.5)


@pytest.mark.parametrize("i", [0.0, 0.3, 1.0, 2.5])
def test_rths_maps_are_those_of_the_script(i: float) -> None:
    """p(i) = p_b + (p_a - p_b) exp(-p_c i), in kN, mm, s."""
    p = sets.load("rths_benchmark_200kN").parameters

    def printed(a: float, b: float, c: float) -> float:
        return b + (a - b) * math.exp(-c * i)

    assert value(p, "c0", i) == pytest.approx(printed(0.080, 0.32, 1.5) * 1e6)  # kN s/mm
    assert value(p, "c1", i) == pytest.approx(printed(3.0, 15.0, 2.0) * 1e6)
    assert value(p, "alpha_", i) == pytest.approx(printed(0.11, 0.55, 1.0) * 1e6)  # kN/mm
    floor = p["hysteresis_floor"]
    share = floor + (1.0 - floor) * math.exp(-p["hysteresis_rate"] * i)
    assert p["gamma"] * share == pytest.approx(printed(0.05, 0.0020, 5.2) * 1e6)  # 1/mm2
    assert p["beta"] == p["gamma"]


@pytest.mark.parametrize("i", [0.0, 0.5, 1.0])
def test_vrths_maps_are_those_of_the_source(i: float) -> None:
    p = sets.load("vrths_2022").parameters
    assert value(p, "alpha_", i) == pytest.approx(1e3 * (-38.1520043 * i**2 + 41.5084056 * i + 15.2210961))
    assert value(p, "c0", i) == pytest.approx(1e3 * (7.62596402 * i + 0.924911328))
    assert value(p, "c1", i) == pytest.approx(1e3 * (78.3366934 * i + 9.86712839))
    floor = p["hysteresis_floor"]
    share = floor + (1.0 - floor) * math.exp(-p["hysteresis_rate"] * i)
    assert p["gamma"] * share == pytest.approx(1.89407553e6 * math.exp(-3.65610854 * i))


@pytest.mark.parametrize(
    ("id", "kx", "kw", "rho"),
    [
        ("utfpr_rd8041_dahl_0V", 0.6835, 59.46, 30.57),
        ("utfpr_rd8041_dahl_test1", 0.7682, 57.42, 27.45),
        ("utfpr_rd8041_dahl_1p98V", 2.2698, 412.48, 10.95),
    ],
)
def test_dahl_sets_have_dahls_closed_form(id: str, kx: float, kw: float, rho: float) -> None:
    """Pushed one way from rest: F = Kx v + Kw (1 - exp(-rho x)), in N and mm."""
    found, t = sets.load(id), np.linspace(0.0, 0.2, 101)
    motion = sine(0.5e-3, 1.0)  # 0.5 mm, a quarter period is not reached
    force = simulate(found.law, found.parameters, motion, t)["force"]
    x, v, _ = motion.sample(t)
    closed = kx * v * 1e3 + kw * (1.0 - np.exp(-rho * x * 1e3))
    np.testing.assert_allclose(force, closed, rtol=1e-6)
