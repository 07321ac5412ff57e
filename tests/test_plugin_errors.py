"""A bad attribute fails at compile with one line: element, attribute, value, what is allowed. The C table, Python, what
MJCF takes, and the plugin's README are one list of attributes."""

from __future__ import annotations

import math
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjcf_builders import BINGHAM, BOUC_WEN, DYKE, Damper, Sensor, Values, compiled, config, document, slider
from modules import TOOLS, loaded
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


LAWS = ("bingham", "bouc_wen", "hyperbolic_tangent", "modified_bouc_wen", "narx")
# law, attributes, parts of the message
ATTRIBUTES: tuple[tuple[str, Values, tuple[str, ...]], ...] = (
    ("bingam", BINGHAM, ("'law'", "'bingam'", *LAWS)),
    ("", {"c0a": 150.0}, ("'law'", "missing", *LAWS)),
    ("bingham", {k: v for k, v in BINGHAM.items() if k != "fyb"}, ("law bingham needs", "'fyb'", "(N per command)")),
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
    broken = document(slider(1.0), [Damper("narx", {"weights": "text:net"})], (), extra=extra)
    says(complaint(broken, "actuator 'mr'"), ("text:net", "`weight`"))


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


@pytest.mark.parametrize("name", ["c0x", "c0a"])
def test_unknown_and_double_attributes_are_the_engines_errors(name: str) -> None:
    row = config({name: 1.0})
    with pytest.raises(ValueError, match=name):
        compiled(damped("bingham", BINGHAM).replace("</instance>", row + "</instance>"))


def test_long_values_are_shortened() -> None:
    for value in ("9" * 400 + "x", "x" * 5000, "%s%n" * 200):
        line = complaint(damped("bingham", {**BINGHAM, "c0a": value}), "actuator 'mr'")
        says(line, (value[:40], "is not a number"))


NET = f'<custom><text name="net" data="{random_network(1, (3,)).text()}"/></custom>'


def of_law(law: str, values: Values, sensor: Values | None = None) -> str:
    """A model of a damper with all that its law needs."""
    good: dict[str, float | str] = dict.fromkeys(core.law_parameters(law), 1.0) or {"weights": "text:net"}
    sensors = [Sensor(attributes=sensor or {})]
    return document(slider(1.0), [Damper(law, {**good, **values})], sensors, extra=NET)


@pytest.mark.parametrize("law", core.laws())
def test_mjcf_takes_what_the_table_says(law: str) -> None:
    """Each attribute: missing where it is the law's, as text, out of range, and alone beside the law's own."""
    own = core.law_parameters(law)
    for name in own:
        line = complaint(of_law(law, {}).replace(config({name: 1.0}), "", 1), "actuator 'mr'")
        assert f"'{name}'" in line
    for row in core.attributes():
        says(complaint(of_law(law, {row.name: "much"}), "actuator 'mr'"), (f"'{row.name}'", "'much'"))
        foreign = row.group in ("law", "dependence") and row.name not in {*own, *core.law_options(law)}
        value = min(max(0.5 if row.default is None else row.default, row.minimum), row.maximum)
        if foreign:
            line = complaint(of_law(law, {row.name: value}), "actuator 'mr'")
            says(line, (f"'{row.name}' = ", f"is no parameter of law {law}"))
        elif row.name not in own:
            compiled(of_law(law, {row.name: value}))
        for bound, beyond in ((row.minimum, -1.0), (row.maximum, 1.0)):
            if math.isfinite(bound) and not foreign:
                says(complaint(of_law(law, {row.name: bound + beyond}), "actuator 'mr'"), (row.name, "outside"))


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


def test_attributes_of_an_effect_have_its_name_and_defaults_in_range() -> None:
    for row in core.attributes():
        assert row.group in {"law", "dependence", "command", "numerics"} or row.name.startswith(f"{row.group}_")
        assert row.minimum < row.maximum
        assert row.default is None or row.minimum <= row.default <= row.maximum


def test_sensor_takes_what_the_readme_says() -> None:
    options, signals = section("The force sensor").split("| signal | unit |")
    names = [name for name in first_column(options) if name != "signal"]
    assert {name for name in names if name.startswith("sensor_")} < set(NAMES)
    assert len(names) == 13
    for name in names:
        value = 0.5 if name == "sensor_lag_ratio" else 1.0  # a damping below the critical one
        compiled(of_law("bingham", {}, {name: value}))
    assert len(first_column(signals)) == 12
    for name in first_column(signals):
        compiled(of_law("bingham", {}, {"signal": name}))
    with pytest.raises(ValueError, match="driver_lag_tau"):
        compiled(of_law("bingham", {}, {"driver_lag_tau": 1.0}))


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
    for law, values, more in (
        ("bingham", {}, 0), ("bingham", {"command_delay_d": 0.1}, line),
        ("bingham", {"command_delay_period": 0.1}, line), ("narx", {}, past),
    ):  # fmt: skip
        assert compiled(of_law(law, values))[0].plugin_statenum.tolist() == [base + chain + more, 14]
