"""The law identified again on the rig's baseline: the ladder of laws for a nominal simulator whose law is not
the rig's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mrdamp.diagnosis.constants import BASELINE_LAW_BETTER
from mrdamp.diagnosis.fits.final import predicted_gap
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import Problem, pooled
from mrdamp.errors import InputError
from mrdamp.identify import identify
from mrdamp.identify.laws import DEPENDENCES, EXTRAS, Scales
from mrdamp.model import Model
from mrdamp.records import Record

LAWS = ("bouc_wen", "hyperbolic_tangent", "modified_bouc_wen")
#: Least number of baseline records: one half is fitted, the other one predicted.
_LEAST = 4
#: Of the largest command of the baseline: as far do measured commands wobble that are meant to be the same.
_BEYOND = 0.05


@dataclass(frozen=True)
class BaselineLaw:
    """A simulator identified on the baseline's records.

    given: the case's own simulator. dependence: of the coefficients on the command. before, after: gap of the damper's
    force by the file of the given simulator and of this one on the baseline's records; the latter by fits to the other
    half of the records. searched: the latter with the motion of a search (`DamperRig.with_motion`).
    """

    given: Model
    model: Model
    dependence: str
    before: float
    after: float
    searched: float

    def note(self) -> str:
        """Line for a person."""
        return (
            f"law identified again on the baseline: {self.model.law}, coefficients {self.dependence} in the command;"
            f" its gap on baseline records outside the fit is {100 * self.after:.1f} %, the given simulator's"
            f" {100 * self.before:.1f} %"
        )

    def to_dict(self) -> dict[str, Any]:
        """Entry of `diagnosis.json`."""
        return {
            "law": self.model.law,
            "dependence": self.dependence,
            "baseline_gap_given": self.before,
            "baseline_gap": self.after,
        }


def baseline_law(
    given: DamperRig, baseline: Sequence[Record], asked: Sequence[Record] | None = None
) -> BaselineLaw | None:
    """The law of LAWS with the least error on the baseline, or None if none of them is better than the given
    simulator.

    All laws are fitted with the richest dependence on the command that each half of the records shows, along with the
    given simulator's own effects. The best of them is fitted again to each half of the records and evaluated on the
    other half. It is used if its error there is below BASELINE_LAW_BETTER times the given simulator's, which was
    identified on records of this state; what changed since has no say. None also where the case has commands beyond
    those of the baseline (`asked`: all of its records), at which coefficients would be extrapolated, for a network, for
    effects that `mrdamp identify` does not fit, for fewer than four records, and without the channel force_N.
    """
    model = given.nominal_model
    extras = fitted_along(model)
    if len(baseline) < _LEAST or extras is None or model.law not in (*LAWS, "bingham"):
        return None
    if not all("force_N" in r.channels for r in baseline) or not _spans(baseline, asked or given.records):
        return None
    # Both halves have commands of all kinds and sizes, whatever the order of the files.
    ordered = sorted(baseline, key=lambda r: (np.ptp(r.command), np.mean(r.command), np.std(r.channel("force_N"))))
    parts = (ordered[::2], ordered[1::2])
    dependence = richest(*parts)
    before = gap_of(given, model, baseline)
    # One start: with three, the gap of the best law is the same to 1e-4 on 11 opened baselines.
    how = {"extras": extras, "dependence": dependence, "hold": given.hold, "threads": given.threads, "starts": 1}

    def fitted(law: str, records: Sequence[Record]) -> Model | None:
        fit = identified(law, records, start=model.attributes if law == model.law else None, **how)
        if fit is None:
            return None
        return replace(fit, name=model.name, extra=model.extra, sample_rate_hz=model.sample_rate_hz)

    found = {law: fit for law in LAWS if (fit := fitted(law, baseline)) is not None}
    gaps = {law: gap_of(given, fit, baseline) for law, fit in found.items()}
    if not gaps:
        return None
    law = min(gaps, key=lambda name: gaps[name])
    best = found[law]
    if not gaps[law] < BASELINE_LAW_BETTER * before:
        return None
    halves = [(half, other) for one, other in (parts, parts[::-1]) if (half := fitted(law, one)) is not None]
    if len(halves) < len(parts):
        return None
    searched, after = (
        pooled(np.array([gap(given, half, other) for half, other in halves])) for gap in (gap_of, gap_by_file)
    )
    if not searched < BASELINE_LAW_BETTER * before:
        return None
    return BaselineLaw(model, best, dependence, gap_by_file(given, model, baseline), after, searched)


def richest(*parts: Sequence[Record]) -> str:
    """The richest dependence on the command that all parts of the records show."""
    levels = min(Scales.of(part).levels for part in parts)
    return [name for name, need in DEPENDENCES.items() if need <= levels][-1]


def identified(law: str, records: Sequence[Record], **how: Any) -> Model | None:
    """The model that `identify` finds; None if it finds none."""
    try:
        return identify(law, records, **how).model
    except InputError:
        return None


def _spans(baseline: Sequence[Record], records: Sequence[Record]) -> bool:
    """True if no command of the records is beyond those of the baseline by more than _BEYOND of their range."""
    known, asked = (np.abs(np.concatenate([r.command for r in some])) for some in (baseline, records))
    margin = _BEYOND * float(np.max(known))
    return bool(np.min(asked) >= np.min(known) - margin and np.max(asked) <= np.max(known) + margin)


def fitted_along(model: Model) -> tuple[str, ...] | None:
    """Names of the effects to fit along, None if `mrdamp identify` does not fit one of them."""
    out = {"offset"}
    for effect in model.effects:
        own = set(effect.parameters)
        if effect.name == "gas_spring" and own <= {"f0", "k"}:
            out |= {"gas_spring"} if "k" in own else set()
        elif effect.name in EXTRAS and effect.name != "gas_spring" and len(own) == 1:
            out.add(effect.name)
        else:
            return None
    return tuple(sorted(out))


def gap_by_file(given: DamperRig, model: Model, records: Sequence[Record]) -> float:
    """Gap of a model's file on some records (`predicted_gap`)."""
    return predicted_gap(model, Problem(replace(given, records=tuple(records))))


def gap_of(given: DamperRig, model: Model, records: Sequence[Record]) -> float:
    """RMS over records and channels of the relative error in free run."""
    problem = Problem(DamperRig(model, tuple(records), threads=given.threads).with_motion(), coarse=True)
    return pooled(problem.gaps(problem.nominal()))
