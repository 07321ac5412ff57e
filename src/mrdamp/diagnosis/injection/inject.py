"""An effect of a given size in the records of a rig, or the reason why these records cannot have it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from mrdamp.diagnosis.hypotheses.damper_effects import rms
from mrdamp.diagnosis.injection.forms import FORMS, Form
from mrdamp.diagnosis.injection.signals import FORCES, Scales, Signals
from mrdamp.diagnosis.problem.residuals import compared
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.simulation.predict import free_run

#: Effects of a damper that cannot be inserted exactly into a record, and why.
NOT_EXACT: Mapping[str, str] = {
    "heating": "heat takes the fluid's viscosity and its yield down by different shares, which a record does not part",
}
#: Laws whose dashpot is parallel to the rest, so that its force follows from the motion.
_PARALLEL = ("bingham", "bouc_wen")
#: Share of the largest command by which two levels must differ (as in the identification).
_SAME_LEVEL = 0.02
#: A logged command may exceed the rig's range by this share of the range.
_OVERSHOOT = 0.25
#: Least share of an injected change of the command that a curve through the levels must leave; below it the
#: change is a static curve.
_STATIC = 0.1
#: Range of strengths for a given size, and number of trial points.
_WEAKEST, _STRONGEST, _TRIALS = 2e-3, 4.0, 12
#: Iterations of the regula falsi within the bracket; the size is met within 1 %.
_ITERATIONS, _MET = 12, 0.01


class NotPut(str):
    """A reason why an effect cannot be inserted into records that might show it all the same."""


@dataclass(frozen=True, eq=False)
class Injection:
    """An effect drawn for a rig: records with it at any strength.

    form: what is inserted. random: of its sides and shapes. scales: of the records that the sizes were drawn for.
    model: their nominal simulator.
    """

    form: Form
    random: np.random.Generator
    scales: Scales
    model: Model

    @classmethod
    def draw(
        cls, effect: str, model: Model, records: Sequence[Record], rng: np.random.Generator
    ) -> Injection:
        """Random sides and shapes, scaled by the records."""
        out = cls(FORMS[effect], deepcopy(rng), Scales.of(records, model), model)
        out.form.draw(rng, out.scales, model, 1.0)  # the next injection has numbers of its own
        return out

    def parameters(self, strength: float) -> dict[str, float]:
        """Parameters at a strength, SI units."""
        return self.form.draw(deepcopy(self.random), self.scales, self.model, strength)

    def put(self, record: Record, strength: float) -> Record:
        """The record of the rig with the effect."""
        return self.form.put(Signals(record), self.parameters(strength), self.scales)


def refusal(effect: str, model: Model, records: Sequence[Record]) -> str:
    """Reason why an effect cannot be identified from these records, or (`NotPut`) cannot be inserted into them; empty
    if it can."""
    if effect not in FORMS:
        return NotPut(NOT_EXACT.get(effect, "no exact form of it is known"))
    form = FORMS[effect]
    if effect == "shear_thinning" and model.law not in _PARALLEL:
        return NotPut(
            f"the dashpot of {model.law} stands in series with a spring, so that its share of the measured force is"
            f" not known from the motion; possible with {' and '.join(_PARALLEL)}"
        )
    span = max(float(np.abs(r.command).max()) for r in records)
    varying = [r for r in records if np.ptp(r.command) > _SAME_LEVEL * span]
    if form.varies and (not span > 0 or not varying):
        return "the command is constant in every record, so that nothing in it can be late or come back another way"
    if form.levels and count_levels(records) < form.levels:
        return (
            f"the command has {count_levels(records)} levels; a curve or a loop shows from {form.levels} on"
        )
    if form.varies:
        injection = Injection.draw(effect, model, varying, np.random.default_rng(0))
        return _of_command(injection, varying)
    return ""


def _of_command(injection: Injection, records: Sequence[Record]) -> str:
    """Refusal of an effect between command and current, at a middle strength."""
    low, high = (f(f(r.command) for r in records) for f in (min, max))
    beyond, left, all_of_it = 0.0, 0.0, 0.0
    for record in records:
        logged = injection.put(record, 0.2)
        u = np.asarray(record.command)[: logged.n]
        change = np.asarray(logged.command) - u
        beyond = max(beyond, low - float(logged.command.min()), float(logged.command.max()) - high)
        powers = np.vander(u, 4)  # two levels give fewer equations than unknowns: least-norm solution
        left += float(np.sum((change - powers @ np.linalg.lstsq(powers, change)[0]) ** 2))
        all_of_it += float(np.sum((change - change.mean()) ** 2))
    if beyond > _OVERSHOOT * (high - low):
        return NotPut(
            f"the command steps: it would have to leave its range by {beyond / (high - low):.0%} for the current that"
            " flowed"
        )
    if left < _STATIC**2 * all_of_it:
        return "with the levels of this command it is a curve over the command, which the law's own numbers follow"
    return ""


def count_levels(records: Sequence[Record]) -> int:
    """Number of different commands in the records, up to 9; a level counts from 1 % of the samples."""
    command = np.concatenate([r.command for r in records])
    span = float(np.abs(command).max())
    if not span > 0:
        return 1
    _, counts = np.unique(np.round(command / (2 * _SAME_LEVEL * span)), return_counts=True)
    return min(int(np.sum(counts >= 0.01 * len(command))), 9)


def residual(model: Model, record: Record) -> Array:
    """Error (n,) N of a simulator for a record's own force sensor."""
    return np.asarray(record.channel(FORCES[0])) - free_run(model, record)[FORCES[0]]


