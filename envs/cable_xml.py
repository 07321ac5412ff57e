"""MJCF of structures given by matrices and of stay cables, and their drawings."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from mrdamp.envs.view import View
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.mjcf import add_damper, get, remove_damper, shipped
from mrdamp.structures import GRAVITY, FloatArray
from mrdamp.structures.cables import StayCable
from mrdamp.structures.lumped import Mechanics

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


_DRAWN = 50  # segments of the drawing


def chain_xml(cable: StayCable, damper: Model | None = None, segments: int = 50) -> str:
    """The shipped chain (`models_xml/cable`) for any cable: equal segments, the damper on the nodes about its place.

    A spatial tendon through all nodes is the cable: its tension turns with its path and rises with its length, which
    is the stiffness of the sagged cable too. Its spring is such that Irvine's parameter is the cable's, or the least
    there can be, (m g L / T)^2, where the spring has no length at rest. Raises InputError.
    """
    if segments < 4:
        raise InputError(f"cable: {segments} segments; allowed: 4 or more")
    root = shipped("cable")
    step = cable.length / segments
    weight = cable.mass * GRAVITY
    x = step * np.arange(segments + 1)
    # Equilibrium with constant tension along the path: the sine of the slope rises by equal steps.
    sine = weight * step / cable.tension * (np.arange(segments) - 0.5 * (segments - 1))
    z = np.append(0.0, np.cumsum(step * sine / np.sqrt(1 - sine**2)))
    world, tendon = get(root, "worldbody"), get(root, "tendon")
    for body in world.findall("body"):
        if (body.get("name") or "").startswith("node"):
            world.remove(body)
    path = get(tendon, "spatial")
    path[:] = []
    ET.SubElement(path, "site", site="anchor_low")
    for k in range(1, segments):
        place = f"{x[k]:.12g} 0 {z[k]:.12g}"
        body = ET.SubElement(world, "body", name=f"node{k}", pos=place, childclass="node")
        ET.SubElement(body, "joint", name=f"node{k}")
        ET.SubElement(body, "geom", mass=f"{cable.mass * step:.12g}")
        ET.SubElement(body, "site", name=f"node{k}")
        ET.SubElement(path, "site", site=f"node{k}")
    ET.SubElement(path, "site", site="anchor_high")
    get(root, ".//site[@name='anchor_high']").set("pos", f"{cable.length:.9g} 0 0")
    curved = float(np.hypot(np.diff(x), np.diff(z)).sum())
    least = (weight * cable.length / cable.tension) ** 2
    # Nodes that only move across the chord: the pull along it is the tension.
    stiffness = max(cable.sag, least) / least * cable.tension / cable.length
    path.set("stiffness", f"{stiffness:.15g}")
    path.set("springlength", f"{max(curved - cable.tension / stiffness, 0.0):.15g}")
    stroke = get(tendon, "fixed[@name='stroke']")
    stroke[:] = []
    position = cable.damper_at * segments
    low = int(position + 1e-9)
    share = max(position - low, 0.0)
    for node, part in ((low, 1 - share), (low + 1, share)):
        if part > 1e-9 and 0 < node < segments:
            ET.SubElement(stroke, "joint", joint=f"node{node}", coef=f"{part:.9g}")
    default = get(root, ".//default[@class='node']/joint")
    default.set("damping", f"{2 * cable.ratio * cable.first * cable.mass * step:.9g}")
    _place_damper(root, damper, cable, max(low, 1), z)
    for sensor in root.iter("jointpos"):
        sensor.set("joint", f"node{segments // 2}")
    return ET.tostring(root, encoding="unicode")


def _place_damper(root: ET.Element, damper: Model | None, cable: StayCable, node: int, z: FloatArray) -> None:
    """The plugin's attributes and visual elements at the damper's place; removed without a damper."""
    world = get(root, "worldbody")
    drawn = [get(shipped("cable"), f".//geom[@name='{name}']") for name in ("rod", "clamp")]
    remove_damper(root)
    if damper is None:
        for name in ("foot", "cylinder"):
            world.remove(get(world, f"geom[@name='{name}']"))
        return
    x = cable.damper_at * cable.length
    get(world, "geom[@name='foot']").set("pos", f"{x:.6g} 0 -0.66")
    get(world, "geom[@name='cylinder']").set("fromto", f"{x:.6g} 0 -0.42 {x:.6g} 0 -0.2")
    body = get(world, f"body[@name='node{node}']")
    for geom in drawn:
        body.append(geom)
    add_damper(root, damper, tendon="stroke")


class CableView(View):
    """One cable; its motion is drawn from the sagged shape at rest."""

    def __init__(self, cable: StayCable, damper: Model, camera: str, size: tuple[int, int]) -> None:
        super().__init__(chain_xml(cable, damper, _DRAWN), "cable", camera, size)
        self.shape = cable.at(np.arange(1, _DRAWN) / _DRAWN)

    def pose(self, qpos: Array, exaggeration: float) -> None:
        self.data.qpos[:] = exaggeration * (self.shape @ qpos)
