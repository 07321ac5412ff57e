"""What is read of a damper in an environment, as MJCF sensors."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from mrdamp.model import Model

#: In this order; `pull` is the damper's mean force on the structure over a step.
SIGNALS = ("force", "true_force", "stroke", "stroke_velocity", "current", "pull")

# The engine's own sensors are quicker than the plugin's and read the same numbers.
_ENGINES = {"stroke": "actuatorpos", "stroke_velocity": "actuatorvel", "pull": "actuatorfrc"}


def add_sensor(group: ET.Element, signal: str, name: str, actuator: str, model: Model) -> None:
    """Appends the sensor of one of `SIGNALS` of a damper (an actuator's name) to a group of sensors."""
    # A stroke read early or late (`channel_shift`) is the plugin's to give.
    if signal in _ENGINES and not (signal == "stroke" and model.attributes.get("channel_shift_d", 0.0)):
        ET.SubElement(group, _ENGINES[signal], name=name, actuator=actuator)
        return
    item = ET.SubElement(
        group, "plugin", name=name, plugin="mrdamp.force_sensor", objtype="actuator", objname=actuator
    )
    if signal != "force":
        ET.SubElement(item, "config", key="signal", value=signal)
