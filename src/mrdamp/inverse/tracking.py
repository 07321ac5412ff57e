"""Force tracking in MuJoCo: a damper in the test rig is moved at random and its command given by an inverse."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from mrdamp.errors import InputError
from mrdamp.inverse.baselines import Inverse
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.mjcf import mjcf

#: s, the engine's step, and the time between two samples of a wanted force and of a track.
STEP = 5e-4

_LINES = 60  # sines of a random motion
_FADE = 0.5  # s


@dataclass(frozen=True)
class RandomMotion:
    """A sum of sines of random phase: displacement, velocity and acceleration are exact at any time.

    Attributes: rms (m) of the displacement, whose spectrum is flat from `low` to `high` (Hz); seed.
    """

    rms: float
    low: float
    high: float
    seed: int

    def __post_init__(self) -> None:
        if not (0 < self.rms < math.inf and 0 < self.low < self.high < math.inf):
            raise InputError(
                f"random motion: rms {self.rms:g} m, {self.low:g} to {self.high:g} Hz; "
                "allowed: > 0, from below to above"
            )

    def sample(self, time: Array) -> tuple[Array, Array, Array]:
        """x (n,) m, v (n,) m/s, a (n,) m/s2; it fades in over half a second, from rest at zero."""
        x, v, a = self.steady(time)
        s = np.clip(time / _FADE, 0.0, 1.0)
        w = s**3 * (10 - 15 * s + 6 * s**2)  # and its first and second derivative
        w1 = 30 * s**2 * (1 - s) ** 2 / _FADE
        w2 = 60 * s * (1 - s) * (1 - 2 * s) / _FADE**2
        return w * x, w * v + w1 * x, w * a + 2 * w1 * v + w2 * x

    def steady(self, time: Array) -> tuple[Array, Array, Array]:
        """The same without fading in."""
        rng = np.random.default_rng(self.seed)
        band = np.linspace(self.low, self.high, _LINES + 1)
        omega = 2 * np.pi * rng.uniform(band[:-1], band[1:])
        angle = np.outer(time, omega) + rng.uniform(0, 2 * np.pi, _LINES)
        sine, cosine = np.sin(angle), np.cos(angle)
        size = self.rms * math.sqrt(2 / _LINES)
        return size * sine.sum(axis=1), size * (cosine @ omega), -size * (sine @ omega**2)


def random_level(time: Array, high: float, seed: int) -> Array:
    """(n,) between 0 and 1, every level as likely, with frequencies up to `high` (Hz)."""
    normal, _, _ = RandomMotion(1.0, 0.02 * high, high, seed).steady(time)
    return np.array([0.5 * (1 + math.erf(value / math.sqrt(2))) for value in normal])


@dataclass(frozen=True, eq=False)
class Track:
    """A run, (n,) each: time (s), wanted and true force (N), command, displacement (m), velocity (m/s).

    start: s; what is before does not count in the figures.
    """

    name: str
    time: Array
    wanted: Array
    force: Array
    command: Array
    displacement: Array
    velocity: Array
    start: float = 0.5

    @property
    def error(self) -> float:
        """RMS of force less wanted force, N."""
        return rms((self.force - self.wanted)[self._counts])

    @property
    def relative_error(self) -> float:
        """That over the RMS of the wanted force."""
        return self.error / rms(self.wanted[self._counts])

    @property
    def mean_command(self) -> float:
        """In the command's unit."""
        return float(np.mean(self.command[self._counts]))

    def switching(self, command_max: float) -> float:
        """Way of the command per second over its range, 1/s: once on and off a second is 2."""
        counted = self.command[self._counts]
        return float(np.abs(np.diff(counted)).sum()) / command_max / (STEP * len(counted))

    @property
    def _counts(self) -> Array:
        return np.asarray(self.time >= self.start)


def track(
    plant: Model,
    motion: RandomMotion,
    wanted: Array,
    inverse: Inverse,
    *,
    noise: tuple[float, float, float] = (0.0, 0.0, 0.0),
    seed: int = 0,
) -> Track:
    """Drives the plant's damper through the motion with the inverse in the loop.

    plant: rig `damper`; all of its effects are stepped. wanted (n,): force, N, a sample every `STEP`; it is handed to
    the inverse once a period, a multiple of that. noise: standard deviations of what the inverse measures of stroke
    (m), velocity (m/s) and force (N). The force that is kept is the true one. Raises InputError.
    """
    if plant.rig != "damper":
        raise InputError(f"{plant.name}: rig {plant.rig}; force tracking needs the damper alone")
    every = round(inverse.period / STEP)
    if every < 1 or abs(every * STEP / inverse.period - 1) > 1e-6:
        raise InputError(
            f"inverse {inverse.name}: period {inverse.period:g} s; allowed: multiples of {STEP:g} s"
        )
    n = len(wanted)
    time = STEP * np.arange(n, dtype=np.float64)
    x, v, a = motion.sample(time)
    disturbed = np.random.default_rng(seed).standard_normal((n, 3)) * np.array(noise)
    m = mujoco.MjModel.from_xml_string(mjcf(plant, timestep=STEP))
    d = mujoco.MjData(m)
    true, read = (int(m.sensor(name).adr[0]) for name in ("true_force", "damper_force"))
    force, command = np.empty(n), np.empty(n)
    inverse.reset()
    for k in range(n):
        d.qpos[0], d.qvel[0], d.qfrc_applied[0] = x[k], v[k], m.body_mass[1] * a[k]
        if k % every == 0:
            mujoco.mj_forward(m, d)
            y = {
                "stroke": x[k] + disturbed[k, 0],
                "stroke_velocity": v[k] + disturbed[k, 1],
                "force": float(d.sensordata[read]) + disturbed[k, 2],
            }
            d.ctrl[0] = inverse.command(float(time[k]), float(wanted[k]), y)
        command[k] = d.ctrl[0]
        mujoco.mj_step(m, d)
        force[k] = d.sensordata[true]  # of the state before the step
    return Track(inverse.name, time, wanted, force, command, x, v)


def rms(values: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))
