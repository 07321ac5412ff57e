"""A model as MJCF: the damper in the displacement-driven rig, or in a shear frame on a shake table.

The mechanics and the drawing come from the hand-written models in `mrdamp.models_xml`; here the damper's
attributes are put in and, for a frame, its storeys.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from pathlib import Path

from mrdamp import models_xml
from mrdamp.errors import InputError
from mrdamp.files import together, write_atomic
from mrdamp.model import FLOOR_SENSOR_EFFECTS, Model
from mrdamp.model.attributes import MISREADING
from mrdamp.structures import ShearFrame

#: s, engine's steps of the rig, and of a frame: after a jump of its command a damper rings with its floor near 100 Hz,
#: and the engine is off by 1 % of a record with jumps in twice that step.
RIG_STEP, FRAME_STEP = 5e-4, 2.5e-4
_WEIGHTS_TEXT = "damper_weights"
#: Of the damper as drawn, one in a frame.
DRAWN = ("bracket", "cylinder", "rod", "brace_left", "brace_right", "clevis")
#: Sensors of a damper in an environment, in this order; `pull` is its mean force on the structure over a step.
SIGNALS = ("force", "true_force", "stroke", "stroke_velocity", "current", "pull")
# The engine's own sensors are quicker than the plugin's and read the same numbers.
_ENGINES = {"stroke": "actuatorpos", "stroke_velocity": "actuatorvel", "pull": "actuatorfrc"}
_STOREY_HEIGHT = 0.54  # m between slabs, as drawn
_FIRST_HEIGHT = 0.58


def damper_config(model: Model) -> dict[str, str]:
    """The plugin's attributes of a model, as text; a network's weights stand in the model's <custom>."""
    config = {"law": model.law}
    if model.weights is not None:
        config["weights"] = f"text:{_WEIGHTS_TEXT}"
    return config | {key: repr(float(value)) for key, value in model.attributes.items()}


def mjcf(model: Model, *, damper: bool = True, timestep: float | None = None) -> str:
    """MJCF text of the model's rig: `rig` or a frame of as many storeys as the structure has.

    damper: False leaves the damper out (frame alone). timestep: s; by default `RIG_STEP` and `FRAME_STEP`. Raises
    InputError.
    """
    if model.rig == "damper":
        root = shipped("rig")
        root.set("model", "mrdamp_rig")
        for signal in ("true_force", "current", "temperature"):
            plugin_sensor(get(root, "sensor"), signal, signal)
        step = timestep or RIG_STEP
    else:
        assert model.structure is not None
        root = shipped("frame3")
        root.set("model", "mrdamp_frame")
        _build_storeys(root, model)
        step = timestep or FRAME_STEP
    get(root, "option").set("timestep", repr(step))
    if damper:
        instance = get(root, "extension/plugin[@plugin='mrdamp.damper']/instance")
        instance[:] = []
        configure(root, instance, model)
    else:
        if model.rig == "damper":
            raise InputError("a rig without a damper has nothing to show")
        _remove_damper(root)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def write_mjcf(model: Model, folder: Path | str) -> Path:
    """Writes model.xml, scene.xml (with light and ground) and model.json into the folder; returns scene.xml."""
    folder = Path(folder)
    text = mjcf(model)
    template = "rig" if model.rig == "damper" else "frame3"
    folder.mkdir(parents=True, exist_ok=True)
    with together():
        write_atomic(folder / "model.xml", text)
        write_atomic(folder / "scene.xml", models_xml.path(template, "scene.xml").read_text(encoding="utf-8"))
        model.write(folder / "model.json")
    return folder / "scene.xml"


def shipped(name: str) -> ET.Element:
    return ET.fromstring(models_xml.path(name).read_text(encoding="utf-8"))


def get(root: ET.Element, path: str) -> ET.Element:
    """The element at a path below root. Raises InputError where a shipped file lacks it."""
    found = root.find(path)
    if found is None:
        raise InputError(f"the model file has no <{path}>; reinstall mrdamp")
    return found


def child(root: ET.Element, tag: str) -> ET.Element:
    """The first child of a tag, made where there is none."""
    found = root.find(tag)
    return ET.SubElement(root, tag) if found is None else found


def drop(parent: ET.Element, path: str) -> None:
    for item in parent.findall(path):
        parent.remove(item)


