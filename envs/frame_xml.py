"""MJCF of frames and quarter cars for an environment, with the sensors that rewards need, and their drawings; the frame
in motion as an animated picture."""

from __future__ import annotations

import copy
import io
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from mrdamp.control.base import sensor_name as sensor_name
from mrdamp.envs.view import View, connector
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.mjcf import (
    DRAWN,
    SIGNALS,
    actuator_name,
    add_damper,
    add_sensor,
    child,
    drop,
    get,
    mjcf,
    remove_damper,
    shipped,
)
from mrdamp.simulation.stepping import FrameRun
from mrdamp.structures import ShearFrame, dyke1996
from mrdamp.structures.lumped import QuarterCar

Position = tuple[int, int]

_COLUMN = np.array([0.30, 0.36, 0.44, 1.0])
_BRACE = np.array([0.52, 0.47, 0.40, 1.0])
_CORNERS = ((-0.25, -0.15), (-0.25, 0.15), (0.25, -0.15), (0.25, 0.15))  # m, of the slabs
_HALF = 0.02  # m, of a slab's thickness


def frame_models(
    model: Model | Sequence[Model], structure: ShearFrame | None, positions: Sequence[Position]
) -> tuple[Model, ...]:
    """One model of rig `frame` for each position, in the same structure. Raises InputError.

    model: one for all positions or one each. structure: None takes that of the first model, or Dyke's frame where it
    has none. Effects of the structure and its sensors are those of the first model.
    """
    if not positions:
        raise InputError("damper_between is empty; allowed: at least one pair of floors")
    models = [model] * len(positions) if isinstance(model, Model) else list(model)
    if len(models) != len(positions):
        raise InputError(f"{len(models)} models for {len(positions)} damper positions; give one, or one each")
    structure = structure or models[0].structure or dyke1996()
    return tuple(
        replace(m, rig="frame", structure=replace(structure, damper_between=position))
        for m, position in zip(models, positions, strict=True)
    )


def frame_xml(models: Sequence[Model], timestep: float, *, drawn: bool = False) -> str:
    """MJCF text of the frame of `frame_models`; without purely visual elements unless `drawn`."""
    root = ET.fromstring(mjcf(models[0], timestep=timestep))
    for k, model in enumerate(models[1:], 1):
        _add_damper(root, ET.fromstring(mjcf(model, timestep=timestep)), k)
    # No limits, no equalities: the engine skips their detection.
    get(root, "option/flag").set("constraint", "disable")
    sensor = get(root, "sensor")
    structure = models[0].structure
    assert structure is not None
    for j in range(1, structure.storeys + 1):
        ET.SubElement(sensor, "jointvel", name=f"drift_velocity_{j}", joint=f"storey{j}")
    drop(sensor, "plugin")
    for signal in SIGNALS:
        for k, model in enumerate(models):
            add_sensor(sensor, signal, sensor_name(signal, k), actuator_name(k), model)
    if not drawn:
        strip(root)
    return ET.tostring(root, encoding="unicode")


def _add_damper(root: ET.Element, other: ET.Element, k: int) -> None:
    """Copies the damper of another frame's file, with its visual elements, into this one as damper k."""
    name, plugin = actuator_name(k), "extension/plugin[@plugin='mrdamp.damper']"
    instance = copy.deepcopy(get(other, f"{plugin}/instance[@name='damper']"))
    instance.set("name", name)
    get(root, plugin).append(instance)
    actuator = copy.deepcopy(get(other, "actuator/plugin[@name='damper']"))
    actuator.set("name", name)
    actuator.set("instance", name)
    get(root, "actuator").append(actuator)
    for config in instance.findall("config[@key='weights']"):
        text = copy.deepcopy(get(other, "custom/text"))
        text.set("name", f"weights_{k + 1}")
        config.set("value", f"text:weights_{k + 1}")
        child(root, "custom").append(text)
    tendon = actuator.get("tendon")
    if tendon is not None:
        actuator.set("tendon", f"{tendon}_{k + 1}")
        path = copy.deepcopy(get(other, "tendon/fixed"))
        path.set("name", f"{tendon}_{k + 1}")
        child(root, "tendon").append(path)
    for body in other.iter("body"):
        for geom in body.findall("geom"):
            drawn = geom.get("name")
            if drawn in DRAWN:
                part = copy.deepcopy(geom)
                part.set("name", f"{drawn}_{k + 1}")
                place = get(root, f".//body[@name='{body.get('name')}']")
                place.insert(list(place).index(get(place, "joint")) + 1, part)


