"""Reward of a cable: its parts, their weights, and the reference motion without a damper."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy import signal

from mrdamp.envs.weights import Part, Total, Weights, of_dampers
from mrdamp.errors import InputError
from mrdamp.model.core import Array
from mrdamp.structures.cables import StayCable

_STEP = 1e-3  # s

_PARTS, _TOTALS = of_dampers(2, energy=2)


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

    table: ClassVar[tuple[Part, ...]] = (Part("motion", 0, 0, 0.5), Part("acceleration", 1, 1, 0.5), *_PARTS)
    totals: ClassVar[tuple[Total, ...]] = (
        Total("rms_motion", 0, "rms", 0), Total("motion_ratio", 0, "rms", 0, ratio=True), *_TOTALS,
    )  # fmt: skip


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
