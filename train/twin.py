"""Linear structures with one damper in NumPy, for searches that take more control periods than the engine has time for.

A twin does what `mrdamp.envs.plants.Plants` does for a frame or a cable, with ideal sensors and a damper of one of two
laws, thirty times as fast in many rows. Policies are judged in the engine, not here. With x the stroke, v its velocity
and h the step (Spencer et al. 1997, doi 10.1061/(ASCE)0733-9399(1997)123:3(230)),

    z' = A r' - |z|^(n-1) (gamma |r'| z + beta r' |z|)
    bouc_wen:           r' = v,                                          f = c0 v + k0 (x - x0) + alpha z
    modified_bouc_wen:  r' = (c1 v - alpha z - k0 r) / (c0 + c1),        f = c1 (v - r') + k1 (x - x0)

are stepped by the implicit midpoint rule, the rate of yielding by one fixed-point iteration. The structure is stepped
exactly for forces that are held over the step at those of its middle.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from mrdamp.control.plant import Plant
from mrdamp.model import Model

Array = NDArray[np.float64]

LAWS = ("bouc_wen", "modified_bouc_wen")
_KNOWN = {
    *("A", "alpha_a", "alpha_b", "beta", "c0a", "c0b", "c1a", "c1b", "gamma", "k0", "k1", "n", "x0"),
    *("command_max", "command_min", "driver_lag_tau"),
}


_SIGNALS = re.compile(r"(acceleration|displacement)_\d+|stroke|force|current")


def has_twin(model: Model, signals: Sequence[str]) -> bool:
    """Whether a twin holds all that a model's damper does, and has all these measurements."""
    a = model.attributes
    known = model.law in LAWS and set(a) <= _KNOWN and all(e.place is None for e in model.effects)
    return known and abs(a["beta"]) <= a["gamma"] and a["n"] >= 1 and all(map(_SIGNALS.fullmatch, signals))


class TwinDampers:
    """n dampers of a model. Attributes: current (n,), A or V; z, r (n,) of the law."""

    def __init__(self, model: Model, n: int) -> None:
        self._p: Mapping[str, float] = model.attributes
        self._modified = model.law == "modified_bouc_wen"
        self._least = self._p.get("command_min", -math.inf)
        self._rest = 0.0 if self._p.get("driver_lag_tau", 0.0) > 0 else max(0.0, self._least)
        self.current, self.z, self.r = np.full(n, self._rest), np.zeros(n), np.zeros(n)
        self._follow(self.current)

    def restart(self, row: int) -> None:
        """At rest, without a command."""
        self.current[row], self.z[row], self.r[row] = self._rest, 0.0, 0.0
        self._follow(self.current)

    def force(self, x: Array, v: Array) -> Array:
        """(n,) N at strokes x and velocities v (n,), now."""
        q, share = self._rates(v)
        return self._force(x, v, self.z, q - share * self.z)

    def step(self, command: Array, x: Array, v: Array, h: float) -> Array:
        """Through h seconds; x and v (n,) of the middle. Returns the force (n,) of the middle."""
        p, tau = self._p, self._p.get("driver_lag_tau", 0.0)
        command = np.maximum(command, self._least)
        lag = math.exp(-0.5 * h / tau) if tau > 0 else 0.0
        self._follow(command + lag * (self.current - command))
        q, share = self._rates(v)
        drive, linear, z = self.z + (0.5 * h * p["A"]) * q, 1.0 + (0.5 * h * p["A"]) * share, self.z
        for _ in range(2):
            rate = q - share * z
            size = np.abs(z)
            yielding = size ** (p["n"] - 1) * (p["gamma"] * np.abs(rate) + p["beta"] * np.copysign(rate, rate * z))
            z = drive / (linear + 0.5 * h * yielding)
        rate = q - share * z
        found = self._force(x, v, z, rate)
        self.r = self.r + h * rate
        self.z = 2.0 * z - self.z
        self._follow(command + lag * (self.current - command))
        return found

    def _follow(self, current: Array) -> None:
        self.current, p = current, self._p
        names = ("c0", "c1", "alpha_") if self._modified else ("c0", "alpha_")
        c = [np.maximum(p[f"{name}a"] + p[f"{name}b"] * current, 0.0) for name in names]
        self._c0, self._c1, self._alpha = c[0], c[-2], c[-1]

    def _rates(self, v: Array) -> tuple[Array, Array | float]:
        """q and p of r' = q - p z."""
        if not self._modified:
            return v, 0.0
        both = self._c0 + self._c1
        return (self._c1 * v - self._p["k0"] * self.r) / both, self._alpha / both

    def _force(self, x: Array, v: Array, z: Array, rate: Array) -> Array:
        p = self._p
        if not self._modified:
            return np.asarray(self._c0 * v + p["k0"] * (x - p["x0"]) + self._alpha * z)
        return np.asarray(self._c1 * (v - rate) + p["k1"] * (x - p["x0"]))