def configure(root: ET.Element, instance: ET.Element, model: Model) -> None:
    """Gives an instance of the plugin a model's attributes, and root its weights."""
    for key, value in damper_config(model).items():
        ET.SubElement(instance, "config", key=key, value=value)
    if model.weights is not None:
        ET.SubElement(child(root, "custom"), "text", name=_WEIGHTS_TEXT, data=" ".join(model.weights.split()))


def _remove_damper(root: ET.Element) -> None:
    plugins = get(root, "extension/plugin[@plugin='mrdamp.damper']")
    plugins.remove(get(plugins, "instance[@name='damper']"))
    actuators = get(root, "actuator")
    actuators.remove(get(actuators, "plugin[@name='damper']"))
    drop(get(root, "sensor"), "plugin")
    drop(root, "tendon")
    for body in root.iter("body"):
        for geom in body.findall("geom"):
            if (geom.get("name") or "").removesuffix("_damper") in DRAWN:
                body.remove(geom)


def _build_storeys(root: ET.Element, model: Model) -> None:
    structure, frame = model.structure, model.frame
    assert structure is not None
    table = get(root, "worldbody/body[@name='table']")
    first = get(table, "body[@name='floor1']")
    table.remove(first)
    pattern = copy.deepcopy(get(first, "body[@name='floor2']"))
    drop(pattern, "body")
    tool = {geom.get("name"): geom for geom in (*table.findall("geom"), *first.findall("geom"))}
    # The extension's drawing goes with the storey that the damper stands in.
    for name in ("bracket", "cylinder"):
        table.remove(tool[name])
    lower, upper = sorted(structure.damper_between)
    bodies = [table]
    for j in range(1, structure.storeys + 1):
        body = copy.deepcopy(pattern)
        body.set("name", f"floor{j}")
        body.set("pos", f"0 0 {_FIRST_HEIGHT if j == 1 else _STOREY_HEIGHT}")
        body.set("childclass", "storey")
        get(body, "inertial").set("mass", repr(float(frame.mass[j - 1])))
        joint = get(body, "joint")
        joint.set("name", f"storey{j}")
        joint.set("stiffness", repr(float(frame.stiffness[j - 1])))
        damping = [float(frame.damping[j - 1])]
        if frame.damping2 is not None:
            damping.append(float(frame.damping2[j - 1]))  # the engine's next coefficient is that of |v| v
        joint.set("damping", " ".join(map(repr, damping)))
        if frame.friction is not None and frame.friction[j - 1] > 0:
            width, presliding = (
                0.0 if row is None else float(row[j - 1])
                for row in (frame.friction_width, frame.friction_presliding)
            )
            _put_friction(root, j, float(frame.friction[j - 1]), width, presliding or 1e-5)
        for tag in ("geom", "site"):
            for item in body.findall(tag):
                if item.get("name"):
                    item.set("name", f"floor{j}")
        bodies[-1].append(body)
        bodies.append(body)
    if upper == lower + 1:
        _draw_damper(bodies[lower], bodies[upper], tool, on_table=lower == 0)
    _actuators(root, structure)
    _sensors(root, model)


def _put_friction(root: ET.Element, storey: int, coulomb: float, width: float, presliding: float) -> None:
    """Dry friction in a storey: a damper with nothing else in it, as the engine's own friction is soft."""
    name = f"friction_{storey}"
    damper = get(root, "extension/plugin[@plugin='mrdamp.damper']")
    instance = ET.SubElement(damper, "instance", name=name)
    law = dict.fromkeys(("c0a", "c0b", "fya", "fyb", "v_ref"), "0")
    friction = {"seal_friction_coulomb": repr(coulomb), "seal_friction_presliding": repr(presliding)}
    if width > 0:
        friction = {"fya": repr(coulomb), "v_ref": repr(width)}
    for key, value in ({"law": "bingham"} | law | friction).items():
        ET.SubElement(instance, "config", key=key, value=value)
    place = {"joint": f"storey{storey}", "plugin": "mrdamp.damper", "instance": name}
    ET.SubElement(get(root, "actuator"), "plugin", place, name=name)


def _draw_damper(
    below: ET.Element, above: ET.Element, tool: dict[str | None, ET.Element], on_table: bool
) -> None:
    """Bracket and cylinder on the floor below, rod and braces under the floor above, as in frame3."""
    lift = 0.0 if on_table else -0.04  # a slab's own frame is higher than the table's
    for body, names, dz in (
        (below, ("bracket", "cylinder"), lift),
        (above, ("brace_left", "brace_right", "clevis", "rod"), 0.0),
    ):
        for name in names:
            geom = copy.deepcopy(tool[name])
            for key in ("pos", "fromto"):
                value = geom.get(key)
                if value is not None and dz:
                    numbers = [float(part) for part in value.split()]
                    for k in range(2, len(numbers), 3):
                        numbers[k] += dz
                    geom.set(key, " ".join(f"{number:g}" for number in numbers))
            body.insert(2, geom)


