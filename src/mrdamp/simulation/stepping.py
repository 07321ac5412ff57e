"""Stepping the written MJCF: a record's motion imposed on the rig, a ground motion on the frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from mrdamp.errors import InputError, diverged, require_kind, require_period, require_positive
from mrdamp.model import Model, core, floor_channels
from mrdamp.model.core import Array
from mrdamp.model.damper import true_motion
from mrdamp.motions import GroundMotion
from mrdamp.records.log_filter import between
from mrdamp.simulation.floor_sensors import FloorSensors
from mrdamp.simulation.mjcf import FRAME_STEP, RIG_STEP, mjcf

if TYPE_CHECKING:
    from mrdamp.control.base import Controller


def _load(text: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    try:
        model = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise InputError(str(error).splitlines()[0]) from None
    return model, mujoco.MjData(model)


def _addresses(m: mujoco.MjModel, storeys: int) -> tuple[dict[str, int], list[int], list[int]]:
    """Where each sensor's data begin, by name; and those of the floors' accelerations and of the drifts."""
    of = {m.sensor(k).name: int(m.sensor(k).adr[0]) for k in range(m.nsensor)}
    floors = range(1, storeys + 1)
    return of, [of[f"acceleration_{j}"] for j in floors], [of[f"drift_{j}"] for j in floors]


def _require_sound(model: Model, d: mujoco.MjData) -> None:
    """Raises Diverged where the engine warned: it then has begun anew, at rest."""
    if any(d.warning.number):
        raise diverged(model.name)


def _from(model: Model, command: float, r: float = 0.0) -> Model:
    """The model with the command that a record begins with: it stood there before, as the C entry has it.

    r: x - y of modified_bouc_wen, m.
    """
    slow = {"start_r": r} if r and model.law == "modified_bouc_wen" else {}
    return replace(model, parameters={"command_start": command, **model.parameters, **slow})


def _steps(dt: float, largest: float) -> int:
    return max(1, math.ceil(dt / largest - 1e-9))


def drive_rig(model: Model, dt: float, inputs: Mapping[str, Array]) -> dict[str, Array]:
    """A damper record through MuJoCo: force_N and reference_force_N (n,) at the record's sample times.

    dt (s) and inputs as in `Model.simulate`; the record's motion is imposed on the machine, in steps of `RIG_STEP` at
    most, after the run-in of a record that begins in motion.
    """
    x, u = inputs["displacement_m"], inputs["command"]
    v = inputs.get("velocity_m_s")
    v = np.gradient(x, dt, edge_order=2) if v is None else v
    a = inputs.get("acceleration_m_s2")
    a = np.gradient(v, dt, edge_order=2) if a is None else a
    before = None if model.narx else core.run_in(dt, x, u, v)
    lead, slow = 0, 0.0
    if before is not None:
        lead, slow = before.stop - before.start, float(x[before.start] - np.mean(x[before.start : before.stop + 1]))
        x = np.append(x[before] + x[0] - x[before.stop], x)
        v, a, u = (np.append(channel[before], channel) for channel in (v, a, u))
    n, inner = len(x), _steps(dt, RIG_STEP)
    t = dt * np.arange(n)
    x, v, a = true_motion(model.attributes, dt, x, v, a)
    fine = dt / inner * np.arange((n - 1) * inner + 1)
    rod, rod_velocity = _straight(x, v, dt, inner)
    acceleration, command = np.interp(fine, t, a), between(u, inner, False, bool(model.hold))
    m, d = _load(mjcf(_from(model, float(u[0]), slow), timestep=dt / inner))
    damper = m.actuator("damper").id
    sensors = {s: m.sensor(s).adr[0] for s in ("damper_force", "true_force")}
    out = {name: np.empty(n) for name in ("force_N", "reference_force_N")}
    for k in range(len(fine)):
        d.qpos[0], d.qvel[0], d.ctrl[damper] = rod[k], rod_velocity[k], command[k]
        # The machine's acceleration is its driver's: a force of mass times acceleration.
        d.qfrc_applied[0] = m.body_mass[1] * acceleration[k]
        mujoco.mj_step(m, d)
        if k % inner == 0:
            out["force_N"][k // inner] = d.sensordata[sensors["damper_force"]]
            out["reference_force_N"][k // inner] = d.sensordata[sensors["true_force"]]
    _require_sound(model, d)
    out = {name: force[lead:] for name, force in out.items()}
    if lead and (settle := model.attributes.get("sensor_offset_settle", 0.0)):
        # The sensor's offset settles from the record's start on.
        rate = dt / model.attributes.get("sensor_offset_time", 1.0)
        out["force_N"] += settle * (1 - np.exp(-rate * lead)) * np.exp(-rate * np.arange(n - lead))
    return out


def _straight(x: Array, v: Array, dt: float, inner: int) -> tuple[Array, Array]:
    """Displacement and velocity at the steps between samples, as the C entry takes them.

    The velocity is linear from sample to sample, shifted so that its path is that of the displacement: noise of
    a measured displacement is then the same in both.
    """
    s = np.arange(inner) / inner
    shift = np.diff(x) / dt - (v[:-1] + v[1:]) / 2
    velocity = (v[:-1] + shift)[:, None] + np.diff(v)[:, None] * s
    path = x[:-1, None] + dt * ((v[:-1] + shift)[:, None] * s + np.diff(v)[:, None] * s**2 / 2)
    velocity[:, 0] = v[:-1]
    return np.append(path, x[-1]), np.append(velocity, v[-1])


@dataclass(frozen=True)
class FrameRun:
    """A run of a frame (n samples, N storeys), SI: what happens, not what sensors read."""

    time: Array  # (n,) s
    drift: Array  # (n, N) m
    acceleration: Array  # (n, N) m/s2, absolute
    force: Array  # (n,) N
    stroke: Array  # (n,) m
    command: Array  # (n,)
    current: Array  # (n,)


#: s, between samples of a run at most: a controller with a longer period is held in between, so that peaks are seen.
SAMPLE_TIME = 1e-3


def run_frame(
    model: Model,
    motion: GroundMotion,
    controller: Controller | None,
    *,
    period: float = 1e-3,
    timestep: float = 2.5e-4,
    ideal_force: bool = False,
    each_step: bool = False,
) -> FrameRun:
    """The model's frame in MuJoCo under a ground motion; controller None takes the damper out.

    period (s): of the samples returned, with a controller its own, or a whole part of it where that is above
    `SAMPLE_TIME`. timestep (s): the largest step of the engine. The ground moves within a control period, the command
    is held over it. ideal_force: an ideal actuator stands in the damper's place and the command is its force, N.
    each_step: also samples at every step of the engine in between.
    """
    require_kind("True, False", bool, ideal_force=ideal_force, each_step=each_step)
    if not isinstance(model, Model) or not hasattr(motion, "acceleration"):
        raise InputError("run_frame takes a Model and a GroundMotion (read_motion)")
    if controller is not None and not hasattr(controller, "period"):
        raise InputError(f"controller is {controller!r}; allowed: a Controller (mrdamp.control), None")
    require_positive("run_frame", timestep=timestep)
    require_period("run_frame", period)
    if model.structure is None:
        raise InputError(f"{model.name}: rig damper has no frame to run")
    if controller is not None:
        period = controller.period
        controller.reset()
    every = _steps(period, SAMPLE_TIME)  # samples a control period
    period /= every
    storeys, inner = model.structure.storeys, _steps(period, timestep)
    step = period / inner
    damped = controller is not None and not ideal_force
    m, d = _load(mjcf(model, damper=damped, timestep=step))
    ground = m.actuator("ground").id
    damper = m.actuator("damper").id if damped else -1
    joints = [int(m.joint(f"storey{j}").dofadr[0]) for j in range(1, storeys + 1)]
    # What a metre of each storey's drift adds to the stroke.
    lever = model.structure.stroke(np.triu(np.ones((storeys, storeys))))
    address, accelerations, drifts = _addresses(m, storeys)
    samples = math.floor(motion.duration / period + 1e-9) + 1
    # The engine's Euler step is a leapfrog whose velocities stand half a step early: forces belong to its start.
    push = np.interp(step * np.arange(samples * inner), motion.time, motion.acceleration)
    sensors = FloorSensors(model.frame, period, 1)
    seen = [address[name] for name in ("stroke", "stroke_velocity", "damper_force")] if damped else []
    of_damper = (address[name] for name in ("true_force", "stroke", "current") if damped)
    columns = np.array([*drifts, *accelerations, *of_damper])
    parts = inner if each_step else 1
    # Drifts, accelerations, and of the damper force, stroke and current.
    found, given = np.zeros((samples * parts, 2 * storeys + 3)), np.zeros(samples * parts)
    command = 0.0
    for k in range(samples):
        d.ctrl[ground] = push[k * inner]
        mujoco.mj_forward(m, d)
        now = found[k * parts]
        now[: len(columns)] = d.sensordata[columns]
        drift, acceleration = now[:storeys], now[storeys : 2 * storeys]
        if controller is not None:
            if damped:
                stroke, velocity, reading = d.sensordata[seen]
            else:
                now[-3:-1] = reading, stroke = command, lever @ drift
                velocity = lever @ d.qvel[joints]
            read = sensors.read(acceleration[None], None if k else [0])[0]
        if controller is not None and k % every == 0:
            displacement = np.cumsum(drift)
            y = {f"acceleration_{j + 1}": float(read[j]) for j in range(storeys)}
            y |= {f"displacement_{j + 1}": float(displacement[j]) for j in range(storeys)}
            y |= {"stroke": float(stroke), "force": float(reading), "stroke_velocity": float(velocity)}
            given[k * parts : (k + every) * parts] = controller.command(period * k, y)
            command = given[k * parts]
            if damped:
                d.ctrl[damper] = command
            else:
                d.qfrc_applied[joints] = -command * lever
        for i in range(inner):
            d.ctrl[ground] = push[k * inner + i]
            mujoco.mj_step(m, d)
            if 0 < i < parts:
                now = found[k * parts + i]
                now[: len(columns)] = d.sensordata[columns]
                if controller is not None and not damped:
                    now[-3:-1] = command, lever @ now[:storeys]
    _require_sound(model, d)
    n = (samples - 1) * parts + 1
    drift, acceleration, each = (part.copy() for part in np.split(found[:n], [storeys, 2 * storeys], axis=1))
    force, stroke, current = each.T
    time = period / parts * np.arange(n, dtype=np.float64)
    return FrameRun(time, drift, acceleration, force, stroke, given[:n], current)


def drive_frame(model: Model, dt: float, inputs: Mapping[str, Array]) -> dict[str, Array]:
    """A frame record through MuJoCo: channels as in `Model.simulate`, (n,) each, at the sample time dt (s)."""
    if model.structure is None:
        raise InputError(f"{model.name}: rig damper has no frame to run")
    ag, u = inputs["ground_acceleration_m_s2"], inputs["command"]
    storeys, n, inner = model.structure.storeys, len(ag), _steps(dt, FRAME_STEP)
    step, t = dt / inner, dt * np.arange(len(ag))
    push = np.interp(step * np.arange((n - 1) * inner + 1), t, ag)
    command = between(u, inner, False, bool(model.hold))
    m, d = _load(mjcf(_from(model, float(u[0])), timestep=step))
    ground, damper = m.actuator("ground").id, m.actuator("damper").id
    address, accelerations, drifts = _addresses(m, storeys)
    rows = np.empty((n, 2 * storeys + 1))
    for k in range((n - 1) * inner + 1):
        d.ctrl[ground], d.ctrl[damper] = push[k], command[k]
        if k % inner:
            mujoco.mj_step(m, d)
            continue
        before = None
        if k and command[k] != command[k - 1]:
            d.ctrl[damper] = command[k - 1]
            mujoco.mj_forward(m, d)
            before, d.ctrl[damper] = d.sensordata[accelerations], command[k]
        mujoco.mj_forward(m, d)
        # Where the command jumps, a step's acceleration is the mean of those before and after.
        after = d.sensordata[accelerations]
        rows[k // inner, :storeys] = after if before is None or not model.hold else 2 * after - before
        rows[k // inner, storeys : 2 * storeys] = np.cumsum(d.sensordata[drifts])
        rows[k // inner, -1] = d.sensordata[address["damper_force"]]
        mujoco.mj_step(m, d)
    _require_sound(model, d)
    sensors = FloorSensors(model.frame, dt, 1)
    read = np.array([sensors.read(row[None], None if k else [0])[0] for k, row in enumerate(rows[:, :storeys])])
    out = {f"acceleration_{j + 1}": read[:, j].copy() for j in range(storeys)}
    out |= {f"displacement_{j + 1}": rows[:, storeys + j].copy() for j in range(storeys)}
    out["force"] = rows[:, -1].copy()
    return floor_channels(out, dt, model.attributes)
