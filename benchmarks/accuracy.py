"""What the measured settings cost in accuracy: force errors against SciPy (stiff, rtol 1e-9).

The frame and the laws are written out here once more, from Dyke et al. (1996), doi:10.1088/0964-1726/5/5/006,
so that nothing is shared with the plugin.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Literal

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

from benchmarks.frames import DYKE, frame, multisine
from benchmarks.python_law import PythonDamper
from mrdamp.model import core
from mrdamp.model.core import Array

GRID = 1e-4  # s
MASS = np.full(3, 98.3)  # kg
STIFFNESS = np.array([5.16e5, 6.84e5, 6.84e5])  # N/m
DAMPING = np.array([125.0, 50.0, 50.0])  # N s/m

#: The frame's damper at 1 V by the simpler law that OpenSees has (no accumulator): F = c0 v + alpha z + k0 x.
SIMPLE = {"c0": 2450.0, "alpha": 83500.0, "k0": 500.0, "A": 301.0, "gamma": 3.63e6, "beta": 3.63e6, "n": 2.0}

#: (x, v, z, y, i) -> force (N), z' and y'
Law = Callable[[float, float, float, float, float], tuple[float, float, float]]


def command(t: npt.NDArray[np.floating]) -> Array:
    """Commanded voltage at t (n,)."""
    volts: Array = 1.125 + 1.125 * np.sin(2.0 * math.pi * 0.9 * t)
    return volts


def hysteresis_rate(z: float, w: float) -> float:
    """z' of Bouc and Wen (n = 2) for a velocity w (m/s)."""
    return SIMPLE["A"] * w - (SIMPLE["gamma"] * abs(w) * abs(z) + SIMPLE["beta"] * w * z) * z


def modified_bouc_wen(x: float, v: float, z: float, y: float, i: float) -> tuple[float, float, float]:
    """Spencer et al. (1997), Eqs. (13)-(16)."""
    p = DYKE.parameters
    c0, c1 = p["c0a"] + p["c0b"] * i, p["c1a"] + p["c1b"] * i
    y_rate = ((p["alpha_a"] + p["alpha_b"] * i) * z + c0 * v + p["k0"] * (x - y)) / (c0 + c1)
    return c1 * y_rate + p["k1"] * x, hysteresis_rate(z, v - y_rate), y_rate


def bouc_wen(x: float, v: float, z: float, y: float, i: float) -> tuple[float, float, float]:
    """The same without the accumulator, at 1 V."""
    return SIMPLE["c0"] * v + SIMPLE["alpha"] * z + SIMPLE["k0"] * x, hysteresis_rate(z, v), 0.0


@dataclass(frozen=True)
class Reference:
    """The damped frame on the grid: time (n,) s, stroke x (n,) m, its velocity v (n,) m/s and force (n,) N."""

    t: Array
    x: Array
    v: Array
    force: Array

    def every(self, dt: float) -> Reference:
        """The samples at the time step dt (s), a multiple of the grid's."""
        k = round(dt / GRID)
        return Reference(*(part[::k].copy() for part in (self.t, self.x, self.v, self.force)))


@cache
def reference(end: float, kind: Literal["modified_bouc_wen", "bouc_wen"] = "modified_bouc_wen") -> Reference:
    """SciPy's solution over `end` seconds from rest."""
    law: Law = modified_bouc_wen if kind == "modified_bouc_wen" else bouc_wen
    tau = DYKE.effects["driver_lag"]["tau"]

    def rates(t: float, s: Array) -> Array:
        shear = STIFFNESS * np.diff(s[:3], prepend=0.0) + DAMPING * np.diff(s[3:6], prepend=0.0)
        force, z_rate, y_rate = law(s[0], s[3], s[6], s[7], s[8])
        shear[0] += force
        at = np.array([t])
        a = (np.append(shear[1:], 0.0) - shear) / MASS - multisine(at)[0]
        return np.concatenate([s[3:6], a, [z_rate, y_rate, (command(at)[0] - s[8]) / tau]])

    t: Array = np.arange(round(end / GRID) + 1, dtype=np.float64) * GRID
    start = np.append(np.zeros(8), command(t[:1]))
    found = solve_ivp(rates, (0.0, t[-1]), start, "LSODA", t_eval=t, rtol=1e-9, atol=1e-12, max_step=2e-3)
    if not found.success:
        raise RuntimeError(found.message)
    s = found.y
    force = np.array([law(*row)[0] for row in zip(s[0], s[3], s[6], s[7], s[8], strict=True)])
    return Reference(t, s[0], s[3], force)


def error(force: Array, twin: Array) -> float:
    """RMS of the difference over the RMS of the reference."""
    return float(np.sqrt(np.mean((force - twin) ** 2) / np.mean(twin**2)))


def law_error(dt: float, end: float) -> float:
    """The C entry on the reference's piston motion, sampled at dt (s)."""
    r = reference(end).every(dt)
    return error(core.run(DYKE.law, DYKE.attributes(), dt, r.x, r.v, u=command(r.t))["force"], r.force)


def python_law_error(python: PythonDamper, dt: float, end: float) -> float:
    """The law in Python on the same motion."""
    r = reference(end).every(dt)
    m = frame(dt, damper=False)
    d = mujoco.MjData(m)
    dof = int(m.joint("storey1").dofadr[0])
    commands = command(np.maximum(r.t - 0.5 * dt, 0.0)).tolist()
    python.command = commands[0]
    control = python.control(d, dof, dt)
    force = np.zeros(len(r.t))
    for k in range(1, len(r.t)):
        d.qpos[dof], d.qvel[dof], python.command = r.x[k], r.v[k], commands[k]
        control(m, d)
        force[k] = python.force
    return error(force, r.force)


def frame_error(dt: float, end: float, python: PythonDamper | None = None) -> float:
    """The frame stepped by MuJoCo at dt (s), with the plugin or with a law in Python."""
    r = reference(end).every(dt)
    m = frame(dt, damper=python is None)
    d = mujoco.MjData(m)
    # The ground at the start of a step, the command in its middle: what the engine's leapfrog takes them for.
    pushes, commands = multisine(r.t), command(r.t + 0.5 * dt).tolist()
    commands[0] = float(command(r.t[:1])[0])
    ground = m.actuator("ground").id
    force = np.empty(len(r.t))
    if python is not None:
        python.command = commands[0]
        mujoco.set_mjcb_control(python.control(d, int(m.joint("storey1").dofadr[0]), dt))
    try:
        for k in range(len(r.t)):
            d.ctrl[ground] = pushes[k]
            if python is None:
                d.ctrl[m.actuator("damper").id] = commands[k]
            else:
                python.command = commands[k]
            mujoco.mj_step(m, d)
            force[k] = d.sensor("damper_force").data[0] if python is None else python.force
    finally:
        mujoco.set_mjcb_control(None)
    return error(force, r.force)
