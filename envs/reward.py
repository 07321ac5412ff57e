"""Reward of a frame: its parts, their weights, and the reference response to the same motion."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from mrdamp.envs.weights import Part, Total, Weights, of_dampers
from mrdamp.errors import InputError, require_one_of
from mrdamp.model import Model, core
from mrdamp.model.core import Array

_PARTS, _TOTALS = of_dampers(2, energy=2)


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

    table: ClassVar[tuple[Part, ...]] = (
        Part("drift", 0, 0, 1.0), Part("acceleration", 1, 1, 1.0), Part("drift_peak", 0, 0, rise=True, summed=True),
        Part("acceleration_peak", 1, 1, rise=True, summed=True), *_PARTS,
    )  # fmt: skip
    totals: ClassVar[tuple[Total, ...]] = (
        Total("peak_drift", 0, "peak", 0), Total("peak_acceleration", 1, "peak", 1),
        Total("drift_ratio", 0, "peak", 0, ratio=True), Total("acceleration_ratio", 1, "peak", 1, ratio=True), *_TOTALS,
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of("reward", ("uncontrolled", "passive-on"), reference=self.reference)


class Reference(NamedTuple):
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
