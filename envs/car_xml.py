"""The quarter car's MJCF for an environment, with a car's own parameters and damper, and its drawing over the road."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from itertools import pairwise

import mujoco
import numpy as np

from mrdamp.envs.frame_xml import strip
from mrdamp.envs.view import View, connector
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.mjcf import add_damper, get, remove_damper, shipped
from mrdamp.structures.cars import QuarterCar

_NEVER = 1e9  # N, on a tyre
# No orange but the current's.
_ROAD, _COIL = np.array([0.30, 0.32, 0.35, 1.0]), np.array([0.45, 0.60, 0.52, 1.0])
_PLACES = np.linspace(-1.6, 1.6, 81)  # m, from the wheel's centre
_TURNS, _COIL_RADIUS = 6, 0.065


def car_xml(car: QuarterCar, damper: Model, timestep: float, *, drawn: bool = False) -> str:
    """MJCF text with the sensors of a frame of two floors, wheel and body. drawn: with visual elements.

    Controls: `road` (m/s2), `tyre` (without effect) and `damper`.
    """
    root = shipped("quarter_car")
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


class CarView(View):
    """One car. ahead: heights (n,) m of the road at places (n,) m ahead of the wheel."""

    def __init__(
        self,
        car: QuarterCar,
        damper: Model,
        ahead: Callable[[Array], Array],
        camera: str,
        size: tuple[int, int],
    ) -> None:
        super().__init__(car_xml(car, damper, 1e-3, drawn=True), "quarter_car", camera, size)
        self._ahead = ahead
        self._larger = 1.0

    def pose(self, qpos: Array, exaggeration: float) -> None:
        self.data.qpos[:] = exaggeration * qpos
        self._larger = exaggeration

    def connect(self, scene: mujoco.MjvScene) -> None:
        heights = self._larger * self._ahead(_PLACES) - 0.012
        line = np.stack([_PLACES, np.zeros_like(heights), heights], axis=1)
        for low, high in pairwise(line):
            connector(scene, low, high, 0.012, _ROAD)
        seat = self.data.geom_xpos[self.model.geom("seat").id]
        tower = self.data.geom_xpos[self.model.geom("tower").id]
        angle = np.linspace(0.0, 2 * np.pi * _TURNS, 12 * _TURNS + 1)
        share = np.linspace(0.0, 1.0, len(angle))
        coil = seat + share[:, None] * (tower - seat)
        coil += _COIL_RADIUS * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
        for low, high in pairwise(coil):
            connector(scene, low, high, 0.007, _COIL)
