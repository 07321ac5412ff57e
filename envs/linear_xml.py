"""MJCF of a structure given by matrices, and its drawing: a slide for each coordinate, springs and dashpots between."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from mrdamp.envs.view import View
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.mjcf import add_damper
from mrdamp.structures.mechanics import Mechanics

_APART = 0.5  # m, of the bodies as drawn


def linear_xml(name: str, system: Mechanics, damper: Model, timestep: float, *, drawn: bool = False) -> str:
    """One body on a slide for each coordinate, a tendon for each spring and dashpot between two. drawn: with shapes.

    Controls: `load_1` ... and `damper`, on the tendon `stroke`. Raises InputError where mass, stiffness or damping are
    not those of bodies, springs and dashpots.
    """
    mass, stiffness, damping = system.mass, system.stiffness, system.damping
    elastic = {"stiffness": stiffness, "damping": damping}
    off = ~np.eye(len(mass), dtype=bool)
    small = {what: 1e-9 * np.abs(matrix).max() for what, matrix in elastic.items()}
    whole = all((m[off] <= small[k]).all() and (m.sum(axis=1) >= -small[k]).all() for k, m in elastic.items())
    if np.abs(mass[off]).any() or not whole:
        raise InputError(f"{name}: its matrices are not those of bodies and springs; use engine chain, or write mjcf()")
    root = ET.Element("mujoco", model=f"mrdamp_{name}")
    ET.SubElement(root, "compiler", autolimits="true")
    option = ET.SubElement(root, "option", timestep=repr(timestep), gravity="0 0 0", integrator="Euler")
    # No limits, no equalities: the engine skips their detection.
    ET.SubElement(option, "flag", contact="disable", constraint="disable", autoreset="disable")
    ET.SubElement(root, "extension")
    world, actuator = ET.SubElement(root, "worldbody"), ET.SubElement(root, "actuator")
    tendon, n = ET.SubElement(root, "tendon"), len(mass)
    height = f"{0.5 * _APART * n:g}"
    ET.SubElement(world, "camera", name="front", pos=f"0 {-1.2 - 0.9 * _APART * n:g} {height}", xyaxes="1 0 0 0 0 1")

    def values(matrix: dict[str, float]) -> dict[str, str]:
        return {what: repr(max(float(x), 0.0)) for what, x in matrix.items()}

    for i in range(n):
        body = ET.SubElement(world, "body", name=f"q{i + 1}", pos=f"0 0 {_APART * (i + 0.5):g}")
        ET.SubElement(body, "inertial", pos="0 0 0", mass=repr(float(mass[i, i])), diaginertia="1 1 1")
        own = values({what: m[i].sum() for what, m in elastic.items()})
        ET.SubElement(body, "joint", own, name=f"q{i + 1}", type="slide", axis="1 0 0")
        if drawn:
            ET.SubElement(body, "geom", type="box", size="0.3 0.2 0.04", rgba="0.30 0.36 0.44 1", mass="0")
    for i, j in zip(*np.nonzero(np.triu(np.abs(stiffness) + np.abs(damping), 1)), strict=True):
        between = values({what: -m[i, j] for what, m in elastic.items()})
        _along(ET.SubElement(tendon, "fixed", between, name=f"q{i + 1}_q{j + 1}"), {i: 1.0, j: -1.0})
    _along(ET.SubElement(tendon, "fixed", name="stroke"), dict(enumerate(system.stroke)))
    for k, column in enumerate(system.load.T):
        on = np.flatnonzero(column)
        place = {"joint": f"q{on[0] + 1}"} if len(on) == 1 and column[on[0]] == 1.0 else {"tendon": f"load_{k + 1}"}
        if "tendon" in place:
            _along(ET.SubElement(tendon, "fixed", name=f"load_{k + 1}"), dict(enumerate(column)))
        ET.SubElement(actuator, "motor", place, name=f"load_{k + 1}")
    add_damper(root, damper, tendon="stroke")
    return ET.tostring(root, encoding="unicode")


def _along(tendon: ET.Element, share: dict[int, float]) -> None:
    for i, coefficient in share.items():
        if coefficient:
            ET.SubElement(tendon, "joint", joint=f"q{i + 1}", coef=repr(float(coefficient)))


class LinearView(View):
    """One structure, its slides where the coordinates are."""

    def __init__(self, xml: str, camera: str, size: tuple[int, int]) -> None:
        super().__init__(xml, "frame3", camera, size)

    def pose(self, qpos: Array, exaggeration: float) -> None:
        self.data.qpos[:] = exaggeration * qpos