def _actuators(root: ET.Element, structure: ShearFrame) -> None:
    lower, upper = structure.damper_between
    plugin = get(root, "actuator/plugin[@name='damper']")
    if (lower, upper) == (0, 1):
        return
    # Over several storeys, or from the rod end below: the sum of the drifts, with its sign.
    sign = 1 if upper > lower else -1
    low, high = sorted((lower, upper))
    del plugin.attrib["joint"]
    if high == low + 1 and sign == 1:
        plugin.set("joint", f"storey{high}")
        return
    plugin.set("tendon", "stroke")
    fixed = ET.SubElement(ET.SubElement(root, "tendon"), "fixed", name="stroke")
    for j in range(low + 1, high + 1):
        ET.SubElement(fixed, "joint", joint=f"storey{j}", coef=str(sign))


def plugin_sensor(group: ET.Element, signal: str, name: str, actuator: str = "damper") -> None:
    """Appends the plugin's sensor of a damper's signal to a group of sensors."""
    item = ET.SubElement(
        group, "plugin", name=name, plugin="mrdamp.force_sensor", objtype="actuator", objname=actuator
    )
    if signal != "force":
        ET.SubElement(item, "config", key="signal", value=signal)


def _sensors(root: ET.Element, model: Model) -> None:
    sensor = get(root, "sensor")
    force = copy.deepcopy(get(sensor, "plugin"))
    sensor[:] = []
    assert model.structure is not None
    floors = range(1, model.structure.storeys + 1)
    for j in floors:
        ET.SubElement(sensor, "accelerometer", name=f"acceleration_{j}", site=f"floor{j}")
    for j in floors:
        ET.SubElement(sensor, "jointpos", name=f"drift_{j}", joint=f"storey{j}")
    sensor.append(force)
    for signal in ("true_force", "stroke", "stroke_velocity", "current"):
        plugin_sensor(sensor, signal, signal)
    # The engine's accelerometers are ideal; what their readings go through is kept for `mrdamp.simulation.stepping`.
    placed = [e for e in model.effects if e.place is not None and e.name in FLOOR_SENSOR_EFFECTS]
    for effect in placed:
        for key, value in effect.parameters.items():
            name = f"acceleration_{effect.place}_{effect.name}_{key}"
            ET.SubElement(child(root, "custom"), "numeric", name=name, data=repr(float(value)))


def add_sensor(group: ET.Element, signal: str, name: str, actuator: str, model: Model) -> None:
    """Appends the sensor of one of `SIGNALS` of a damper (an actuator's name) to a group of sensors."""
    # Only the plugin can give a stroke as a channel at fault reads it.
    misread = any(model.attributes.get(name, 0.0) for name in MISREADING)
    if signal in _ENGINES and not (signal == "stroke" and misread):
        ET.SubElement(group, _ENGINES[signal], name=name, actuator=actuator)
    else:
        plugin_sensor(group, signal, name, actuator)


def add_damper(root: ET.Element, damper: Model, **place: str) -> None:
    """The plugin as actuator `damper` in place, as tendon="stroke" or joint="suspension", and its sensors."""
    extension, actuator = get(root, "extension"), get(root, "actuator")
    plugin = ET.SubElement(extension, "plugin", plugin="mrdamp.damper")
    configure(root, ET.SubElement(plugin, "instance", name="damper"), damper)
    ET.SubElement(extension, "plugin", plugin="mrdamp.force_sensor")
    ET.SubElement(actuator, "plugin", place, name="damper", plugin="mrdamp.damper", instance="damper")
    sensor = child(root, "sensor")
    for name in ("stroke", "stroke_velocity"):
        drop(sensor, f"*[@name='{name}']")
    for signal in SIGNALS:
        add_sensor(sensor, signal, signal, "damper", damper)


def remove_damper(root: ET.Element) -> None:
    for tag in ("extension", "actuator", "sensor"):
        drop(get(root, tag), "plugin")


def actuator_name(k: int) -> str:
    """Of damper k, from 0: `damper`, `damper_2`, `damper_3` ..."""
    return "damper" if k == 0 else f"damper_{k + 1}"
