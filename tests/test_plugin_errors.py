"""A bad attribute fails at compile with one line: element, attribute, value, what is allowed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjcf_builders import Damper, Sensor, Values, compiled, document, slider
from mrdamp import InputError
from mrdamp.model import core
from networks import random_network

BINGHAM = {"c0a": 150.0, "c0b": 80.0, "fya": 40.0, "fyb": 60.0, "v_ref": 0.008}
BOUC_WEN = {
    "c0a": 900.0, "c0b": 900.0, "alpha_a": 3e4, "alpha_b": 1e5, "gamma": 9e5, "beta": 4e5, "A": 110.0,
    "n": 2.0, "k0": 3000.0, "x0": 0.001,
}  # fmt: skip
DYKE = {
    "c0a": 2100.0, "c0b": 350.0, "c1a": 28300.0, "c1b": 295.0, "k0": 4690.0, "k1": 500.0, "x0": 0.0,
    "alpha_a": 14000.0, "alpha_b": 69500.0, "gamma": 3.63e6, "beta": 3.63e6, "A": 301.0, "n": 2.0,
}  # fmt: skip


def complaint(text: str, who: str) -> str:
    """The line that compiling the document fails with; it begins with the element's name."""
    with pytest.raises(ValueError, match="plugin->init failed") as found:
        compiled(text)
    # the engine says the line twice
    lines = {line for line in str(found.value).splitlines() if line and not line.startswith("Error: engine")}
    assert len(lines) == 1, lines
    line = lines.pop()
    assert line.startswith(f"{who}: ")
    assert len(line) < 230  # the engine cuts its text at 499 characters, with the line in it twice
    return line


def damped(law: str, attributes: Values, **how: str) -> str:
    return document(slider(1.0), [Damper(law, attributes, **how)], ())


def without(name: str, values: Mapping[str, float]) -> dict[str, float]:
    return {key: value for key, value in values.items() if key != name}


