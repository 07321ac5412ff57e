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

#: The reward's parts; each is in `info` as `reward_` and its name, and their sum is the reward.
PARTS = ("motion", "acceleration", "current", "power", "energy")


@dataclass(frozen=True)
class CableReward(Weights):
    """Weights of the reward's parts.

    With m and a the RMS of motion and acceleration over the cable's length and the control period, each over its RMS
    in the whole of the same load's run without a damper, and i the coil current over the largest command:

    | part | per control period |
    |---|---|
    | motion | -motion m^exponent |
    | acceleration | -acceleration a^exponent |
    | current | -current mean(i) |
    | power | -power mean(i^2), the coil's heat over that at the largest current |
    | energy | +energy times the energy taken in by the damper over the largest that the free cable held |
    """

    motion: float = 1.0
    acceleration: float = 0.0
    energy: float = 0.0

    parts: ClassVar[tuple[str, ...]] = PARTS


def free_run(cable: StayCable, pushes: Array, dt: float) -> Array:
    """(3,) of the cable without a damper, from rest, under loads (samples, modes) N on its natural coordinates.

    Means of int v^2 dx / L (m2) and int (v'')^2 dx / L (m2/s4), and the largest energy held (J). The coordinates are
    oscillators of their own: exact for loads held from sample to sample. Raises InputError where there is no load.
    """
    squares, energies = np.zeros(2), np.zeros(len(pushes))
    for w, push in zip(cable.natural, pushes.T, strict=True):
        damping = 2 * cable.ratio * w
        system = (
            np.array([[0.0, 1.0], [-w * w, -damping]]),
            np.array([[0.0], [1.0]]),
            np.eye(2),
            np.zeros((2, 1)),
        )
        a, b = signal.cont2discrete(system, dt)[:2]
        poles = np.array([1.0, -np.trace(a), np.linalg.det(a)])
        # Cramer's rule for (z - a)^-1 b, row by row.
        q = signal.lfilter([0.0, b[0, 0], a[0, 1] * b[1, 0] - a[1, 1] * b[0, 0]], poles, push)
        v = signal.lfilter([0.0, b[1, 0], a[1, 0] * b[0, 0] - a[0, 0] * b[1, 0]], poles, push)
        squares += [np.mean(q * q), np.mean((push - damping * v - w * w * q) ** 2)]
        energies += 0.5 * (v * v + w * w * q * q)
    if not squares[0] > 0:
        raise InputError("the load is zero throughout; there is nothing to control")
    return np.array([*squares / (cable.mass * cable.length), energies.max()])


class CableScore(PartScore[CableReward]):
    """Rewards of n rows, and their totals since each row's start.

    values (n, 8) are its whole state: the free run's mean squares of motion and acceleration and its energy; sums of
    mean squares of the motion, of power shares, of currents (A or V) and of dissipated energy (J); periods.
    """

    NAMES = (
        *(f"reward_{part}" for part in PARTS),
        "rms_motion",
        "motion_ratio",
        *DAMPER,
    )
    kept = 8

    def of(self, period: Array) -> tuple[Array, Array]:
        """Rewards (n,) of a control period, `PERIOD` (n, 6), and the columns of `info`, (n, names)."""
        v = self.values
        info = self._info()
        ratio = period[:, :2] / v[:, :2]
        info[:, 0:2] = ratio if self.weights.exponent == 2.0 else np.power(ratio, 0.5 * self.weights.exponent)
        info[:, 2:4] = period[:, 2:4]
        np.divide(period[:, 5], v[:, 2], out=info[:, 4])
        info[:, :5] *= self._signed
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
        of_motion, of_acceleration, energy, squares, power, current, work, periods = self.values[0].tolist()
        motion, acceleration = period[0] / of_motion, period[1] / of_acceleration
        if self.weights.exponent != 2.0:
            motion, acceleration = np.power((motion, acceleration), 0.5 * self.weights.exponent).tolist()
        parts = motion, acceleration, period[2], period[3], period[5] / energy
        rewards = [part * sign for part, sign in zip(parts, self._signs, strict=True)]
        squares, power, current = squares + period[0], power + period[3], current + period[4]
        work, periods = work + period[5], periods + 1.0
        self.values[0, 3:] = squares, power, current, work, periods
        rms = math.sqrt(squares / periods)
        info = (*rewards, rms, rms / math.sqrt(of_motion), power / periods, current / periods, work)
        self._parts[:] = rewards
        return float(np.add.reduce(self._parts)), dict(zip(self.NAMES, info, strict=True))
