"""A damper in an environment as MJCF: the plugin and its sensors."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.simulation.mjcf import damper_config

#: In this order; `pull` is the damper's mean force on the structure over a step.
SIGNALS = ("force", "true_force", "stroke", "stroke_velocity", "current", "pull")

# The engine's own sensors are quicker than the plugin's and read the same numbers.
_ENGINES = {"stroke": "actuatorpos", "stroke_velocity": "actuatorvel", "pull": "actuatorfrc"}


def add_sensor(group: ET.Element, signal: str, name: str, actuator: str, model: Model) -> None:
    """Appends the sensor of one of `SIGNALS` of a damper (an actuator's name) to a group of sensors."""
    # Only the plugin can give a shifted stroke (`channel_shift`).
    if signal in _ENGINES and not (signal == "stroke" and model.attributes.get("channel_shift_d", 0.0)):
        ET.SubElement(group, _ENGINES[signal], name=name, actuator=actuator)
        return
    item = ET.SubElement(
        group, "plugin", name=name, plugin="mrdamp.force_sensor", objtype="actuator", objname=actuator
    )
    if signal != "force":
        ET.SubElement(item, "config", key="signal", value=signal)


def add_damper(root: ET.Element, damper: Model, **place: str) -> None:
    """The plugin as actuator `damper` in place, as tendon="stroke" or joint="suspension", and its sensors."""
    extension, actuator = get(root, "extension"), get(root, "actuator")
    plugin = ET.SubElement(extension, "plugin", plugin="mrdamp.damper")
    instance = ET.SubElement(plugin, "instance", name="damper")
    for key, value in damper_config(damper).items():
        ET.SubElement(instance, "config", key=key, value=value)
    if damper.weights is not None:
        custom = ET.SubElement(root, "custom")
        ET.SubElement(custom, "text", name="damper_weights", data=" ".join(damper.weights.split()))
    ET.SubElement(extension, "plugin", plugin="mrdamp.force_sensor")
    ET.SubElement(actuator, "plugin", place, name="damper", plugin="mrdamp.damper", instance="damper")
    sensor = root.find("sensor")
    sensor = ET.SubElement(root, "sensor") if sensor is None else sensor
    for name in ("stroke", "stroke_velocity"):
        for item in sensor.findall(f"*[@name='{name}']"):
            sensor.remove(item)
    for signal in SIGNALS:
        add_sensor(sensor, signal, signal, "damper", damper)


def remove_damper(root: ET.Element) -> None:
    """Removes every plugin and its sensors."""
    for group in (get(root, tag) for tag in ("extension", "actuator", "sensor")):
        for item in group.findall("plugin"):
            group.remove(item)


def get(root: ET.Element, path: str) -> ET.Element:
    """The element at a path below root. Raises InputError where a shipped file lacks it."""
    found = root.find(path)
    if found is None:
        raise InputError(f"the structure's file has no <{path}>; reinstall mrdamp")
    return found


def actuator_name(k: int) -> str:
    """Of damper k, from 0: `damper`, `damper_2`, `damper_3` ..."""
    return "damper" if k == 0 else f"damper_{k + 1}"
