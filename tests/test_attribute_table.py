"""The C table, `attributes.def`, Python, what MJCF takes, and the plugin's README: one list of attributes."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import pytest

from mjcf_builders import Damper, Sensor, Values, compiled, document, slider
from modules import TOOLS, loaded
from mrdamp.model import core
from mrdamp.model.attributes import effects

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
    stale = README.replace("| `driver_lag_tau` |", "| `driver_lag_tao` |")
    assert stale != README
    assert tool.replaced(stale) == README
    with pytest.raises(ValueError, match="markers"):
        tool.replaced("no tables here")


def test_readme_lists_every_attribute_once() -> None:
    assert sorted(first_column(section("Attributes"))) == sorted(NAMES)
    assert len(set(NAMES)) == len(NAMES)


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
