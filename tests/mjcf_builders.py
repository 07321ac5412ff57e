"""MJCF documents with dampers in them, put together from parts, and the loops that step them.

Lengths in m, masses in kg, forces in N. Bodies slide along x, without gravity unless a test adds it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from excitation import Array
from mrdamp import sets
from mrdamp.model import core

Values = Mapping[str, float | str]
Numbers = Sequence[float] | Array
HEAVY = 1e9  # kg: a body that no damper here moves
BINGHAM = {"c0a": 150.0, "c0b": 80.0, "fya": 40.0, "fyb": 60.0, "v_ref": 0.008}
BOUC_WEN = {
    "c0a": 900.0, "c0b": 900.0, "alpha_a": 3e4, "alpha_b": 1e5, "gamma": 9e5, "beta": 4e5, "A": 110.0,
    "n": 2.0, "k0": 3000.0, "x0": 0.001,
}  # fmt: skip
DYKE = {**sets.load("dyke1996_3kN").attributes(), "driver_lag_tau": 0.0}
ALL_SIGNALS = (
    "force", "charge", "true_force", "applied_force", "unlimited_force", "stroke", "stroke_velocity", "power", "energy",
    "current", "field", "temperature",
)  # fmt: skip


def grid(end: float, dt: float) -> Array:
    """Times 0, dt ... end, in s."""
    return np.arange(round(end / dt) + 1, dtype=np.float64) * dt


def dashpot(c: float, friction: float = 0.0) -> dict[str, float]:
    return {"c0a": c, "c0b": 0.0, "fya": friction, "fyb": 0.0, "v_ref": 0.01}


def config(values: Values) -> str:
    """`<config>` elements; numbers are written with all their digits."""
    rows = ((key, value if isinstance(value, str) else repr(float(value))) for key, value in values.items())
    return "".join(f'<config key="{key}" value="{value}"/>' for key, value in rows)


@dataclass(frozen=True)
class Damper:
    """An actuator of the plugin. `on`: its transmission; `more`: further attributes of the actuator."""

    law: str
    attributes: Values
    name: str = "mr"
    on: str = 'joint="j0"'
    more: str = ""

    def instance(self) -> str:
        law = {"law": self.law} if self.law else {}
        return f'<instance name="{self.name}_data">{config({**law, **self.attributes})}</instance>'

    def actuator(self) -> str:
        instance = f'plugin="mrdamp.damper" instance="{self.name}_data"'
        return f'<plugin name="{self.name}" {self.on} {instance} {self.more}/>'


@dataclass(frozen=True)
class Sensor:
    """A force sensor on the damper `of`."""

    name: str = "force"
    of: str = "mr"
    attributes: Values = field(default_factory=dict)

    def element(self) -> str:
        where = f'plugin="mrdamp.force_sensor" objtype="actuator" objname="{self.of}"'
        return f'<plugin name="{self.name}" {where}>{config(self.attributes)}</plugin>'


def signals(of: str = "mr") -> tuple[Sensor, ...]:
    return tuple(Sensor(name, of, {"signal": name}) for name in ALL_SIGNALS)


def slider(
    mass: float, *, stiffness: float = 0.0, damping: float = 0.0, name: str = "j0", inside: str = ""
) -> str:
    """A body on a slide joint along x, with the site `on_NAME` on it."""
    passive = f'stiffness="{float(stiffness)!r}" damping="{float(damping)!r}"'
    joint = f'<joint name="{name}" type="slide" axis="1 0 0" {passive}/>'
    mark = f'<site name="on_{name}"/>'
    inertia = f'<inertial pos="0 0 0" mass="{float(mass)!r}" diaginertia="1 1 1"/>'
    return f"<body>{joint}{inertia}{mark}{inside}</body>"


def chain(masses: Numbers, stiffness: Numbers, damping: Numbers) -> str:
    """Bodies one on the other: joint `jN` is the relative displacement of body N to the one before."""
    inside = ""
    for k in reversed(range(len(masses))):
        inside = slider(masses[k], stiffness=stiffness[k], damping=damping[k], name=f"j{k}", inside=inside)
    return inside


def document(
    bodies: str,
    dampers: Sequence[Damper],
    sensors: Sequence[Sensor] = (Sensor(),),
    *,
    timestep: float = 1e-3,
    integrator: str = "Euler",
    extra: str = "",
    options: str = "",
) -> str:
    """A whole MJCF document; `extra` stands beside worldbody, `options` inside `<option>`."""
    instances = "".join(damper.instance() for damper in dampers)
    actuators = "".join(damper.actuator() for damper in dampers)
    return f"""<mujoco>
