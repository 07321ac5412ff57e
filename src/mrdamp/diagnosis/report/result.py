"""Result of a diagnosis, and its JSON form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from mrdamp.diagnosis.attribution.shares import Measured, Regime
from mrdamp.diagnosis.evidence.consistency import RegimeEstimate
from mrdamp.diagnosis.problem.residuals import pooled
from mrdamp.diagnosis.signatures.loops import Signature
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.shown import Shown

#: Resamples of a bar's interval, and their seed.
_RESAMPLES, _SEED = 2000, 3


@dataclass(frozen=True)
class Named:
    """A named effect: its share of the gap's excess over the noise, parameters in SI units.

    by_regime: its parameters from the records of each regime alone.
    """

    effect: str
    stage: str
    place: int | None
    probability: float
    parameters: Mapping[str, float]
    share: float
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    by_regime: tuple[RegimeEstimate, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        return {
            "name": self.effect,
            "stage": self.stage,
            "place": self.place,
            "probability": self.probability,
            "parameters": dict(self.parameters),
            "share": self.share,
            "intervals": {k: list(v) for k, v in self.intervals.items()},
            "by_regime": [r.to_dict() for r in self.by_regime],
        }


@dataclass(frozen=True)
class Candidate:
    """A fitted set of causes: probability, and gap on left-out records."""

    causes: tuple[str, ...]
    probability: float
    heldout_gap: float

    def to_dict(self) -> dict[str, Any]:
        return {
            "effects": list(self.causes),
            "probability": self.probability,
            "heldout_gap": self.heldout_gap,
        }


@dataclass(frozen=True)
class Step:
    """A bar of the waterfall: what was added, the gap after it on left-out records, and its 95 % interval."""

    name: str
    gap: float
    interval: tuple[float, float]

    def to_dict(self) -> dict[str, Any]:
        return {"name": self.name, "gap": self.gap, "interval": list(self.interval)}


@dataclass(frozen=True)
class Where:
    """Shares of the gap by stage (adding up to 1), by record, and conspicuous regimes; 95 % intervals."""

    stages: Mapping[str, float]
    records: Mapping[str, float] = field(default_factory=dict)
    regimes: tuple[Regime, ...] = ()
    places: Mapping[str, float] = field(default_factory=dict)  # frame: storeys, floors, sensors
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # of the stages' shares
    place_intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    measured: tuple[Measured, ...] = ()  # damper: parts of the chain between measured channels

    def to_dict(self) -> dict[str, Any]:
        return {
            "stages": dict(self.stages),
            "intervals": {k: list(v) for k, v in self.intervals.items()},
            "measured": [m.to_dict() for m in self.measured],
            "records": dict(self.records),
            "regimes": [r.to_dict() for r in self.regimes],
            "places": dict(self.places),
            "place_intervals": {k: list(v) for k, v in self.place_intervals.items()},
        }


@dataclass(frozen=True)
class Gap:
    """RMS error over the RMS of the measurement, records pooled.

    nominal, corrected: of `mrdamp predict` with case.json and corrected.json on the case's records. left_out,
    recalibrated and the interval: each record left out of the fit in turn.
    """

    nominal: float
    recalibrated: float
    corrected: float
    noise_floor: float
    interval: tuple[float, float]
    ceiling: float | None = None  # of a model of any form
    baseline: float | None = None  # nominal, on the rig's baseline records
    left_out: float | None = None  # corrected, each record left out of the fit in turn

    def to_dict(self) -> dict[str, Any]:
        names = ("nominal", "recalibrated", "corrected", "noise_floor", "ceiling", "left_out", "baseline")
        return {**{name: getattr(self, name) for name in names}, "interval": list(self.interval)}


@dataclass(frozen=True)
class Remainder:
    """Error that no cause explains: its gap in the corrected simulator, its share of the nominal excess over
    the noise, and its kind.

    of: `law` if a regression on the same inputs predicts part of it, `unpredictable` if it does not, `outside` if a
    cause outside the catalogue explains it. regimes: where it is largest.
    """

    gap: float
    share: float
    of: str
    stage: str | None
    regimes: tuple[Regime, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        own = {"gap": self.gap, "share": self.share, "of": self.of, "stage": self.stage}
        return {**own, "regimes": [r.to_dict() for r in self.regimes]}


@dataclass(frozen=True)
class Diagnosis(Shown):
    """The answer for a case. `pictures`: arrays by name, for the page."""

    picture: ClassVar[str] = "mrdamp.diagnosis.report.picture:chain_picture"
    case: str
    rig: str
    question: str  # changed, missed or either: see Case.question
    verdict: str
    effects: tuple[Named, ...]
    candidates: tuple[Candidate, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    where: Where
    gap: Gap
    waterfall: tuple[Step, ...]
    next_experiment: Mapping[str, Any]
    corrected: Model
    unseen: tuple[
        Mapping[str, Any], ...
    ] = ()  # effects that these records cannot show, with the size that may be present
    notes: tuple[str, ...] = ()  # audit, bounds, failed fits
    corrections: tuple[str, ...] = ()  # terms in the corrected model that correct a form and are not named
    probabilities: Mapping[str, float] = field(
        default_factory=dict
    )  # by cause, and of none, parameters, unknown
    intervals: Mapping[str, tuple[float, float]] = field(
        default_factory=dict
    )  # 95 %, of every free setting of the corrected simulator's last fit
    compared: tuple[Mapping[str, Any], ...] = ()  # channels of one quantity
    remainder: Remainder | None = None  # None if the corrected simulator reaches the noise
    standing: Mapping[str, Any] | None = None  # log odds of the causes if no fit reaches the noise
    signatures: tuple[Signature, ...] = ()  # of a damper's loops: measured, nominal, corrected
    outside: Mapping[str, Any] | None = (
        None  # cause outside the catalogue that explains an unknown gap
    )
    baseline_law: Mapping[str, Any] | None = None  # law identified again on the baseline, if it is used
    other_law: Mapping[str, Any] | None = None  # law identified on these records that makes a cause needless
    stepped: tuple[
        Mapping[str, Any], ...
    ] = ()  # check of the MJCF on records: gaps offline and in MuJoCo
    seconds: float = 0.0
    next_signal: Mapping[str, Any] | None = field(default=None, repr=False)  # columns of the next test's CSV
    drawn: tuple[Model, ...] = field(
        default=(), repr=False
    )  # the corrected model with jointly drawn parameters
    pictures: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __str__(self) -> str:
        return self.sentence

    @cached_property
    def sentence(self) -> str:
        """The answer in a few sentences."""
        from mrdamp.diagnosis.report.sentence import sentence  # it words what this module declares

        return sentence(self)

    def to_dict(self) -> dict[str, Any]:
        """Content of `diagnosis.json`."""
        return {
            "case": self.case,
            "format": 1,
            "rig": self.rig,
            "question": self.question,
            "verdict": self.verdict,
            "sentence": self.sentence,
            "effects": [e.to_dict() for e in self.effects],
            "candidates": [c.to_dict() for c in self.candidates],
            "probabilities": dict(self.probabilities),
            "channels_compared": [dict(c) for c in self.compared],
            "standing": dict(self.standing) if self.standing is not None else None,
            "outside_catalogue": dict(self.outside) if self.outside is not None else None,
            "baseline_law": dict(self.baseline_law) if self.baseline_law is not None else None,
            "other_law": dict(self.other_law) if self.other_law is not None else None,
            "indistinguishable": [list(t) for t in self.indistinguishable],
            "unseen": [dict(u) for u in self.unseen],
            "where": self.where.to_dict(),
            "gap": self.gap.to_dict(),
            "remainder": self.remainder.to_dict() if self.remainder is not None else None,
            "waterfall": [s.to_dict() for s in self.waterfall],
            "corrections": list(self.corrections),
            "parameter_intervals": {k: list(v) for k, v in self.intervals.items()},
            "signatures": [asdict(s) for s in self.signatures],
            "mujoco": [dict(row) for row in self.stepped],
            "next_experiment": dict(self.next_experiment),
            "notes": list(self.notes),
            "seconds": round(self.seconds, 1),
        }


def step(name: str, gaps: Array) -> Step:
    """A bar with its interval by bootstrap over records."""
    rng = np.random.default_rng(_SEED)
    picks = rng.integers(0, len(gaps), (_RESAMPLES, len(gaps)))
    low, high = np.percentile(np.sqrt(np.mean(gaps[picks] ** 2, axis=1)), [2.5, 97.5])
    return Step(name, pooled(gaps), (float(low), float(high)))
