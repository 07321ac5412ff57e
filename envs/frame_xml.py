"""The frame's MJCF for an environment: any number of dampers, and the sensors that rewards and energies need."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace

from mrdamp.control.base import sensor_name as sensor_name
from mrdamp.envs.damper_sensors import SIGNALS, actuator_name, add_sensor, get
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.simulation.mjcf import mjcf
from mrdamp.structures import ShearFrame, dyke1996

Position = tuple[int, int]

_DRAWN_ONLY = ("asset", "visual", "statistic")


def frame_models(
    model: Model | Sequence[Model], structure: ShearFrame | None, positions: Sequence[Position]
) -> tuple[Model, ...]:
    """One model of rig `frame` for each position, in the same structure. Raises InputError.

    model: one for all positions or one each. structure: None takes that of the first model, or Dyke's frame where it
    has none. Effects of the structure and its sensors are those of the first model.
    """
    if not positions:
        raise InputError("damper_between is empty; allowed: at least one pair of floors")
    models = [model] * len(positions) if isinstance(model, Model) else list(model)
    if len(models) != len(positions):
        raise InputError(f"{len(models)} models for {len(positions)} damper positions; give one, or one each")
    structure = structure or models[0].structure or dyke1996()
    return tuple(
        replace(m, rig="frame", structure=replace(structure, damper_between=position))
        for m, position in zip(models, positions, strict=True)
    )


def frame_xml(models: Sequence[Model], timestep: float, *, drawn: bool = False) -> str:
    """MJCF text of the frame of `frame_models`; without purely visual elements unless `drawn`."""
    root = ET.fromstring(mjcf(models[0], timestep=timestep))
    for k, model in enumerate(models[1:], 1):
        _add_damper(root, ET.fromstring(mjcf(model, timestep=timestep)), k)
    # No limits, no equalities: the engine skips their detection.
    get(root, "option/flag").set("constraint", "disable")
    sensor = get(root, "sensor")
    structure = models[0].structure
    assert structure is not None
    for j in range(1, structure.storeys + 1):
        ET.SubElement(sensor, "jointvel", name=f"drift_velocity_{j}", joint=f"storey{j}")
    for old in sensor.findall("plugin"):
        sensor.remove(old)
    for signal in SIGNALS:
        for k, model in enumerate(models):
            add_sensor(sensor, signal, sensor_name(signal, k), actuator_name(k), model)
    if not drawn:
        strip(root)
    return ET.tostring(root, encoding="unicode")


def _add_damper(root: ET.Element, other: ET.Element, k: int) -> None:
    """Copies the damper of another frame's file, with its visual elements, into this one as damper k."""
    name, plugin = actuator_name(k), "extension/plugin[@plugin='mrdamp.damper']"
    instance = copy.deepcopy(get(other, f"{plugin}/instance[@name='damper']"))
    instance.set("name", name)
    get(root, plugin).append(instance)
    actuator = copy.deepcopy(get(other, "actuator/plugin[@name='damper']"))
    actuator.set("name", name)
    actuator.set("instance", name)
    get(root, "actuator").append(actuator)
    for config in instance.findall("config[@key='weights']"):
        text = copy.deepcopy(get(other, "custom/text"))
        text.set("name", f"weights_{k + 1}")
        config.set("value", f"text:weights_{k + 1}")
        custom = root.find("custom")
        (ET.SubElement(root, "custom") if custom is None else custom).append(text)
    tendon = actuator.get("tendon")
    if tendon is not None:
        actuator.set("tendon", f"{tendon}_{k + 1}")
        path = copy.deepcopy(get(other, "tendon/fixed"))
        path.set("name", f"{tendon}_{k + 1}")
        group = root.find("tendon")
        (ET.SubElement(root, "tendon") if group is None else group).append(path)
    for body in other.iter("body"):
        for geom in body.findall("geom"):
            drawn = geom.get("name")
            if drawn in ("bracket", "cylinder", "rod", "brace_left", "brace_right", "clevis"):
                part = copy.deepcopy(geom)
                part.set("name", f"{drawn}_{k + 1}")
                place = get(root, f".//body[@name='{body.get('name')}']")
                place.insert(list(place).index(get(place, "joint")) + 1, part)


def strip(root: ET.Element) -> None:
    """Removes purely visual elements."""
    for tag in _DRAWN_ONLY:
        for item in root.findall(tag):
            root.remove(item)
    for body in root.iter("body"):
        for tag in ("geom", "camera"):
            for item in body.findall(tag):
                body.remove(item)
    for default in root.iter("default"):
        for geom in default.findall("geom"):
            default.remove(geom)
