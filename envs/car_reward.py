"""Reward of a quarter car: its parts, their weights, and the reference response of a linear suspension."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mrdamp.envs.weights import Part, Total, Weights, of_dampers
from mrdamp.errors import InputError
from mrdamp.model.core import Array
from mrdamp.simulation.comfort import wk
from mrdamp.structures.cars import QuarterCar

_PARTS, _TOTALS = of_dampers(5)
#: Of critical: the dashpot of the linear suspension. Passenger cars have .2 to .4 (T. D. Gillespie, Fundamentals of
#: Vehicle Dynamics, SAE 1992, chapter 5).
CONVENTIONAL = 0.3


@dataclass(frozen=True)
class CarReward(Weights):
    """Weights of the reward's parts.

    With a, l and s the RMS over a control period of the body's acceleration weighted by Wk (ISO 2631-1), of the dynamic
    tyre load and of the stroke, each over its RMS on the whole of the same road with a linear suspension (a dashpot of
    .3 of critical, a tyre that never lifts off), and i the coil current over the largest command:

    | part | of a control period | over an episode of T |
    |---|---|---|
    | comfort | a^exponent / T | -100 comfort mean(a^exponent) |
    | holding | l^exponent / T | -100 holding mean(l^exponent) |
    | stroke | s^exponent / T | -100 stroke mean(s^exponent) |
    | airborne | the share of it without contact / T | -100 airborne mean(share) |
    | current | i / T | -100 current mean(i) |
    | power | i^2 / T, the coil's heat over that at the largest current | -100 power mean(i^2) |

    The default return is -50 times the sum of the squares of `comfort_ratio` and `load_ratio`, which `mrdamp compare`
    reports: -100 with the linear suspension.
    """

    comfort: float = 0.5
    holding: float = 0.5
    stroke: float = 0.0
    airborne: float = 0.0

    table: ClassVar[tuple[Part, ...]] = (
        Part("comfort", 0, 0, 0.5), Part("holding", 1, 1, 0.5), Part("stroke", 2, 2, 0.5), Part("airborne", 4), *_PARTS,
    )  # fmt: skip
    totals: ClassVar[tuple[Total, ...]] = (
        *(Total(name, k, "rms", k) for k, name in enumerate(("weighted_acceleration", "rms_load", "rms_stroke"))),
        *(Total(f"{name}_ratio", k, "rms", k, ratio=True) for k, name in enumerate(("comfort", "load", "stroke"))),
        Total("peak_stroke", 3, "peak"), Total("airborne", 4, "mean"), *_TOTALS,
    )  # fmt: skip


def linear_run(
    car: QuarterCar, heights: Array, step: float, damping: float | None = None
) -> tuple[Array, Array, Array]:
    """Weighted acceleration (m/s2), dynamic tyre load over the weight, stroke (m) of the car with a dashpot, (n,) each.

    heights: (n,) m under the wheel, straight between samples every step (s), from rest; damping: N s/m, None: .3 of
    critical. In the frequency domain, exact but for what lies above half the sampling frequency.
    """
    dashpot = CONVENTIONAL * car.critical_damping if damping is None else damping
    a, b, c, d = car.passive(dashpot)
    many = len(heights)
    rest = float(np.linalg.eigvals(a).real.max())  # of the slowest pole, 1/s
    behind = int(min(12.0 / max(-rest, 1e-3), 60.0) / step)
    f = np.fft.rfftfreq(many + behind, step)
    velocity = np.append(np.diff(heights), 0.0) / step
    # Held over each step: its spectrum is that of the samples times this.
    given = np.fft.rfft(velocity, many + behind) * np.sinc(f * step) * np.exp(-1j * np.pi * f * step)
    resolvent = np.linalg.solve(2j * np.pi * f[:, None, None] * np.eye(4) - a, b.astype(np.complex128))
    out = (c @ resolvent + d)[:, :, 0].T * given
    out[0] *= wk(np.maximum(f, 1e-9))
    found = np.fft.irfft(out, many + behind, axis=1)[:, :many]
    return found[0], found[1], found[2]


def reference_run(car: QuarterCar, heights: Array, step: float) -> Array:
    """(3,) mean squares of `linear_run`. Raises InputError where the road is flat."""
    if not np.ptp(heights) > 0:
        raise InputError("the road is flat throughout; there is nothing to control")
    return np.array([np.mean(x * x) for x in linear_run(car, heights, step)])
