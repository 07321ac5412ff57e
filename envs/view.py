"""Rendering of an environment: exaggerated motion, and the coil's current as the damper's colour."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mrdamp import models_xml
from mrdamp.errors import InputError
from mrdamp.model.core import Array

Image = NDArray[np.uint8]

_OFF, _ON = np.array([0.16, 0.35, 0.62, 1.0]), np.array([0.96, 0.49, 0.10, 1.0])  # as in the pictures


def has_display() -> bool:
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class View:
    """A drawing of one row.

    xml: of the rendered model. folder: of `models_xml`, for light and ground. camera: a
    name of the model's. size: width and height, pixels. Raises InputError.
    """

    def __init__(self, xml: str, folder: str, camera: str, size: tuple[int, int]) -> None:
        scene = models_xml.path(folder, "scene.xml").read_text(encoding="utf-8")
        self.model = mujoco.MjModel.from_xml_string(scene, {"model.xml": xml.encode()})
        self.data = mujoco.MjData(self.model)
        self.camera, self.size = camera, size
        self.cylinders = [
            k for k in range(self.model.ngeom) if self.model.geom(k).name.startswith("cylinder")
        ]
        self.model.geom_matid[self.cylinders] = -1  # a material's colour would go before the geom's own
        self.model.vis.map.force = 0.0  # the plugin's own arrow would show a damper at rest
        self._renderer: mujoco.Renderer | None = None
        self._viewer: Any = None
        self._shown = 0.0

    def pose(self, qpos: Array, exaggeration: float) -> None:
        """Sets the drawing's joints from the row's coordinates, by default the same ones."""
        self.data.qpos[:] = exaggeration * qpos

    def connect(self, scene: mujoco.MjvScene) -> None:
        """Adds shapes between bodies; none by default."""
        return

    def update(self, qpos: Array, exaggeration: float, shares: Sequence[float]) -> None:
        """Renders the row's state; shares: of each damper's current in its largest, 0 to 1."""
        self.pose(qpos, exaggeration)
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        mujoco.mj_tendon(self.model, self.data)
        for geom, share in zip(self.cylinders, shares, strict=False):
            on = min(abs(share), 1.0)
            self.model.geom_rgba[geom] = (1 - on) * _OFF + on * _ON

    def image(self) -> Image:
        """(height, width, 3) of the last update."""
        if self._renderer is None:
            self._renderer = self._make_renderer()
        self._renderer.update_scene(self.data, self.camera)
        self.connect(self._renderer.scene)
        return np.array(self._renderer.render(), dtype=np.uint8)

    def _make_renderer(self) -> mujoco.Renderer:
        width, height = self.size
        try:
            return mujoco.Renderer(self.model, height, width)
        except Exception as error:  # each platform's library has an error of its own
            reason = str(error).strip().splitlines() or [type(error).__name__]
            raise InputError(
                f"no picture: {reason[0]}; without a display set MUJOCO_GL=egl before Python starts"
            ) from None

    def show(self, period: float) -> None:
        """In a window, no faster than one update a period (s)."""
        if self._viewer is None:
            import mujoco.viewer

            self._viewer = mujoco.viewer.launch_passive(
                self.model, self.data, show_left_ui=False, show_right_ui=False
            )
            self._viewer.cam.type = mujoco.mjtCamera.mjCAMERA_FIXED
            self._viewer.cam.fixedcamid = self.model.camera(self.camera).id
        if not self._viewer.is_running():
            return
        with self._viewer.lock():
            self._viewer.user_scn.ngeom = 0
            self.connect(self._viewer.user_scn)
        self._viewer.sync()
        time.sleep(max(0.0, self._shown + period - time.monotonic()))
        self._shown = time.monotonic()

    def close(self) -> None:
        """Frees the window and the graphics context."""
        if self._renderer is not None:
            self._renderer.close()
        if self._viewer is not None:
            self._viewer.close()
        self._renderer = self._viewer = None


def connector(scene: mujoco.MjvScene, start: Array, end: Array, radius: float, rgba: Array) -> None:
    """A bar between two points, if the scene has room."""
    if scene.ngeom >= scene.maxgeom:
        return
    geom, kind = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_CAPSULE
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), rgba.astype(np.float32))
    mujoco.mjv_connector(geom, kind, radius, start, end)
    scene.ngeom += 1