<option timestep="{timestep!r}" gravity="0 0 0" integrator="{integrator}">{options}</option>
<extension>
  <plugin plugin="mrdamp.damper">{instances}</plugin>
  <plugin plugin="mrdamp.force_sensor"/>
</extension>
<worldbody>{bodies}</worldbody>
<actuator>{actuators}</actuator>
<sensor>{"".join(sensor.element() for sensor in sensors)}</sensor>
{extra}
</mujoco>"""


def compiled(text: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def oscillator(
    law: str, attributes: Values, mass: float, stiffness: float, timestep: float, *, integrator: str = "Euler"
) -> tuple[mujoco.MjModel, mujoco.MjData]:
    text = document(
        slider(mass, stiffness=stiffness),
        [Damper(law, attributes)],
        signals(),
        timestep=timestep,
        integrator=integrator,
    )
    return compiled(text)


def drive(text: str, x: Array, v: Array, u: Array) -> dict[str, Array]:
    """Steps a rig whose joint is put to x (n,), v (n,) before each step; every sensor's reading (n,)."""
    model, data = compiled(text)
    out = np.empty((len(x), model.nsensordata))
    for k in range(len(x)):
        data.qpos[0], data.qvel[0], data.ctrl[0] = x[k], v[k], u[k]
        mujoco.mj_step(model, data)
        out[k] = data.sensordata
    return {model.sensor(i).name: out[:, i] for i in range(model.nsensor)}


@dataclass(frozen=True)
class Track:
    """Motion of the joints (n, nv), and sensor readings (n, nsensordata), before each of n steps."""

    x: Array
    v: Array
    sensors: Array


def step_through(
    model: mujoco.MjModel, data: mujoco.MjData, steps: int, controls: Array | None = None
) -> Track:
    """Steps freely; controls (n, nu) are set before each step where given."""
    x, v = np.empty((steps, model.nv)), np.empty((steps, model.nv))
    sensors = np.empty((steps, model.nsensordata))
    for k in range(steps):
        if controls is not None:
            data.ctrl[:] = controls[k]
        x[k], v[k] = data.qpos, data.qvel
        mujoco.mj_step(model, data)
        sensors[k] = data.sensordata
    return Track(x, v, sensors)


def _place(model: mujoco.MjModel, instance: str, name: str) -> tuple[int, int]:
    """Where a damper's attribute stands in `plugin_attr`: values in the table's order, zeros between."""
    names = ["law", "weights", *core.attribute_index()]
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_PLUGIN, instance)
    at = int(model.plugin_attradr[number])
    raw = bytes(model.plugin_attr.view(np.uint8))
    for _ in range(names.index(name)):
        at = raw.index(0, at) + 1
    return at, raw.index(0, at)


def attribute(model: mujoco.MjModel, instance: str, name: str) -> str:
    begin, end = _place(model, instance, name)
    return bytes(model.plugin_attr.view(np.uint8))[begin:end].decode()


def set_attribute(model: mujoco.MjModel, instance: str, name: str, value: float) -> None:
    """Overwrites an attribute in the compiled model; the text must be as long as the one that stood there."""
    begin, end = _place(model, instance, name)
    text = repr(float(value)).encode()
    assert len(text) == end - begin
    model.plugin_attr[begin:end] = np.frombuffer(text, dtype=model.plugin_attr.dtype)
