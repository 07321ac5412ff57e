"""A damper in an environment as MJCF: the plugin and its sensors."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from mrdamp.model import Model
from mrdamp.simulation.mjcf import child, configure, drop, get, plugin_sensor

#: In this order; `pull` is the damper's mean force on the structure over a step.
SIGNALS = ("force", "true_force", "stroke", "stroke_velocity", "current", "pull")

# The engine's own sensors are quicker than the plugin's and read the same numbers.
_ENGINES = {"stroke": "actuatorpos", "stroke_velocity": "actuatorvel", "pull": "actuatorfrc"}


def add_sensor(group: ET.Element, signal: str, name: str, actuator: str, model: Model) -> None:
    """Appends the sensor of one of `SIGNALS` of a damper (an actuator's name) to a group of sensors."""
    # Only the plugin can give a shifted stroke (`channel_shift`).
    if signal in _ENGINES and not (signal == "stroke" and model.attributes.get("channel_shift_d", 0.0)):
        ET.SubElement(group, _ENGINES[signal], name=name, actuator=actuator)
    else:
        plugin_sensor(group, signal, name, actuator)


def add_damper(root: ET.Element, damper: Model, **place: str) -> None:
    """The plugin as actuator `damper` in place, as tendon="stroke" or joint="suspension", and its sensors."""
    extension, actuator = get(root, "extension"), get(root, "actuator")
    plugin = ET.SubElement(extension, "plugin", plugin="mrdamp.damper")
    configure(root, ET.SubElement(plugin, "instance", name="damper"), damper)
    ET.SubElement(extension, "plugin", plugin="mrdamp.force_sensor")
    ET.SubElement(actuator, "plugin", place, name="damper", plugin="mrdamp.damper", instance="damper")
    sensor = child(root, "sensor")
    for name in ("stroke", "stroke_velocity"):
        drop(sensor, f"*[@name='{name}']")
    for signal in SIGNALS:
        add_sensor(sensor, signal, signal, "damper", damper)


def remove_damper(root: ET.Element) -> None:
    """Removes every plugin and its sensors."""
    for tag in ("extension", "actuator", "sensor"):
        drop(get(root, tag), "plugin")


def actuator_name(k: int) -> str:
    """Of damper k, from 0: `damper`, `damper_2`, `damper_3` ..."""
    return "damper" if k == 0 else f"damper_{k + 1}"
