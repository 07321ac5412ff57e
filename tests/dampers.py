"""Every published set with motions of its own size, and the runs that tests share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from excitation import Array, Command, Motion, constant, multisine, random_steps, sine, triangle, wave
from mrdamp import sets
from mrdamp.model import core
from twins import simulate

# prefix of the id -> stroke in m (amplitude of its sine), frequency in Hz of that sine
SIZES: Mapping[str, tuple[float, float]] = {
    "spencer1997": (0.010, 2.5),
    "dyke1996": (0.010, 2.5),
    "lai_liao2002": (0.012, 2.0),
    "rths_benchmark": (0.030, 1.0),
    "vrths_2022": (0.010, 2.0),
    "bw_50kN": (0.030, 1.0),
    "utfpr_rd8041": (0.012, 1.0),
    "zapateiro_foam": (0.008, 4.0),
}


def size(id: str) -> tuple[float, float]:
    """Stroke (m) and frequency (Hz) at which the damper of a set was tested, or would be."""
    return next(found for prefix, found in SIZES.items() if id.startswith(prefix))


def commands(id: str) -> tuple[float, float]:
    """Range of the commands, as in the set; 0 to 1 where the set does not depend on it."""
    found = sets.load(id).command
    return (found.min, found.max) if found.max > found.min else (0.0, 1.0)


def excitation(id: str, kind: str) -> tuple[Motion, Command]:
    """A motion and a command of the damper's size; kinds: sine, start, triangle, steps."""
    stroke, frequency = size(id)
    low, high = commands(id)
    slow = wave(low, high, 0.4)
    if kind == "sine":
        # phase, and factor below: reversals are not on samples, where Bingham's sign function has no value
        return sine(stroke, frequency, phase=0.1), slow
    if kind == "start":  # away from zero and moving at t = 0
        return sine(stroke, frequency, phase=0.8, offset=0.3 * stroke), constant(0.7 * high + 0.3 * low)
    if kind == "triangle":
        return triangle(stroke, 1.013 * frequency), slow
    return multisine(0.3 * stroke, 0.4, 8.0, seed=3), random_steps(low, high, 0.13, 40, seed=5)


def attributes(id: str) -> dict[str, float]:
    """The law's attributes of a set, the effects it comes with included."""
    return sets.load(id).attributes()


@dataclass(frozen=True)
class Sampled:
    """A record's inputs at one sample time."""

    dt: float
    t: Array
    x: Array
    v: Array
    a: Array
    u: Array
    hold: bool

    def run(
        self, law: str, parameters: Mapping[str, float], columns: tuple[str, ...] = ("force",)
    ) -> dict[str, Array]:
        return core.run(
            law, parameters, self.dt, self.x, self.v, self.a, u=self.u, hold=self.hold, columns=columns
        )


def grid(dt: float, end: float) -> Array:
    return np.arange(round(end / dt) + 1, dtype=np.float64) * np.float64(dt)


def sample(motion: Motion, command: Command, dt: float, end: float) -> Sampled:
    t = grid(dt, end)
    return Sampled(dt, t, *motion.sample(t), command.sample(t), command.held)


@cache
def reference(id: str, kind: str, dt: float, end: float) -> dict[str, Array]:
    """SciPy's solution for a set, on the grid of dt."""
    motion, command = excitation(id, kind)
    t = grid(dt, end)
    return simulate(sets.load(id).law, attributes(id), motion, t, command, rtol=1e-6)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def off(found: Array, wanted: Array) -> float:
    """RMS of the difference over the RMS."""
    size = float(np.mean(wanted**2)) or 1.0  # a part of no weight is zero in both
    return float(np.sqrt(np.mean((found - wanted) ** 2) / size))
