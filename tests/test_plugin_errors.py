"""A bad attribute fails at compile with one line: element, attribute, value, what is allowed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjcf_builders import BINGHAM, BOUC_WEN, DYKE, Damper, Sensor, Values, compiled, document, slider
from mrdamp import InputError
from mrdamp.model import core
from networks import random_network


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
ATTRIBUTES: tuple[tuple[str, Values, tuple[str, ...]], ...] = (
    ("bingam", BINGHAM, ("'law'", "'bingam'", *LAWS)),
    ("Bingham", BINGHAM, ("'law'", "'Bingham'", *LAWS)),
    ("", {"c0a": 150.0}, ("'law'", "missing", *LAWS)),
    ("bingham", without("fyb", BINGHAM), ("law bingham needs", "'fyb'", "(N per command)")),
    ("bingham", {**BINGHAM, "alpha_a": 3.0}, ("'alpha_a'", "'3.0'", "bingham", "c0a c0b fya fyb v_ref")),
    ("bouc_wen", {**BOUC_WEN, "fye": 3.0}, ("'fye'", "'3.0'", "law bouc_wen")),
    ("narx", {"c0a": 1.0}, ("'c0a'", "'1.0'", "law narx", "none")),
    ("bingham", {**BINGHAM, "c0a": "4,0"}, ("'c0a'", "'4,0'", "is not a number", "(N s/m)")),
    ("bingham", {**BINGHAM, "c0a": "4 Ns/m"}, ("'c0a'", "'4 Ns/m'", "is not a number")),
    ("bingham", {**BINGHAM, "fya": "nan"}, ("'fya'", "'nan'", "is not a finite number", "(N)")),
    ("bingham", {**BINGHAM, "fya": "-Infinity"}, ("'fya'", "'-Infinity'", "finite")),
    ("bingham", {**BINGHAM, "fya": "1e999"}, ("'fya'", "'1e999'", "not a finite number")),
    ("bingham", {**BINGHAM, "v_ref": -0.01}, ("v_ref", "-0.01", "[0, inf]", "m/s")),
    ("bingham", {**BINGHAM, "asymmetry_a": -1.0}, ("asymmetry_a", "-1", "[-0.99, 0.99]")),
    (
        "bingham", {**BINGHAM, "trapped_gas_time": 0.2, "trapped_gas_direction": 0.0},
        ("trapped_gas_time = 0.2", "trapped_gas_direction"),
    ),
    ("bouc_wen", {**BOUC_WEN, "gamma": 1.0, "beta": -1.0}, ("beta + gamma = 0", "above 0")),
    ("modified_bouc_wen", {**DYKE, "gamma": 1.0, "beta": -3.0}, ("beta + gamma = -2", "above 0")),
    ("modified_bouc_wen", {**DYKE, "c1a": 0.0}, ("c1a = 0", "above 0")),
    ("bingham", {**BINGHAM, "command_min": 2.0, "command_max": 1.0}, ("command_min = 2", "_max = 1")),
    ("narx", {}, ("needs", "weights", "text:NAME")),
    ("bingham", {**BINGHAM, "weights": "a.txt"}, ("'weights'", "'a.txt'", "bingham")),
    ("narx", {"weights": "no/such.txt"}, ("'weights'", "'no/such.txt'", "no such file", "MRDAMP_PATH")),
    ("narx", {"weights": "text:net"}, ("'weights'", "'text:net'", "<custom><text>")),
    ("narx", {"weights": "{file}", "asymmetry_yield": 0.1}, ("asymmetry_yield", "asymmetry_a")),
    ("narx", {"weights": "{file}", "shear_thinning_m": 0.5}, ("shear_thinning_m", "narx")),
)  # fmt: skip


def says(line: str, parts: tuple[str, ...]) -> None:
    assert [part for part in parts if part not in line] == [], line


@pytest.mark.parametrize(("law", "attributes", "parts"), ATTRIBUTES)
def test_attributes_of_the_damper(law: str, attributes: Values, parts: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "net.txt").write_text(random_network(1, (3,)).text())
    placed = {
        key: value.format(file=tmp_path / "net.txt") if isinstance(value, str) else value
        for key, value in attributes.items()
    }
    says(complaint(damped(law, placed), "actuator 'mr'"), parts)


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
    says(complaint(damped("narx", {"weights": "net.txt"}), "actuator 'mr'"), ("'weights'", "net.txt"))


def test_broken_weights_in_the_model_are_named() -> None:
    text = random_network(1, (3,)).text().replace("hidden 1 3", "hidden 1 4")
    extra = f'<custom><text name="net" data="{text}"/></custom>'
    model = document(slider(1.0), [Damper("narx", {"weights": "text:net"})], (), extra=extra)
    says(complaint(model, "actuator 'mr'"), ("text:net", "`weight`"))


BALL = '<body><joint name="j0" type="ball"/><geom size="0.1"/></body>'
TWO = Damper("", {}).actuator().replace('name="mr"', 'name="two"') + "</actuator>"
HERE = '<plugin plugin="mrdamp.damper">'
ELEMENTS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    (damped("bingham", BINGHAM, more='actdim="2"'), "actuator 'mr'", ("actdim = 2", "0")),
    (damped("bingham", BINGHAM, more='dyntype="filter"'), "actuator 'mr'", ("actdim = 1", "dyntype")),
    (document(BALL, [Damper("bingham", BINGHAM)], ()), "actuator 'mr'", ("transmission", "slide or hinge")),
    (damped("bingham", BINGHAM).replace("</actuator>", TWO), "actuator 'two'", ("2 actuators", "own instance")),
    (
        document(slider(1.0), [], ()).replace(HERE, HERE + Damper("bingham", BINGHAM, "idle").instance()),
        "plugin instance 'idle_data'", ("no actuator",),
    ),
    (
        damped("bingham", {**BINGHAM, "c0a": "x"}).replace('<plugin name="mr" ', "<plugin "),
        "actuator 0", ("'c0a'", "'x'"),
    ),
)  # fmt: skip


@pytest.mark.parametrize(("text", "who", "parts"), ELEMENTS)
def test_elements(text: str, who: str, parts: tuple[str, ...]) -> None:
    says(complaint(text, who), parts)


@pytest.mark.parametrize(
    ("attributes", "parts"),
    [
        ({"signal": "forces"}, ("'signal'", "'forces'", "true_force", "stroke_velocity")),
        ({"noise": -1.0}, ("'noise'", "-1", "[0, inf]", " N")),
        ({"noise": "5 %"}, ("'noise'", "'5 %'", "is not a number")),
        ({"range": "nan"}, ("'range'", "'nan'", "is not a finite number")),
        ({"resolution": "0,5"}, ("'resolution'", "'0,5'", "is not a number")),
        ({"sensitivity": 0.0}, ("'sensitivity'", "0", "pC/N")),
        ({"seed": 1.5}, ("'seed'", "1.5", "whole number")),
        ({"seed": -1.0}, ("'seed'", "-1")),
        ({"sensor_gain_g": 1e3}, ("'sensor_gain_g'", "1000", "[-100, 100]")),
    ],
)
def test_attributes_of_the_sensor(attributes: Values, parts: tuple[str, ...]) -> None:
    text = document(slider(1.0), [Damper("bingham", BINGHAM)], [Sensor("f", "mr", attributes)])
    says(complaint(text, "sensor 'f'"), parts)


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
    says(complaint(text, "sensor 'f'"), ("mrdamp.damper", 'objtype="actuator"'))


def test_unknown_and_double_attributes_are_the_engines_errors() -> None:
    with pytest.raises(ValueError, match="c0x"):
        compiled(damped("bingham", {**BINGHAM, "c0x": 1.0}))
    row = '<config key="c0a" value="1"/>'
    with pytest.raises(ValueError, match="c0a"):
        compiled(damped("bingham", BINGHAM).replace("</instance>", row + "</instance>"))


def test_long_values_are_shortened() -> None:
    for value in ("9" * 400 + "x", "x" * 5000, "%s%n" * 200):
        line = complaint(damped("bingham", {**BINGHAM, "c0a": value}), "actuator 'mr'")
        says(line, (value[:40], "is not a number"))


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
        says(complaint(text({**good, row.name: "much"}), "actuator 'mr'"), (f"'{row.name}'", "'much'"))
        for bound, beyond in ((row.minimum, -1.0), (row.maximum, 1.0)):
            allowed = row.group not in ("law", "dependence") or row.name in good
            if math.isfinite(bound) and allowed:
                line = complaint(text({**good, row.name: bound + beyond}), "actuator 'mr'")
                says(line, (row.name, "outside"))


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
