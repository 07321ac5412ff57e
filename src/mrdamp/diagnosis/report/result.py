"""Result of a diagnosis, and its JSON form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
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
#: Bar of the law that was identified again.
LAW_AGAIN = "law of the baseline"
#: Fields that have another name in `diagnosis.json`, or are not in it (None).
_NAMES: Mapping[tuple[str, str], str | None] = {
    ("Named", "effect"): "name",
    ("Candidate", "causes"): "effects",
    ("Diagnosis", "compared"): "channels_compared",
    ("Diagnosis", "outside"): "outside_catalogue",
    ("Diagnosis", "intervals"): "parameter_intervals",
    ("Diagnosis", "stepped"): "mujoco",
    **{("Diagnosis", name): None for name in ("corrected", "next_signal", "drawn", "pictures")},
}


def as_json(value: Any) -> Any:
    """A value as `diagnosis.json` has it: dataclasses by their fields."""
    if is_dataclass(value):
        named = {f.name: _NAMES.get((type(value).__name__, f.name), f.name) for f in fields(value)}
        return {there: as_json(getattr(value, here)) for here, there in named.items() if there is not None}
    if isinstance(value, Mapping):
        return {name: as_json(v) for name, v in value.items()}
    return [as_json(v) for v in value] if isinstance(value, (tuple, list)) else value


@dataclass(frozen=True)
class Named:
    """A named effect: its share of the nominal simulator's squared excess over the noise, parameters in SI units.

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

    @property
    def cause(self) -> str:
        """The effect with its place: `floor_mass@2`."""
        return self.effect if self.place is None else f"{self.effect}@{self.place}"


@dataclass(frozen=True)
class Candidate:
    """A fitted set of causes: probability, and gap on left-out records; of those of the search, excerpts of long ones,
    if it is not the answer."""

    causes: tuple[str, ...]
    probability: float
    heldout_gap: float


@dataclass(frozen=True)
class Step:
    """A bar of the waterfall: what was added, the gap after it on left-out records, and its 95 % interval."""

    name: str
    gap: float
    interval: tuple[float, float]

    def at(self, gap: float) -> Step:
        """The bar at another figure of the same records, its interval in proportion."""
        scale = gap / self.gap if self.gap > 0 else 1.0
        return replace(self, gap=gap, interval=(scale * self.interval[0], scale * self.interval[1]))


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


@dataclass(frozen=True)
class Gap:
    """RMS error over the RMS of the measurement, records pooled.

    nominal, corrected: of `mrdamp predict` with case.json and corrected.json on the case's records; baseline: the same
    as nominal on the baseline's. left_out, recalibrated and the interval: on records left out of the fit
    (`fits.left_out.folds`); left_out of what is not fitted is `corrected`.
    """

    nominal: float
    recalibrated: float
    corrected: float
    noise_floor: float
    interval: tuple[float, float]
    left_out: float  # corrected, on records left out of the fit
    ceiling: float | None = None  # what a regression on the inputs leaves on records left out
    baseline: float | None = None  # nominal, on the rig's baseline records

    def share(self, left: float) -> float:
        """Share of the nominal simulator's squared excess over the noise that a simulator with the gap `left` has."""
        noise = self.noise_floor**2
        return (left**2 - noise) / max(self.nominal**2 - noise, 1e-12)


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


@dataclass(frozen=True)
class Diagnosis(Shown):
    """The answer for a case.

    question: changed, missed or either (see `Case.question`). probabilities: by cause, and of none, parameters,
    unknown. unseen: effects that these records cannot show, with the size that may be present. notes: audit, bounds,
    failed fits. intervals: 95 %, of every free setting of the corrected simulator's last fit. compared: channels of one
    quantity. remainder: None if the corrected simulator reaches the noise. standing: probabilities of the causes and of
    their alternatives. signatures: of a damper's loops. outside: cause outside the catalogue that explains an unknown
    gap. baseline_law: identified again on the baseline, if it is used. beyond_baseline: how all records leave its
    regimes. covered: number of records within them, and of all. other_law: identified on these records, if it makes a
    cause needless. stepped: check of the MJCF on records. next_signal: columns of the next test's CSV. drawn: the
    corrected model with jointly drawn parameters. pictures: arrays by name, for the page.
    """

    picture: ClassVar[str] = "mrdamp.diagnosis.report.page:chain_picture"
    case: str
    rig: str
    question: str
    verdict: str
    effects: tuple[Named, ...]
    candidates: tuple[Candidate, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    where: Where
    gap: Gap
    waterfall: tuple[Step, ...]
    next_experiment: Mapping[str, Any]
    corrected: Model
    unseen: tuple[Mapping[str, Any], ...] = ()
    notes: tuple[str, ...] = ()
    probabilities: Mapping[str, float] = field(default_factory=dict)
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    compared: tuple[Mapping[str, Any], ...] = ()
    remainder: Remainder | None = None
    standing: Mapping[str, Any] | None = None
    signatures: tuple[Signature, ...] = ()
    outside: Mapping[str, Any] | None = None
    baseline_law: Mapping[str, Any] | None = None
    beyond_baseline: str | None = None
    covered: tuple[int, int] = (0, 0)
    other_law: Mapping[str, Any] | None = None
    stepped: tuple[Mapping[str, Any], ...] = ()
    seconds: float = 0.0
    next_signal: Mapping[str, Any] | None = field(default=None, repr=False)
    drawn: tuple[Model, ...] = field(default=(), repr=False)
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
        first = {"case": self.case, "format": 1, "verdict": self.verdict, "sentence": self.sentence}
        return {**first, **as_json(self), "seconds": round(self.seconds, 1)}


def step(name: str, gaps: Array) -> Step:
    """A bar with its interval by bootstrap over records."""
    rng = np.random.default_rng(_SEED)
    picks = rng.integers(0, len(gaps), (_RESAMPLES, len(gaps)))
    low, high = np.percentile(np.sqrt(np.mean(gaps[picks] ** 2, axis=1)), [2.5, 97.5])
    return Step(name, pooled(gaps), (float(low), float(high)))
