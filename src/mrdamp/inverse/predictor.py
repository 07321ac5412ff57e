"""A copy of a damper that runs in parallel with the real one and predicts: the force that a command would bring."""

from __future__ import annotations

import mujoco
import numpy as np

from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.simulation.mjcf import mjcf

Motion = tuple[float, float, float]  # displacement (m), velocity (m/s), acceleration (m/s2)

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


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
