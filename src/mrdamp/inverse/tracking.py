"""Force tracking in MuJoCo: a damper in the test rig is moved at random and its command given by an inverse; and the
inverse of an identified law in its present state, the command whose force, a horizon ahead, is the wanted one.

A copy of the damper follows the measured motion under the commands given. At each sample it is looked at a horizon
ahead under trial commands, through driver lag, delay and hysteresis, and the command that brings the wanted force is
searched between the smallest and the largest one. So a lagging driver is led: the command goes beyond the wanted
current, as far as it may, so that the current has arrived when the horizon ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from mrdamp.errors import InputError, require_period
from mrdamp.inverse.baselines import Extrapolation, Inverse, command_range
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


def _rig(damper: Model, timestep: float) -> tuple[mujoco.MjModel, mujoco.MjData, int, int]:
    """The test rig, its data, and where the damper's true force and that as its sensor reads it are in them."""
    m = mujoco.MjModel.from_xml_string(mjcf(damper, timestep=timestep))
    true, read = (int(m.sensor(name).adr[0]) for name in ("true_force", "damper_force"))
    return m, mujoco.MjData(m), true, read


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
    m, d, true, read = _rig(plant, STEP)
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
    return float(np.sqrt(np.mean(values**2)))


Motion = tuple[float, float, float]  # displacement (m), velocity (m/s), acceleration (m/s2)

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_TOLERANCE = 2e-3  # of the force between the smallest and the largest command
_MOST = 6  # trial commands besides these two


class ForcePredictor:
    """The model's damper in the test rig, moved as the real one is measured to move.

    The whole chain is stepped by the plugin, any law and any effect, so its state (hysteresis, current, delayed
    commands, temperature, a network's past) is the one that a force has to be found from.

    model: rig `damper`. period: s, between two calls of `follow`. Raises InputError.
    """

    def __init__(self, model: Model, period: float) -> None:
        if model.rig != "damper":
            raise InputError(f"{model.name}: rig {model.rig}; an inverse needs the damper alone")
        self._period = period
        self._model, self._data, self._true, self._read = _rig(model, period)
        self._mass = float(self._model.body_mass[1])
        self._now = np.empty(mujoco.mj_stateSize(self._model, _STATE))
        self.reset()

    def reset(self) -> None:
        """Back to rest; the next `follow` starts the damper where it is found."""
        mujoco.mj_resetData(self._model, self._data)

    def follow(self, motion: Motion) -> tuple[float, float]:
        """Moves on to the next sample; returns the true force and the force as its sensor reads it there, N."""
        self._put(motion)
        mujoco.mj_forward(self._model, self._data)
        mujoco.mj_getState(self._model, self._data, self._now, _STATE)
        return float(self._data.sensordata[self._true]), float(self._data.sensordata[self._read])

    def hold(self, command: float) -> None:
        """The command of the period that begins at the sample last followed."""
        self._data.ctrl[0] = command
        mujoco.mj_step(self._model, self._data)

    def ahead(self, motion: Motion, duration: float, command: float) -> float:
        """True force (N) after a duration (s) that ends in a motion, the command held; nothing is changed."""
        self._model.opt.timestep = duration  # the chain cuts it into its own steps
        self.hold(command)
        self._put(motion)
        mujoco.mj_forward(self._model, self._data)
        force = float(self._data.sensordata[self._true])
        self._model.opt.timestep = self._period
        mujoco.mj_setState(self._model, self._data, self._now, _STATE)
        return force

    def _put(self, motion: Motion) -> None:
        data = self._data
        data.qpos[0], data.qvel[0] = motion[0], motion[1]
        data.qfrc_applied[0] = self._mass * motion[2]  # what a moving mass at the rod end feels


class LawInverse:
    """Inverse of a model of any law and any effects, by search in its present state.

    Attributes: name; period, s; horizon, s; low, high, the range of the command; force, the model's own force at the
    last sample, N; bias, measured less modelled force as it is extrapolated for the horizon's end, N.
    """

    def __init__(
        self,
        model: Model,
        period: float = 1e-3,
        commands: tuple[float, float] | None = None,
        name: str = "law inverse",
    ) -> None:
        """model: as identified, rig `damper`. period: of control, s. commands: range; None: 0 and up to the model's
        command_max. Raises InputError.

        The horizon is the command's delay and half the driver's lag, at least one period. The wanted force is
        extrapolated over it by its last change, and of the measured force's difference from the model's as much is
        counted as lasted over it up to now (`Extrapolation`).
        """
        require_period(f"inverse {name}", period)
        self.name, self.period = name, float(period)
        self.low, self.high = command_range(model, commands)
        delay, *lags = (
            model.attributes.get(key, 0.0) for key in ("command_delay_d", "driver_lag_tau", "driver_lag_tau2")
        )
        delay += model.attributes.get("command_delay_period", 0.0)  # a clock's, at most
        self.horizon = delay + max(period, 0.5 * sum(lags))
        self._preview, self._feedback = (Extrapolation(self.horizon / period, period) for _ in range(2))
        self._predictor = ForcePredictor(model, period)
        self.reset()

    def reset(self) -> None:
        self._predictor.reset()
        self._preview.reset()
        self._feedback.reset()
        self.force = self.bias = 0.0
        self._velocity: float | None = None
        self._wanted: float | None = None
        self._last = self.low

    def command(self, t: float, wanted_force: float, y: Mapping[str, float]) -> float:
        x, v = y["stroke"], y["stroke_velocity"]
        before, self._velocity = self._velocity, v
        a = 0.0 if before is None else (v - before) / self.period
        self.force, read = self._predictor.follow((x, v, a))
        error = y["force"] - read
        self.bias = self._feedback(error, -error)
        s = self.horizon
        ahead: Motion = x + v * s + 0.5 * a * s * s, v + a * s, a
        last = wanted_force if self._wanted is None else self._wanted
        aim = self._preview(wanted_force, (wanted_force - last) * s / self.period)
        self._wanted = wanted_force
        self._last = search(
            lambda u: self._predictor.ahead(ahead, s, u) + self.bias,
            aim, self.low, self.high, self._last,
        )  # fmt: skip
        self._predictor.hold(self._last)
        return self._last


def search(force: Callable[[float], float], wanted: float, low: float, high: float, last: float) -> float:
    """The command between low and high whose force is the wanted one; the nearer end where none is.

    force: continuous in the command. last: what is returned where the command does not matter. Illinois' variant of
    the false position, which is exact in one step for a force that is linear in the command.
    """
    f_low, f_high = force(low) - wanted, force(high) - wanted
    authority = abs(f_high - f_low)
    if authority <= 1e-9 * max(abs(f_low), abs(f_high), abs(wanted)):
        return last
    if f_low * f_high >= 0:
        return low if abs(f_low) <= abs(f_high) else high
    a, b = low, high
    u = a
    for _ in range(_MOST):
        u = (a * f_high - b * f_low) / (f_high - f_low)
        f = force(u) - wanted
        if abs(f) <= _TOLERANCE * authority:
            break
        if f * f_high < 0:
            a, f_low = b, f_high
        else:
            f_low *= 0.5
        b, f_high = u, f
    return min(max(u, low), high)
