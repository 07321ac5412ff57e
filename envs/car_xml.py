"""The quarter car's MJCF for an environment: the shipped model with a car's own parameters and damper."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from mrdamp import models_xml
from mrdamp.envs.damper_sensors import add_damper, get, remove_damper
from mrdamp.envs.frame_xml import strip
from mrdamp.model import Model
from mrdamp.structures.cars import QuarterCar

_NEVER = 1e9  # N, on a tyre


def car_xml(car: QuarterCar, damper: Model, timestep: float, *, drawn: bool = False) -> str:
    """MJCF text with the sensors of a frame of two floors, wheel and body. drawn: with visual elements.

    Controls: `road` (m/s2), `tyre` (without effect) and `damper`.
    """
    root = ET.fromstring(models_xml.path("quarter_car").read_text(encoding="utf-8"))
    option = get(root, "option")
    option.set("timestep", repr(timestep))
    get(option, "flag").set("constraint", "disable")
    for name, mass in (("wheel", car.wheel), ("body", car.body)):
        get(root, f".//body[@name='{name}']/inertial").set("mass", repr(mass))
    spring = get(root, ".//joint[@name='suspension']")
    spring.set("stiffness", repr(car.stiffness))
    spring.set("damping", repr(car.damping))
    tyre = get(root, "actuator/general[@name='tyre']")
    tyre.set("biasprm", f"0 {-car.tyre_stiffness!r} {-car.tyre_damping!r}")
    tyre.set("forcerange", f"{-car.weight!r} {_NEVER!r}")
    remove_damper(root)
    sensor = get(root, "sensor")
    for j, joint in ((1, "tyre"), (2, "suspension")):
        ET.SubElement(sensor, "jointvel", name=f"drift_velocity_{j}", joint=joint)
    add_damper(root, damper, joint="suspension")
    if not drawn:
        strip(root)
    return ET.tostring(root, encoding="unicode")