LAWS = ("bingham", "bouc_wen", "hyperbolic_tangent", "modified_bouc_wen", "narx")
# law, attributes, parts of the message
ATTRIBUTES: Mapping[str, tuple[str, Values, tuple[str, ...]]] = {
    "unknown law": ("bingam", BINGHAM, ("'law'", "'bingam'", *LAWS)),
    "law in capitals": ("Bingham", BINGHAM, ("'law'", "'Bingham'", *LAWS)),
    "no law": ("", {"c0a": 150.0}, ("'law'", "missing", *LAWS)),
    "nothing at all": ("", {}, ("'law'", "missing", *LAWS)),
    "missing parameter": ("bingham", without("fyb", BINGHAM), ("needs", "'fyb'", "(N per command)")),
    "missing exponent": ("bouc_wen", without("n", BOUC_WEN), ("law bouc_wen needs", "'n'")),
    "surplus parameter": (
        "bingham", {**BINGHAM, "alpha_a": 3.0}, ("'alpha_a'", "'3.0'", "bingham", "c0a c0b fya fyb v_ref"),
    ),
    "dependence of another law": ("bouc_wen", {**BOUC_WEN, "fye": 3.0}, ("'fye'", "'3.0'", "law bouc_wen")),
    "law's parameter with narx": ("narx", {"c0a": 1.0}, ("'c0a'", "'1.0'", "law narx", "none")),
    "text": ("bingham", {**BINGHAM, "c0a": "strong"}, ("'c0a'", "'strong'", "is not a number", "(N s/m)")),
    "decimal comma": ("bingham", {**BINGHAM, "c0a": "4,0"}, ("'c0a'", "'4,0'", "is not a number", "(N s/m)")),
    "two numbers": ("bingham", {**BINGHAM, "c0a": "4 5"}, ("'c0a'", "'4 5'", "is not a number")),
    "unit behind": ("bingham", {**BINGHAM, "c0a": "4 Ns/m"}, ("'c0a'", "'4 Ns/m'", "is not a number")),
    "nan": ("bingham", {**BINGHAM, "fya": "nan"}, ("'fya'", "'nan'", "is not a finite number", "(N)")),
    "infinity": ("bingham", {**BINGHAM, "fya": "inf"}, ("'fya'", "'inf'", "is not a finite number")),
    "negative infinity": ("bingham", {**BINGHAM, "fya": "-Infinity"}, ("'fya'", "'-Infinity'", "finite")),
    "overflow": ("bingham", {**BINGHAM, "fya": "1e999"}, ("'fya'", "'1e999'", "not a finite number")),
    "below zero": ("bingham", {**BINGHAM, "v_ref": -0.01}, ("v_ref", "-0.01", "[0, inf]", "m/s")),
    "exponent below one": ("bouc_wen", {**BOUC_WEN, "n": 0.5}, ("n = 0.5", "[1, 20]")),
    "negative time": (
        "bingham", {**BINGHAM, "driver_lag_tau": -1.0}, ("driver_lag_tau", "-1", "[0, 10]", " s"),
    ),
    "effect's text": (
        "bingham", {**BINGHAM, "seal_friction_coulomb": "some"}, ("'seal_friction_coulomb'", "'some'"),
    ),
    "share above one": ("bingham", {**BINGHAM, "trapped_gas_d": 1.5}, ("trapped_gas_d", "1.5", "[0, 1]")),
    "asymmetry": ("bingham", {**BINGHAM, "asymmetry_a": -1.0}, ("asymmetry_a", "-1", "[-0.99, 0.99]")),
    "pocket of both sides": (
        "bingham", {**BINGHAM, "trapped_gas_time": 0.2, "trapped_gas_direction": 0.0},
        ("trapped_gas_time = 0.2", "trapped_gas_direction"),
    ),
    "delay too long": ("bingham", {**BINGHAM, "command_delay_d": 11.0}, ("command_delay_d", "11", "[0, 10]")),
    "substep": ("bingham", {**BINGHAM, "substep": 0.0}, ("substep", "0", "[1e-06, 1]")),
    "z without bound": (
        "bouc_wen", {**BOUC_WEN, "gamma": 1.0, "beta": -1.0}, ("beta + gamma = 0", "above 0"),
    ),
    "z without bound (2)": (
        "modified_bouc_wen", {**DYKE, "gamma": 1.0, "beta": -3.0}, ("beta + gamma = -2", "above 0"),
    ),
    "no dashpot in series": ("modified_bouc_wen", {**DYKE, "c1a": 0.0}, ("c1a = 0", "above 0")),
    "range upside down": (
        "bingham", {**BINGHAM, "command_min": 2.0, "command_max": 1.0}, ("command_min = 2", "_max = 1"),
    ),
    "no weights": ("narx", {}, ("needs", "weights", "text:NAME")),
    "weights alone": ("bingham", {**BINGHAM, "weights": "a.txt"}, ("'weights'", "'a.txt'", "bingham")),
    "missing file": (
        "narx", {"weights": "no/such.txt"}, ("'weights'", "'no/such.txt'", "no such file", "MRDAMP_PATH"),
    ),
    "missing text": ("narx", {"weights": "text:net"}, ("'weights'", "'text:net'", "<custom><text>")),
    "network's yield": ("narx", {"weights": "{file}", "asymmetry_yield": 0.1}, ("asymmetry_yield", "asymmetry_a")),
    "thinned network": ("narx", {"weights": "{file}", "shear_thinning_m": 0.5}, ("shear_thinning_m", "narx")),
}  # fmt: skip


@pytest.mark.parametrize("case", ATTRIBUTES)
def test_attributes_of_the_damper(case: str, tmp_path: Path) -> None:
    law, attributes, parts = ATTRIBUTES[case]
    (tmp_path / "net.txt").write_text(random_network(1, (3,)).text())
    placed = {
        key: value.format(file=tmp_path / "net.txt") if isinstance(value, str) else value
        for key, value in attributes.items()
    }
    line = complaint(damped(law, placed), "actuator 'mr'")
    for part in parts:
        assert part in line, line