class TwinPlants:
    """n linear structures s' = a s + b f + e w with s = [positions; velocities] (2N,) and m loads w, each with a damper
    whose stroke is `stroke` (N,) times the positions.

    inner: steps of `timestep` in a control period. Attributes: step (n,), of the twin since the start.
    """

    def __init__(self, linear: Plant, stroke: Array, model: Model, inner: int, timestep: float, n: int) -> None:
        self.n, self.inner, self.timestep = n, inner, timestep
        loads = linear.e.reshape(len(linear.a), -1)
        half, whole = len(stroke), len(linear.a)
        block = np.zeros((whole + 1 + loads.shape[1],) * 2)
        block[:whole] = np.column_stack([linear.a, linear.b, loads]) * timestep
        self._next = expm(block)[:whole]
        self._rates = block[half:whole] / timestep
        self.stroke, self._size = stroke, whole
        self._model = model
        self.dampers = TwinDampers(model, n)
        self._now = np.zeros((len(block), n))  # states, force, loads
        self._load = np.zeros((1, loads.shape[1], n))
        self.step = np.zeros(n, dtype=np.int64)

    def start(self, row: int, load: Array) -> None:
        """Row at rest under a load (samples, m) at the twin's steps; none after its end. All rows start together."""
        samples = len(load) + self.inner + 1
        if samples > len(self._load):
            fresh = np.zeros((samples, *self._load.shape[1:]))
            fresh[: len(self._load)] = self._load
            self._load = fresh
        self._load[: len(load), :, row], self._load[len(load) :, :, row] = load, 0.0
        self._now[:, row] = 0.0
        self.dampers.restart(row)
        self.step[row] = 0

    def measure(self) -> tuple[Array, Array]:
        """(2N + 1 + m, n) states, forces and loads, and (N, n) second derivatives of the positions, now."""
        now, half = self._now, len(self.stroke)
        stroke, velocity = self.stroke @ now[:half], self.stroke @ now[half : self._size]
        now[self._size] = self.dampers.force(stroke, velocity)
        now[self._size + 1 :] = self._load[min(int(self.step[0]), len(self._load) - 1)]
        return now, self._rates @ now

    def advance(self, command: Array) -> None:
        """One step under commands (n,), from where `measure` was."""
        now, rates = self._now, self._rates @ self._now
        half, h = len(self.stroke), self.timestep
        velocity = self.stroke @ now[half : self._size]
        x = self.stroke @ now[:half] + 0.5 * h * velocity
        v = velocity + 0.5 * h * (self.stroke @ rates)
        now[self._size] = self.dampers.step(command, x, v, h)
        last = len(self._load) - 1
        at = int(self.step[0])
        now[self._size + 1 :] = 0.5 * (self._load[min(at, last)] + self._load[min(at + 1, last)])
        now[: self._size] = self._next @ now
        self.step += 1
