"""Rendering of the cable: the slide chain with its sag, posed by the natural coordinates."""

from __future__ import annotations

import numpy as np

from mrdamp.envs.cable_xml import chain_xml
from mrdamp.envs.view import View
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.structures.cables import StayCable

_SEGMENTS = 50


class CableView(View):
    """One cable; its motion is drawn from the sagged shape at rest."""

    def __init__(self, cable: StayCable, damper: Model, camera: str, size: tuple[int, int]) -> None:
        super().__init__(chain_xml(cable, damper, _SEGMENTS), "cable", camera, size)
        self.shape = cable.at(np.arange(1, _SEGMENTS) / _SEGMENTS)

    def pose(self, qpos: Array, exaggeration: float) -> None:
        self.data.qpos[:] = exaggeration * (self.shape @ qpos)