@pytest.mark.parametrize("kind", ["cut off", "empty", "binary", "a folder"])
def test_broken_weights_file_is_named(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = random_network(1, (3,)).text()
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "net.txt"
    if kind == "a folder":
        path.mkdir()
    else:
        contents = {"cut off": text[: len(text) // 2].encode(), "empty": b"", "binary": b"\0\1\2\xff"}
        path.write_bytes(contents[kind])
    line = complaint(damped("narx", {"weights": "net.txt"}), "actuator 'mr'")
    assert "'weights'" in line, line
    assert "net.txt" in line, line


def test_broken_weights_in_the_model_are_named() -> None:
    text = random_network(1, (3,)).text().replace("hidden 1 3", "hidden 1 4")
    extra = f'<custom><text name="net" data="{text}"/></custom>'
    line = complaint(
        document(slider(1.0), [Damper("narx", {"weights": "text:net"})], (), extra=extra), "actuator 'mr'"
    )
    assert "text:net" in line
    assert "`weight`" in line


BALL = '<body><joint name="j0" type="ball"/><geom size="0.1"/></body>'
FREE = '<body><joint name="j0" type="free"/><geom size="0.1"/></body>'
ELEMENTS: Mapping[str, tuple[str, str, tuple[str, ...]]] = {
    "actdim": (damped("bingham", BINGHAM, more='actdim="2"'), "actuator 'mr'", ("actdim = 2", "0")),
    "dyntype": (
        damped("bingham", BINGHAM, more='dyntype="filter"'), "actuator 'mr'", ("actdim = 1", "dyntype"),
    ),
    "dyntype integrator": (
        damped("bingham", BINGHAM, more='dyntype="integrator"'), "actuator 'mr'", ("actdim = 1", "dyntype"),
    ),
    "ball joint": (
        document(BALL, [Damper("bingham", BINGHAM)], ()), "actuator 'mr'", ("transmission", "slide or hinge"),
    ),
    "free joint": (
        document(FREE, [Damper("bingham", BINGHAM)], ()), "actuator 'mr'", ("transmission", "slide or hinge"),
    ),
    "shared by two actuators": (
        damped("bingham", BINGHAM).replace(
            "</actuator>", Damper("", {}).actuator().replace('name="mr"', 'name="two"') + "</actuator>"
        ),
        "actuator 'two'", ("2 actuators", "own instance"),
    ),
    "used by none": (
        document(slider(1.0), [], ()).replace(
            '<plugin plugin="mrdamp.damper">',
            '<plugin plugin="mrdamp.damper">' + Damper("bingham", BINGHAM, "idle").instance(),
        ),
        "plugin instance 'idle_data'", ("no actuator",),
    ),
    "without a name": (
        damped("bingham", {**BINGHAM, "c0a": "x"}).replace('<plugin name="mr" ', "<plugin "),
        "actuator 0", ("'c0a'", "'x'"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", ELEMENTS)
def test_elements(case: str) -> None:
    text, who, parts = ELEMENTS[case]
    line = complaint(text, who)
    for part in parts:
        assert part in line, line


SENSORS: Mapping[str, tuple[Values, tuple[str, ...]]] = {
    "signal": ({"signal": "forces"}, ("'signal'", "'forces'", "true_force", "stroke_velocity")),
    "noise": ({"noise": -1.0}, ("'noise'", "-1", "[0, inf]", " N")),
    "noise as text": ({"noise": "5 %"}, ("'noise'", "'5 %'", "is not a number")),
    "range": ({"range": "nan"}, ("'range'", "'nan'", "is not a finite number")),
    "resolution": ({"resolution": "0,5"}, ("'resolution'", "'0,5'", "is not a number")),
    "sensitivity": ({"sensitivity": 0.0}, ("'sensitivity'", "0", "pC/N")),
    "broken seed": ({"seed": 1.5}, ("'seed'", "1.5", "whole number")),
    "negative seed": ({"seed": -1.0}, ("'seed'", "-1")),
    "leakage": ({"sensor_leakage_tau": -2.0}, ("'sensor_leakage_tau'", "-2", " s")),
    "gain": ({"sensor_gain_g": 1e3}, ("'sensor_gain_g'", "1000", "[-100, 100]")),
}  # fmt: skip


@pytest.mark.parametrize("case", SENSORS)
def test_attributes_of_the_sensor(case: str) -> None:
    attributes, parts = SENSORS[case]
    line = complaint(
        document(slider(1.0), [Damper("bingham", BINGHAM)], [Sensor("f", "mr", attributes)]), "sensor 'f'"
    )
    for part in parts:
        assert part in line, line


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('objtype="actuator" objname="mr"', 'objtype="actuator" objname="motor"'),
        ('objtype="actuator" objname="mr"', 'objtype="joint" objname="j0"'),
        ('objtype="actuator" objname="mr"', ""),
    ],
    ids=["a motor", "a joint", "nothing"],
)
def test_sensor_on_something_else(old: str, new: str) -> None:
    text = document(slider(1.0), [Damper("bingham", BINGHAM)], [Sensor("f")])
    text = text.replace("</actuator>", '<motor name="motor" joint="j0"/></actuator>').replace(old, new)
    line = complaint(text, "sensor 'f'")
    assert "mrdamp.damper" in line
    assert 'objtype="actuator"' in line


def test_unknown_and_double_attributes_are_the_engines_errors() -> None:
    with pytest.raises(ValueError, match="c0x"):
        compiled(damped("bingham", {**BINGHAM, "c0x": 1.0}))
    row = '<config key="c0a" value="1"/>'
    with pytest.raises(ValueError, match="c0a"):
        compiled(damped("bingham", BINGHAM).replace("</instance>", row + "</instance>"))


def test_long_values_are_shortened() -> None:
    for value in ("9" * 400 + "x", "x" * 5000, "%s%n" * 200):
        line = complaint(damped("bingham", {**BINGHAM, "c0a": value}), "actuator 'mr'")
        assert value[:40] in line
        assert "is not a number" in line


@pytest.mark.parametrize("law", core.laws())
def test_every_parameter_is_needed_and_every_attribute_is_strict(law: str) -> None:
    """Over the whole table: each missing parameter, and text for each attribute, fails and is named."""
    good = {name: {"n": 2.0, "c1a": 5.0}.get(name, 1.0) for name in core.law_parameters(law)}
    extra = f'<custom><text name="net" data="{random_network(1, (3,)).text()}"/></custom>'
    more: Values = {"weights": "text:net"} if law == "narx" else {}

    def text(values: Values) -> str:
        return document(slider(1.0), [Damper(law, {**values, **more})], (), extra=extra)

    compiled(text(good))
    for name in good:
        assert f"'{name}'" in complaint(text(without(name, good)), "actuator 'mr'")
    for row in core.attributes():
        line = complaint(text({**good, row.name: "much"}), "actuator 'mr'")
        assert f"'{row.name}'" in line
        assert "'much'" in line
        for bound, beyond in ((row.minimum, -1.0), (row.maximum, 1.0)):
            allowed = row.group not in ("law", "dependence") or row.name in good
            if math.isfinite(bound) and allowed:
                line = complaint(text({**good, row.name: bound + beyond}), "actuator 'mr'")
                assert row.name in line
                assert "outside" in line


def test_python_checks_as_mjcf_does() -> None:
    """The same line, but for the element, from the C entry."""
    for values in ({**BINGHAM, "v_ref": -0.01}, {**BINGHAM, "command_min": 2.0, "command_max": 1.0}):
        with pytest.raises(InputError) as found:
            core.vector("bingham", values)
        assert str(found.value) in complaint(damped("bingham", values), "actuator 'mr'")


def test_bad_value_at_run_time_is_one_line_too() -> None:
    """`plugin_attr` overwritten in a compiled model: the step raises and names the actuator."""
    model, data = compiled(damped("bingham", {**BINGHAM, "c0a": "150.0"}))
    attributes = bytes(model.plugin_attr.view(np.uint8))
    at = attributes.index(b"150.0")
    model.plugin_attr[at : at + 5] = np.frombuffer(b"15o.0", dtype=model.plugin_attr.dtype)
    with pytest.raises(mujoco.FatalError) as found:
        mujoco.mj_step(model, data)
    line = str(found.value)
    assert "actuator 'mr'" in line
    assert "'15o.0'" in line
    assert "\n" not in line.strip()
    model.plugin_attr[at : at + 5] = np.frombuffer(b"160.0", dtype=model.plugin_attr.dtype)
    data.qvel[0] = 0.1
    mujoco.mj_step(model, data)
    assert data.qvel[0] < 0.1
