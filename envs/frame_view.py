"""Rendering of the frame: floors on leaning columns, the damper in its storey."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import mujoco
import numpy as np

from mrdamp.envs.frame_xml import frame_xml
from mrdamp.envs.view import View, connector
from mrdamp.model import Model
from mrdamp.model.core import Array

_COLUMN = np.array([0.30, 0.36, 0.44, 1.0])
_BRACE = np.array([0.52, 0.47, 0.40, 1.0])
_CORNERS = ((-0.25, -0.15), (-0.25, 0.15), (0.25, -0.15), (0.25, 0.15))  # m, of the slabs
_HALF = 0.02  # m, of a slab's thickness


class FrameView(View):
    """One frame, seen from its own table: drifts are drawn, the ground's motion is not."""

    def __init__(self, models: Sequence[Model], camera: str, size: tuple[int, int]) -> None:
        super().__init__(frame_xml(models, 1e-3, drawn=True), "frame3", camera, size)
        m = self.model
        structure = models[0].structure
        assert structure is not None
        self.floors = [m.body("table").id, *(m.body(f"floor{j}").id for j in range(1, structure.storeys + 1))]
        self.joints = [m.joint(f"storey{j}").qposadr[0] for j in range(1, structure.storeys + 1)]
        for k in range(m.ngeom):
            if not m.geom(k).name and m.geom_bodyid[k] in self.floors and m.geom_size[k, 2] > 0.1:
                m.geom_group[k] = 5  # the rigid columns: leaning ones are drawn in their place
        m.mat("brace").rgba = _BRACE  # no orange but the current's
        if structure.storeys > 3:  # further away, and aimed at half the height
            top = self._height()
            for name in ("front", "corner"):
                m.camera(name).pos *= top / 1.66

    def _height(self) -> float:
        mujoco.mj_kinematics(self.model, self.data)
        return float(self.data.xpos[self.floors[-1], 2])

    def pose(self, qpos: Array, exaggeration: float) -> None:
        # The row's first joint is the table's; here it stays where it is.
        self.data.qpos[self.joints] = exaggeration * qpos[1 : 1 + len(self.joints)]

    def connect(self, scene: mujoco.MjvScene) -> None:
        places = self.data.xpos[self.floors]
        for low, high in itertools.pairwise(places):
            for x, y in _CORNERS:
                corner = np.array([x, y, 0.0])
                start = low + corner + [0, 0, 0.06 if low is places[0] else _HALF]
                connector(scene, start, high + corner - [0, 0, _HALF], 0.009, _COLUMN)
