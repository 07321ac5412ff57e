"""Reward of a cable: its parts, their weights, and the reference motion without a damper."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from mrdamp.envs.weights import DAMPER, PartScore, Weights
from mrdamp.errors import InputError
from mrdamp.structures.cables import StayCable

Array = NDArray[np.float64]

_STEP = 1e-3  # s

#: The reward's parts; each is in `info` as `reward_` and its name, and their sum is the reward.
PARTS = ("motion", "acceleration", "current", "power", "energy")


@dataclass(frozen=True)
class CableReward(Weights):
    """Weights of the reward's parts.

    With m and a the RMS of motion and acceleration over the cable's length and the control period, each over its RMS
    in the whole of the same load's run without a damper, and i the coil current over the largest command:

    | part | of a control period | over an episode of T |
    |---|---|---|
    | motion | m^exponent / T | -100 motion mean(m^exponent) |
    | acceleration | a^exponent / T | -100 acceleration mean(a^exponent) |
    | current | i / T | -100 current mean(i) |
    | power | i^2 / T, the coil's heat over that at the largest current | -100 power mean(i^2) |
    | energy | what the damper takes in over the largest that the free cable held | +100 energy times the sum |

    The default return is -100 times the square of `motion_ratio`, what `mrdamp compare` reports: -100 without a damper.
    """

    motion: float = 1.0
    acceleration: float = 0.0
    energy: float = 0.0

    parts: ClassVar[tuple[str, ...]] = PARTS


def free_run(cable: StayCable, forces: Array, sample_time: float) -> Array:
    """(3,) of the cable without a damper, from rest, under loads (samples, modes) N on its natural coordinates.

    Means of int v^2 dx / L (m2) and int (v'')^2 dx / L (m2/s4), and the largest energy held (J), at steps of 1 ms at
    most. The coordinates are oscillators of their own: exact for loads that are straight from sample to sample
    (sample_time, s). Raises InputError where there is no load.
    """
    inner = math.ceil(sample_time / _STEP - 1e-9)
    dt, samples = sample_time / inner, np.arange(len(forces))
    at = np.arange((len(forces) - 1) * inner + 1) / inner
    squares, energies = np.zeros(2), np.zeros(len(at))
    for w, force in zip(cable.natural, forces.T, strict=True):
        push, damping = np.interp(at, samples, force), 2 * cable.ratio * w
        a, held, rise = _moved(w, cable.ratio, dt)
        given = held[:, None] * push[:-1] + rise[:, None] * np.diff(push)  # (2, steps): coordinate and rate
        poles, state = [1.0, -np.trace(a), np.linalg.det(a)], np.zeros((2, len(at)))
        # (1 - a / z)^-1 by Cramer's rule.
        state[:, 1:] = given
        state[:, 2:] += np.array([[-a[1, 1], a[0, 1]], [a[1, 0], -a[0, 0]]]) @ given[:, :-1]
        q, v = signal.lfilter([1.0], poles, state, axis=1)
        squares += [np.mean(q * q), np.mean((push - damping * v - w * w * q) ** 2)]
        energies += 0.5 * (v * v + w * w * q * q)
    if not squares[0] > 0:
        raise InputError("the load is zero throughout; there is nothing to control")
    return np.array([*squares / (cable.mass * cable.length), energies.max()])


def _moved(w: float, ratio: float, dt: float) -> tuple[Array, Array, Array]:
    """What becomes of coordinate and rate of an oscillator (rad/s) over dt, (2, 2), and what a force of 1 N adds that
    is held, and one that rises to it from zero, (2,) each."""
    damped, fall = w * math.sqrt(1 - ratio**2), ratio * w
    c, s = math.exp(-fall * dt) * math.cos(damped * dt), math.exp(-fall * dt) * math.sin(damped * dt) / damped
    a = np.array([[c + fall * s, s], [-w * w * s, c - fall * s]])
    back = np.linalg.inv(np.array([[0.0, 1.0], [-w * w, -2 * fall]]))
    held = back @ (a - np.eye(2))[:, 1]
    return a, held, back @ (held - [0.0, dt]) / dt


class CableScore(PartScore[CableReward]):
    """Rewards of n rows, and their totals since each row's start.

    values (n, 9) are its whole state: the free run's mean squares of motion and acceleration and its energy; sums of
    mean squares of the motion, of power shares, of currents (A or V) and of dissipated energy (J); periods so far, and
    of the load.
    """

    NAMES = (
        *(f"reward_{part}" for part in PARTS),
        "rms_motion",
        "motion_ratio",
        *DAMPER,
    )
    kept = 9

    def of(self, period: Array) -> tuple[Array, Array]:
        """Rewards (n,) of a control period, `PERIOD` (n, 6), and the columns of `info`, (n, names)."""
        v = self.values
        info = self._info()
        ratio = period[:, :2] / v[:, :2]
        info[:, 0:2] = ratio if self.weights.exponent == 2.0 else np.power(ratio, 0.5 * self.weights.exponent)
        info[:, 2:4] = period[:, 2:4]
        np.divide(period[:, 5], v[:, 2], out=info[:, 4])
        info[:, :5] *= self._weights()
        v[:, 3] += period[:, 0]
        v[:, 4:7] += period[:, 3:6]
        v[:, 7] += 1.0
        np.sqrt(v[:, 3] / v[:, 7], out=info[:, 5])
        np.divide(info[:, 5], np.sqrt(v[:, 0]), out=info[:, 6])
        np.divide(v[:, 4:6], v[:, 7:8], out=info[:, 7:9])
        info[:, 9] = v[:, 6]
        return np.add.reduce(info[:, :5], axis=1), info

    def of_one(self, period: Sequence[float]) -> tuple[float, dict[str, float]]:
        """`of` for a single row in plain numbers, bit-identical, and its `info` by name."""
        of_motion, of_acceleration, energy, squares, power, current, work, periods, _ = self.values[0].tolist()
        motion, acceleration = period[0] / of_motion, period[1] / of_acceleration
        if self.weights.exponent != 2.0:
            motion, acceleration = np.power((motion, acceleration), 0.5 * self.weights.exponent).tolist()
        parts = motion, acceleration, period[2], period[3], period[5] / energy
        rewards = self._weighed(parts)
        squares, power, current = squares + period[0], power + period[3], current + period[4]
        work, periods = work + period[5], periods + 1.0
        self.values[0, 3:8] = squares, power, current, work, periods
        rms = math.sqrt(squares / periods)
        info = (*rewards, rms, rms / math.sqrt(of_motion), power / periods, current / periods, work)
        self._parts[:] = rewards
        return float(np.add.reduce(self._parts)), dict(zip(self.NAMES, info, strict=True))
