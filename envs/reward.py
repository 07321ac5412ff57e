"""Reward of a frame: its parts, their weights, and the reference response to the same motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from mrdamp.envs.weights import DAMPER, PartScore, Weights
from mrdamp.errors import InputError
from mrdamp.model import Model, core

Array = NDArray[np.float64]

#: The reward's parts; each is in `info` as `reward_` and its name, and their sum is the reward.
PARTS = ("drift", "acceleration", "drift_peak", "acceleration_peak", "current", "power", "energy")


@dataclass(frozen=True)
class FrameReward(Weights):
    """Weights of the reward's parts.

    With d and a the largest |drift| and |absolute acceleration| within a control period, over storeys, floors and
    the steps of the engine, each over the same motion's peak in the `reference` run, and i the coil current over
    the largest command, averaged over the period and the dampers:

    | part | of a control period | over an episode of T |
    |---|---|---|
    | drift_peak | the rise of d's maximum so far | -100 drift_peak J1 |
    | acceleration_peak | the rise of a's maximum so far | -100 acceleration_peak J2 |
    | drift | d^exponent / T | -100 drift mean(d^exponent) |
    | acceleration | a^exponent / T | -100 acceleration mean(a^exponent) |
    | current | i / T | -100 current mean(i) |
    | power | i^2 / T, the coil's heat over that at the largest current | -100 power mean(i^2) |
    | energy | what the dampers take in over the reference run's peak strain energy | +100 energy times the sum |

    The default return is -50 (J1 + J2), what `mrdamp compare` reports: -100 without dampers.

    reference: `uncontrolled`, the frame without dampers, or `passive-on`, the largest command all the time (of one
    damper; it costs more at every reset).
    """

    drift: float = 0.0
    acceleration: float = 0.0
    drift_peak: float = 0.5
    acceleration_peak: float = 0.5
    energy: float = 0.0
    reference: Literal["uncontrolled", "passive-on"] = "uncontrolled"

    parts: ClassVar[tuple[str, ...]] = PARTS
    summed: ClassVar[tuple[str, ...]] = ("drift_peak", "acceleration_peak", "energy")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.reference not in ("uncontrolled", "passive-on"):
            raise InputError(f"reward: reference is {self.reference!r}; allowed: uncontrolled, passive-on")


@dataclass(frozen=True)
class Reference:
    """Response of the frame in the reference run: peaks over storeys or floors, SI."""

    drift: float  # m
    acceleration: float  # m/s2
    strain_energy: float  # J


def reference_run(
    model: Model, ground: Array, dt: float, kind: str = "uncontrolled", command_max: float = 0.0
) -> Reference:
    """Peaks of the frame under ground acceleration (samples,) m/s2 every dt, by the C entry.

    Raises InputError where the ground does not move.
    """
    frame = model.frame
    sensors: dict[str, Any] = {f.name: None for f in fields(frame) if f.name.startswith("acc_")}
    ideal = replace(frame, **sensors)
    if kind == "uncontrolled":
        ideal = replace(ideal, damper_between=None)
    out = core.run_frame(model.law, model.attributes, ideal, dt, ground, command_max, narx=model.narx)
    floors = range(1, len(frame.mass) + 1)
    displacement = np.array([out[f"displacement_{j}"] for j in floors])
    drift = np.diff(displacement, axis=0, prepend=0.0)
    acceleration = np.array([out[f"acceleration_{j}"] for j in floors])
    found = Reference(
        drift=float(np.abs(drift).max()),
        acceleration=float(np.abs(acceleration).max()),
        strain_energy=float((0.5 * frame.stiffness @ drift**2).max()),
    )
    if not found.drift > 0:
        raise InputError("the ground motion is zero throughout; there is nothing to control")
    return found


class Score(PartScore[FrameReward]):
    """Rewards of n rows, and their totals since each row's start.

    values (n, 10) are its whole state: the reference's drift, acceleration and strain energy; the largest drift and
    acceleration so far over the reference's; sums of power shares, of currents (A or V) and of dissipated energy (J);
    periods so far, and of the load.
    """

    NAMES = (
        *(f"reward_{part}" for part in PARTS),
        "peak_drift",
        "peak_acceleration",
        "drift_ratio",
        "acceleration_ratio",
        *DAMPER,
    )
    kept = 10

    def of(self, period: Array) -> tuple[Array, Array]:
        """Rewards (n,) of a control period, `PERIOD` (n, 6), and the columns of `info`, (n, names)."""
        v = self.values
        reference, best = v[:, :2], v[:, 3:5]
        ratio = period[:, :2] / reference
        info = self._info()
        if self.weights.exponent == 2.0:
            np.multiply(ratio, ratio, out=info[:, 0:2])
        else:
            np.power(ratio, self.weights.exponent, out=info[:, 0:2])
        np.maximum(ratio - best, 0.0, out=info[:, 2:4])
        info[:, 4:6] = period[:, 2:4]
        np.divide(period[:, 5], v[:, 2], out=info[:, 6])
        info[:, :7] *= self._weights()
        np.maximum(best, ratio, out=best)
        v[:, 5:8] += period[:, 3:6]
        v[:, 8] += 1.0
        np.multiply(best, reference, out=info[:, 7:9])
        info[:, 9:11] = best
        np.divide(v[:, 5:7], v[:, 8:9], out=info[:, 11:13])
        info[:, 13] = v[:, 7]
        return np.add.reduce(info[:, :7], axis=1), info

    def of_one(self, period: Sequence[float]) -> tuple[float, dict[str, float]]:
        """`of` for a single row in plain numbers, bit-identical, and its `info` by name."""
        of_drift, of_acceleration, energy, best_drift, best_acceleration, *rest = self.values[0].tolist()
        d, a = period[0] / of_drift, period[1] / of_acceleration
        if self.weights.exponent == 2.0:
            d_power, a_power = d * d, a * a
        else:
            d_power, a_power = np.power((d, a), self.weights.exponent).tolist()
        parts = (
            d_power, a_power, max(d - best_drift, 0.0), max(a - best_acceleration, 0.0), period[2], period[3],
            period[5] / energy,
        )  # fmt: skip
        rewards = self._weighed(parts)
        best_drift, best_acceleration = max(best_drift, d), max(best_acceleration, a)
        power, current, work = rest[0] + period[3], rest[1] + period[4], rest[2] + period[5]
        periods = rest[3] + 1.0
        self.values[0, 3:9] = best_drift, best_acceleration, power, current, work, periods
        info = (
            *rewards, best_drift * of_drift, best_acceleration * of_acceleration, best_drift, best_acceleration,
            power / periods, current / periods, work,
        )  # fmt: skip
        self._parts[:] = rewards
        return float(np.add.reduce(self._parts)), dict(zip(self.NAMES, info, strict=True))