def strip(root: ET.Element) -> None:
    for tag in ("asset", "visual", "statistic"):
        drop(root, tag)
    for body in root.iter("body"):
        drop(body, "geom")
        drop(body, "camera")
    for default in root.iter("default"):
        drop(default, "geom")


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
            mujoco.mj_kinematics(self.model, self.data)
            top = float(self.data.xpos[self.floors[-1], 2])
            for name in ("front", "corner"):
                m.camera(name).pos *= top / 1.66

    def pose(self, qpos: Array, exaggeration: float) -> None:
        # The row's first joint is the table's; here it stays where it is.
        self.data.qpos[self.joints] = exaggeration * qpos[1 : 1 + len(self.joints)]

    def connect(self, scene: mujoco.MjvScene) -> None:
        places = self.data.xpos[self.floors]
        for low, high in pairwise(places):
            for x, y in _CORNERS:
                corner = np.array([x, y, 0.0])
                start = low + corner + [0, 0, 0.06 if low is places[0] else _HALF]
                connector(scene, start, high + corner - [0, 0, _HALF], 0.009, _COLUMN)


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
        super().pose(qpos, exaggeration)
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


#: Geoms of the damper, taken out where a run has none.
_DAMPER = ("cylinder", "rod", "clevis", "bracket", "brace_left", "brace_right")


@dataclass(frozen=True)
class Clip:
    """What is drawn: size of one frame (pixels), factor on the drifts, pictures, slow motion, pictures a second.

    seconds: of the ground motion that are shown.
    """

    size: tuple[int, int] = (260, 420)
    exaggeration: float = 40.0
    count: int = 90
    slower: float = 10.0
    rate: float = 20.0

    @property
    def seconds(self) -> float:
        return self.count / self.rate / self.slower


@dataclass(frozen=True)
class Animation:
    """An animated WebP and its first picture for readers who turned motion off; width and height in pixels."""

    moving: bytes
    still: bytes
    width: int
    height: int


def animate(
    model: Model, runs: Sequence[FrameRun], names: Sequence[str], command_max: float, clip: Clip | None = None
) -> Animation:
    """Draws runs of one frame over the part of the motion where the first of them moves most.

    The damper's colour is its current, from none (blue) to `command_max` (orange). Raises InputError where the machine
    has no renderer.
    """
    clip = clip or Clip()
    dt = float(runs[0].time[1] - runs[0].time[0])
    length = max(1, round(clip.seconds / dt))
    energy = np.convolve(np.sum(runs[0].drift ** 2, axis=1), np.ones(length), "valid")
    start = int(np.argmax(energy))
    samples = start + np.round(np.arange(clip.count) / clip.rate / clip.slower / dt).astype(int)
    views = [FrameView([model], "front", clip.size) for _ in runs]
    for view, run in zip(views, runs, strict=True):
        if not np.any(run.force):
            for name in _DAMPER:
                geom = view.model.geom(name)
                geom.matid, geom.rgba = -1, 0.0
            view.cylinders.clear()
    width, height = clip.size
    font = ImageFont.load_default(15)
    pictures = []
    for k in np.minimum(samples, len(runs[0].time) - 1):
        whole = Image.new("RGB", (len(runs) * width, height + 26), "white")
        for n, (view, run, name) in enumerate(zip(views, runs, names, strict=True)):
            view.update(
                np.concatenate([[0.0], run.drift[k]]), clip.exaggeration, [run.current[k] / command_max]
            )
            whole.paste(Image.fromarray(view.image()), (n * width, 0))
            place = (n * width + width / 2, height + 4)
            ImageDraw.Draw(whole).text(place, name, fill="#1f2328", font=font, anchor="ma")
        pictures.append(whole)
    moving, still = io.BytesIO(), io.BytesIO()
    duration = round(1000 / clip.rate)
    film = {"save_all": True, "append_images": pictures[1:], "duration": duration, "loop": 0}
    pictures[0].save(moving, "webp", quality=45, method=4, **film)
    pictures[0].save(still, "webp", quality=60)
    return Animation(moving.getvalue(), still.getvalue(), *pictures[0].size)
