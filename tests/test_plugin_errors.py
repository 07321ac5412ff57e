"""A bad attribute fails at compile with one line: element, attribute, value, what is allowed. The C table and
what MJCF takes are one list of attributes."""

from __future__ import annotations

import math
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjcf_builders import BINGHAM, BOUC_WEN, DYKE, Damper, Sensor, Values, compiled, config, document, slider
from modules import TOOLS, loaded
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
    ("narx", {"c0a": 1.0}, ("'c0a'", "'1.0'", "law narx", "none")),
    (
        "bingham", {**BINGHAM, "trapped_gas_time": 0.2, "trapped_gas_direction": 0.0},
        ("trapped_gas_time = 0.2", "trapped_gas_direction"),
    ),
    ("bouc_wen", {**BOUC_WEN, "gamma": 1.0, "beta": -1.0}, ("beta + gamma = 0", "above 0")),
    ("modified_bouc_wen", {**DYKE, "c1a": 0.0}, ("c1a = 0", "above 0")),
    ("bingham", {**BINGHAM, "command_min": 2.0, "command_max": 1.0}, ("command_min = 2", "_max = 1")),
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
        ({"sensitivity": 0.0}, ("'sensitivity'", "0", "pC/N")),
    ],
)
def test_attributes_of_the_sensor(attributes: Values, parts: tuple[str, ...]) -> None:
    text = document(slider(1.0), [Damper("bingham", BINGHAM)], [Sensor("f", "mr", attributes)])
    says(complaint(text, "sensor 'f'"), parts)


NET = f'<custom><text name="net" data="{random_network(1, (3,)).text()}"/></custom>'


def of_law(law: str, values: Values, sensor: Values | None = None) -> str:
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


def test_readme_has_the_tables_of_now() -> None:
    tool = loaded(TOOLS / "attribute_table.py")
    assert tool.replaced(README) == README, "run: python tools/attribute_table.py"
    stale = README.replace("- `driver_lag_tau`:", "- `driver_lag_tao`:")
    assert stale != README
    assert tool.replaced(stale) == README
    with pytest.raises(ValueError, match="markers"):
        tool.replaced("no tables here")


def test_readme_examples_work() -> None:
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
    state = README.split("\n## State\n", 1)[1].split("\n## ", 1)[0]
    base, chain, line, past = (int(row.split("|")[1]) for row in state.splitlines() if re.match(r"\| \d", row))
    for law, values, more in (
        ("bingham", {}, 0), ("bingham", {"command_delay_d": 0.1}, line),
        ("bingham", {"command_delay_period": 0.1}, line), ("narx", {}, past),
    ):  # fmt: skip
        assert compiled(of_law(law, values))[0].plugin_statenum.tolist() == [base + chain + more, 14]
