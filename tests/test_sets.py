"""The published sets against the numbers as printed, in the units they were printed in."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from importlib import resources

import numpy as np
import pytest

from dampers import grid
from excitation import constant, multisine, sine
from mrdamp import sets
from refusals import refuses
from twin_laws import value
from twins import simulate

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
