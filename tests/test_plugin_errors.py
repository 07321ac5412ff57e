"""A bad attribute fails at compile with one line: element, attribute, value, what is allowed. The C table, Python, what
MJCF takes, and the plugin's README are one list of attributes."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjcf_builders import BINGHAM, BOUC_WEN, DYKE, Damper, Sensor, Values, compiled, document, slider
from modules import TOOLS, loaded
from mrdamp import InputError
from mrdamp.model import core
from mrdamp.model.attributes import effects
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
    ("", {"c0a": 150.0}, ("'law'", "missing", *LAWS)),
    ("bingham", without("fyb", BINGHAM), ("law bingham needs", "'fyb'", "(N per command)")),
    ("bingham", {**BINGHAM, "alpha_a": 3.0}, ("'alpha_a'", "'3.0'", "bingham", "c0a c0b fya fyb v_ref")),
    ("narx", {"c0a": 1.0}, ("'c0a'", "'1.0'", "law narx", "none")),
    ("bingham", {**BINGHAM, "c0a": "4,0"}, ("'c0a'", "'4,0'", "is not a number", "(N s/m)")),
    ("bingham", {**BINGHAM, "fya": "nan"}, ("'fya'", "'nan'", "is not a finite number", "(N)")),
    ("bingham", {**BINGHAM, "fya": "1e999"}, ("'fya'", "'1e999'", "not a finite number")),
    ("bingham", {**BINGHAM, "v_ref": -0.01}, ("v_ref", "-0.01", "[0, inf]", "m/s")),
    ("bingham", {**BINGHAM, "asymmetry_a": -1.0}, ("asymmetry_a", "-1", "[-0.99, 0.99]")),
    (
        "bingham", {**BINGHAM, "trapped_gas_time": 0.2, "trapped_gas_direction": 0.0},
        ("trapped_gas_time = 0.2", "trapped_gas_direction"),
    ),
    ("bouc_wen", {**BOUC_WEN, "gamma": 1.0, "beta": -1.0}, ("beta + gamma = 0", "above 0")),
    ("bouc_wen", {**BOUC_WEN, "gamma": -100.0}, ("gamma = -100", "at least 0")),
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
        ({"range": "nan"}, ("'range'", "'nan'", "is not a finite number")),
        ({"resolution": "0,5"}, ("'resolution'", "'0,5'", "is not a number")),
        ({"sensitivity": 0.0}, ("'sensitivity'", "0", "pC/N")),
        ({"seed": 1.5}, ("'seed'", "1.5", "whole number")),
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


ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "plugin_cpp" / "README.md").read_text(encoding="utf-8")
WEIGHTS = (
    "mrdamp-narx 1 sample_time 0.001 inputs 1 v:0 offset 0 scale 1 force 0 1 hidden 0 weight 300 bias 0 end"
)
NAMES = [row.name for row in core.attributes()]


def section(title: str) -> str:
    """The text of one section of the README."""
    return README.split(f"\n## {title}\n", 1)[1].split("\n## ", 1)[0]


def first_column(text: str) -> list[str]:
    """What stands in backquotes in the first column of the tables of a text."""
    cells = [line.split("|")[1] for line in text.splitlines() if line.startswith("|")]
    return [name for cell in cells for name in re.findall(r"`([^`]+)`", cell)]


def test_readme_has_the_tables_of_now() -> None:
    tool = loaded(TOOLS / "attribute_table.py")
    assert tool.replaced(README) == README, "run: python tools/attribute_table.py"
    stale = README.replace("- `driver_lag_tau`:", "- `driver_lag_tao`:")
    assert stale != README
    assert tool.replaced(stale) == README
    with pytest.raises(ValueError, match="markers"):
        tool.replaced("no tables here")


def test_attributes_of_an_effect_have_its_name() -> None:
    others = {"law", "dependence", "command", "numerics"}
    groups = dict.fromkeys(row.group for row in core.attributes() if row.group not in others)
    assert list(groups) == list(effects())
    for row in core.attributes():
        assert row.group in others or row.name.startswith(f"{row.group}_")


def test_defaults_are_in_range() -> None:
    for row in core.attributes():
        assert row.minimum < row.maximum
        assert row.default is None or row.minimum <= row.default <= row.maximum


def model(law: str, attributes: Values, sensor: Values | None = None) -> mujoco.MjModel:
    extra = f'<custom><text name="net" data="{WEIGHTS}"/></custom>'
    text = document(slider(1.0), [Damper(law, attributes)], [Sensor(attributes=sensor or {})], extra=extra)
    return compiled(text)[0]


def plain(law: str) -> dict[str, float | str]:
    """Values a law can be made of."""
    if law == "narx":
        return {"weights": "text:net"}
    return dict.fromkeys(core.law_parameters(law), 1.0)


@pytest.mark.parametrize("law", core.laws())
def test_mjcf_takes_what_the_table_says(law: str) -> None:
    """Each attribute alone beside the law's own: taken, or refused by name where it is another law's."""
    for row in core.attributes():
        if row.name in core.law_parameters(law):
            continue
        value = min(max(0.5 if row.default is None else row.default, row.minimum), row.maximum)
        attributes = {**plain(law), row.name: value}
        if row.group in ("law", "dependence") and row.name not in core.law_options(law):
            with pytest.raises(ValueError, match=f"'{row.name}' = .* is no parameter of law {law}"):
                model(law, attributes)
        else:
            assert model(law, attributes).nplugin == 2


def test_sensor_takes_what_the_readme_says() -> None:
    options, signals = section("The force sensor").split("| signal | unit |")
    names = [name for name in first_column(options) if name != "signal"]
    assert {name for name in names if name.startswith("sensor_")} < set(NAMES)
    assert len(names) == 13
    for name in names:
        value = 0.5 if name == "sensor_lag_ratio" else 1.0  # a damping below the critical one
        assert model("bingham", plain("bingham"), {name: value}).nsensor == 1
    assert len(first_column(signals)) == 12
    for name in first_column(signals):
        assert model("bingham", plain("bingham"), {"signal": name}).nsensor == 1
    with pytest.raises(ValueError, match="driver_lag_tau"):
        model("bingham", plain("bingham"), {"driver_lag_tau": 1.0})


def test_readme_examples_work(tmp_path: Path) -> None:
    (xml,) = re.findall(r"```xml\n(.*?)```", README, re.S)
    example = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(example)
    data.qvel[0], data.ctrl[0] = 0.1, 1.0
    mujoco.mj_step(example, data, 20)
    assert data.sensordata[0] != 0.0
    (weights,) = re.findall(r"```text\n(.*?)```", README, re.S)
    net = core.Narx(weights)
    assert (net.sample_time, net.inputs) == (0.002, 4)


def test_readme_counts_the_state() -> None:
    numbers = [int(line.split("|")[1]) for line in section("State").splitlines() if re.match(r"\| \d", line)]
    base, chain, line, past = numbers
    assert model("bingham", plain("bingham")).plugin_statenum.tolist() == [base + chain, 14]
    for name in ("command_delay_d", "command_delay_period"):
        assert model("bingham", {**plain("bingham"), name: 0.1}).plugin_statenum[0] == base + chain + line
    assert model("narx", plain("narx")).plugin_statenum[0] == base + chain + past
