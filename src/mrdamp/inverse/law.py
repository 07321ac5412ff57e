"""The inverse of an identified law in its present state: the command whose force, a horizon ahead, is the wanted one.

A copy of the damper follows the measured motion under the commands given. At each sample it is looked at a horizon
ahead under trial commands, through driver lag, delay and hysteresis, and the command that brings the wanted force is
searched between the smallest and the largest one. So a lagging driver is led: the command goes beyond the wanted
current, as far as it may, so that the current has arrived when the horizon ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import mujoco
import numpy as np

from mrdamp.errors import InputError, require_period
from mrdamp.inverse.baselines import Extrapolation, command_range
from mrdamp.model import Model
from mrdamp.simulation.mjcf import mjcf

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
        self._model = mujoco.MjModel.from_xml_string(mjcf(model, timestep=period))
        self._data = mujoco.MjData(self._model)
        self._true, self._read = (
            int(self._model.sensor(name).adr[0]) for name in ("true_force", "damper_force")
        )
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
        horizon: float | None = None,
        commands: tuple[float, float] | None = None,
        feedback: bool = True,
        preview: bool = True,
        name: str = "law inverse",
    ) -> None:
        """model: as identified, rig `damper`. period: of control, s. horizon: how far ahead the force is to be the
        wanted one, s; None: the command's delay and half the driver's lag, at least one period. A shorter one leads
        the driver harder. commands: range; None: 0 and up to the model's command_max. feedback: the measured force's
        difference from the model's is counted, as much of it as lasted over the horizon up to now. preview: the wanted
        force is extrapolated over the horizon by its last change (`Extrapolation`). Raises InputError.
        """
        require_period(f"inverse {name}", period)
        self.name, self.period = name, float(period)
        self.low, self.high = command_range(model, commands)
        delay, *lags = (
            model.attributes.get(key, 0.0) for key in ("command_delay_d", "driver_lag_tau", "driver_lag_tau2")
        )
        delay += model.attributes.get("command_delay_period", 0.0)  # a clock's, at most
        self.horizon = delay + max(period, 0.5 * sum(lags)) if horizon is None else horizon
        if not delay < self.horizon < math.inf:
            raise InputError(
                f"inverse {name}: horizon is {horizon} s; allowed: longer than the command's delay of {delay:g} s"
            )
        steps = self.horizon / period
        self._preview = Extrapolation(steps, period) if preview else None
        self._feedback = Extrapolation(steps, period) if feedback else None
        self._predictor = ForcePredictor(model, period)
        self.reset()

    def reset(self) -> None:
        self._predictor.reset()
        for extrapolated in (self._preview, self._feedback):
            if extrapolated:
                extrapolated.reset()
        self.force = self.bias = 0.0
        self._velocity: float | None = None
        self._wanted: float | None = None
        self._last = self.low

    def command(self, t: float, wanted_force: float, y: Mapping[str, float]) -> float:
        x, v = y["stroke"], y["stroke_velocity"]
        before, self._velocity = self._velocity, v
        a = 0.0 if before is None else (v - before) / self.period
        self.force, read = self._predictor.follow((x, v, a))
        if self._feedback:
            error = y["force"] - read
            self.bias = self._feedback(error, -error)
        s = self.horizon
        ahead: Motion = x + v * s + 0.5 * a * s * s, v + a * s, a
        aim = wanted_force
        if self._preview:
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
