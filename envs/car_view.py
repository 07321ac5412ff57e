"""Rendering of the quarter car: wheel, strut and body over the road ahead and behind."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import mujoco
import numpy as np

from mrdamp.envs.car_xml import car_xml
from mrdamp.envs.view import View, connector
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.structures.cars import QuarterCar

# No orange but the current's.
_ROAD, _COIL = np.array([0.30, 0.32, 0.35, 1.0]), np.array([0.45, 0.60, 0.52, 1.0])
_PLACES = np.linspace(-1.6, 1.6, 81)  # m, from the wheel's centre
_TURNS, _COIL_RADIUS = 6, 0.065


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
