"""The modified Bouc-Wen law as a Python callback of the engine, written for speed: plain floats, nothing looked up.

Spencer et al. (1997), doi:10.1061/(ASCE)0733-9399(1997)123:3(230); r = x - y, so that the position is not needed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import mujoco

Control = Callable[[mujoco.MjModel, mujoco.MjData], None]


@dataclass
class PythonDamper:
    """A damper on a joint, its force in `qfrc_applied`: by `mujoco.set_mjcb_control`, or called before each step.

    inner: steps of the law in a step of the engine, by the explicit midpoint rule; 0: one step by Euler's rule.
    abreast: the velocity is carried on by half a step, along its last change. The engine's Euler step is a leapfrog
    whose velocities stand half a step before its positions; a force of the velocity as it stands is late by that
    much. command: set by whoever steps; force, current: what they were in the last step, N and A or V.
    """

    parameters: Mapping[str, float]
    inner: int
    abreast: bool = False
    command: float = 0.0
    force: float = field(default=0.0, init=False)
    current: float = field(default=0.0, init=False)

    def control(self, data: mujoco.MjData, dof: int, dt: float) -> Control:
        """The callback for one MjData and a step of dt (s); it starts at rest at the present command."""
        p = self.parameters
        c0a, c0b, c1a, c1b, ka, kb = (p[n] for n in ("c0a", "c0b", "c1a", "c1b", "alpha_a", "alpha_b"))
        gamma, beta, A, k0, k1 = (p[n] for n in ("gamma", "beta", "A", "k0", "k1"))
        qpos, qvel, applied = data.qpos, data.qvel, data.qfrc_applied
        inner, euler, part = max(self.inner, 1), self.inner == 0, 0.5 * self.abreast
        h = dt / inner
        decay, decay_half = math.exp(-h / p["driver_lag_tau"]), math.exp(-0.5 * h / p["driver_lag_tau"])
        steps = range(inner)
        v0, i, z, r = float(qvel[dof]), self.command, 0.0, 0.0
        before = v0

        def control(m: mujoco.MjModel, d: mujoco.MjData) -> None:
            nonlocal v0, before, i, z, r
            v, u = qvel.item(dof), self.command
            before, v = v, v + part * (v - before)
            v_now, half = v0, 0.5 * (v - v0) / inner
            for _ in steps:
                b = u + (i - u) * decay_half
                c0, c1, alpha = c0a + c0b * b, c1a + c1b * b, ka + kb * b
                c = c0 + c1
                rate = (c1 * v_now - alpha * z - k0 * r) / c
                slope = A * rate - (gamma * abs(rate) * abs(z) + beta * rate * z) * z
                if not euler:
                    z_half, r_half = z + 0.5 * h * slope, r + 0.5 * h * rate
                    rate = (c1 * (v_now + half) - alpha * z_half - k0 * r_half) / c
                    slope = A * rate - (gamma * abs(rate) * abs(z_half) + beta * rate * z_half) * z_half
                z += h * slope
                r += h * rate
                v_now += 2.0 * half
                i = u + (i - u) * decay
            v0 = v
            c0, c1, alpha = c0a + c0b * i, c1a + c1b * i, ka + kb * i
            self.current = i
            self.force = c1 * (alpha * z + c0 * v + k0 * r) / (c0 + c1) + k1 * qpos.item(dof)
            applied[dof] = -self.force

        return control