def change_of(model: Model, records: Sequence[Record]) -> Callable[[Injection, float], float]:
    """Size as a function of injection and strength: RMS change of the simulator's error over the RMS of the
    force, records pooled.

    For an added force, this is its share of the force. For a changed motion or command, it is the change of
    the simulated force.
    """
    before = [residual(model, r) for r in records]

    def change(injection: Injection, strength: float) -> float:
        total = 0.0
        for r, own in zip(records, before, strict=True):
            put = injection.put(r, strength)
            first = round((put.time[0] - r.time[0]) / r.sample_time)
            kept = compared(put.n, r.sample_time)
            moved = residual(model, put) - own[first : first + put.n]
            total += rms(moved[kept]) ** 2 / rms(r.channel(FORCES[0])[first:][kept]) ** 2
        return float(np.sqrt(total / len(records)))

    return change


def strength_of(size: Callable[[float], float], target: float) -> float | None:
    """The least strength at which a size is `target`; None if no strength reaches it."""
    grid = np.geomspace(_WEAKEST, _STRONGEST, _TRIALS)
    before, size_before = 0.0, 0.0
    for trial in grid:
        found = size(float(trial))
        if not np.isfinite(found):
            return None
        if found >= target:
            return _regula_falsi(size, target, (before, size_before), (float(trial), found))
        before, size_before = float(trial), found
    return None


def _regula_falsi(
    size: Callable[[float], float], target: float, low: tuple[float, float], high: tuple[float, float]
) -> float:
    best = high
    for count in range(_ITERATIONS):
        if abs(best[1] / target - 1) < _MET:
            break
        if count % 3 == 2 or high[1] <= low[1] or low[0] <= 0:
            middle = 0.5 * (low[0] + high[0])
        else:
            middle = low[0] + (high[0] - low[0]) * (target - low[1]) / (high[1] - low[1])
        best = (middle, size(middle))
        low, high = (best, high) if best[1] < target else (low, best)
    return best[0]


def widened(model: Model, records: Sequence[Record]) -> Model:
    """The model with a command range that contains the logged commands. The range is that of the
    identification records and not a property of the rig."""
    if "command_max" not in model.parameters:
        return model
    low = min(model.parameters.get("command_min", 0.0), *(float(r.command.min()) for r in records))
    high = max(model.parameters["command_max"], *(float(r.command.max()) for r in records))
    return replace(model, parameters={**model.parameters, "command_min": low, "command_max": high})
