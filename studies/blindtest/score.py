"""Scores of the answers: the rows of a blind test and its figures."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from studies.blindtest.rig import Array
from studies.blindtest.sizing import OWN

NOT_EFFECTS = ("none", "parameters")
#: Simulated channels for a test's inputs.
Predict = Callable[[Mapping[str, Array]], Mapping[str, Array]]
Cause = tuple[str, str | None]
_SKIP = 50
#: Bins of the stated probability; draws and seed of the resampling.
_BINS, _DRAWS, _SEED = 10, 2000, 0


@dataclass(frozen=True)
class Row:
    """One case and its answer.

    before, after: gap of the nominal and of the corrected model on tests outside the case (NaN without a
    corrected model). probability: stated by the answer, NaN if none. also: effects that the rig has in any
    case, so that naming them is optional. base: `before` of the same rig without the cause. misfit: the same
    relative to the RMS over tests and channels. baseline: the case has records of the rig without the cause.
    """

    case: str
    rig: str
    label: str
    stages: tuple[str, ...]
    weak: bool
    verdict: str
    named: frozenset[Cause]
    tied: tuple[frozenset[str], ...]
    stage: str | None
    probability: float
    before: float
    after: float
    seconds: float
    error: str = ""
    also: frozenset[str] = frozenset()
    base: float = math.nan
    misfit: float = math.nan
    baseline: bool = False

    @property
    def want(self) -> str:
        """The right verdict."""
        if self.label in NOT_EFFECTS:
            return self.label
        if self.label == OWN:
            return "own"
        return "unknown" if self.label.startswith("~") else "effect"

    @property
    def causes(self) -> frozenset[Cause]:
        """The right effects with their places."""
        if self.want != "effect":
            return frozenset()
        parts = (part.partition("@") for part in self.label.split("+"))
        return frozenset((name, place or None) for name, _, place in parts)

    @property
    def right(self) -> bool:
        """True if verdict and effects with their places are right."""
        if self.want == "own":
            return self.verdict in ("none", "parameters", "unknown", "effect") and not self.invented
        return self.verdict == self.want and (
            self.want != "effect" or (self.causes <= self.named and not self.invented)
        )

    @property
    def invented(self) -> frozenset[Cause]:
        """Named effects that the rig does not have."""
        return frozenset(c for c in self.named - self.causes if c[0] not in self.also)

    @property
    def right_or_tied(self) -> bool:
        """True if right, or if the right effect is one of two or three declared as tied."""
        effects, named = {name for name, _ in self.causes}, {name for name, _ in self.named}
        declared = any(len(tie) <= 3 and effects <= tie and named <= tie for tie in self.tied)
        return self.right or (self.want == "effect" and len(self.causes) == 1 and declared)

    @property
    def stage_right(self) -> bool:
        """True if the stage with the largest share is that of a cause, or if no stage was given."""
        return self.want == "none" or self.stage is None or self.stage in self.stages

    @property
    def shrink(self) -> float:
        """Share of the gap that the correction removes on tests outside the case."""
        return 1 - self.after / self.before if self.before > 0 else math.nan


def _of_label(case: str, label: Mapping[str, Any]) -> tuple[str, str, str, tuple[str, ...], bool]:
    """The first fields of a row."""
    weak = bool(label.get("weak", False))
    return case, str(label.get("rig", "")), label["label"], tuple(label["stages"]), weak


def row(
    case: str, label: Mapping[str, Any], answer: Mapping[str, Any], gaps: tuple[float, float], seconds: float
) -> Row:
    """A row from a label and the content of `diagnosis.json`."""
    named = frozenset(
        (e["name"], None if e.get("place") is None else str(e["place"])) for e in answer["effects"]
    )
    stages = answer.get("where", {}).get("stages", {})
    return Row(
        *_of_label(case, label),
        answer["verdict"],
        named,
        tuple(frozenset(tie) for tie in answer.get("indistinguishable", [])),
        max(stages, key=stages.get) if stages else None,
        stated(answer),
        *gaps,
        seconds,
        **_misfit(label),
    )


def failed(case: str, label: Mapping[str, Any], verdict: str, seconds: float, error: str) -> Row:
    """A row of a case without an answer."""
    return Row(
        *_of_label(case, label),
        verdict,
        named=frozenset(),
        tied=(),
        stage="",
        probability=math.nan,
        before=math.nan,
        after=math.nan,
        seconds=seconds,
        error=error,
        **_misfit(label),
    )


def _misfit(label: Mapping[str, Any]) -> dict[str, Any]:
    """A label's entries on the law's own error."""
    return {
        "also": frozenset(label.get("also", ())),
        "base": float(label.get("base", math.nan)),
        "misfit": float(label.get("misfit", math.nan)),
        "baseline": bool(label.get("baseline", False)),
    }


def stated(answer: Mapping[str, Any]) -> float:
    """The stated probability of the verdict or of the set of effects; NaN if none."""
    if answer["verdict"] != "effect":
        return float(answer.get("probabilities", {}).get(answer["verdict"], math.nan))
    names = sorted(_written(e) for e in answer["effects"])
    for candidate in answer.get("candidates", []):
        if sorted(candidate["effects"]) == names:
            return float(candidate["probability"])
    return float(min((e["probability"] for e in answer["effects"]), default=math.nan))


def _written(effect: Mapping[str, Any]) -> str:
    return effect["name"] if effect.get("place") is None else f"{effect['name']}@{effect['place']}"


def gaps(tests: Path, predict: Predict) -> tuple[float, float]:
    """Gaps of the nominal and of a corrected model, over all tests and channels of a file (root of the sum of
    squared relative errors, as in the shared scorer)."""
    arrays = np.load(tests)
    before = after = 0.0
    for test in sorted({key.split("/")[0] for key in arrays.files}):
        own = {k.split("/")[1]: arrays[k].astype(float) for k in arrays.files if k.startswith(f"{test}/")}
        simulated = predict(own)
        if "ground_acceleration_m_s2" in own:
            names = [(f"floor{k}_acceleration_m_s2", f"nominal_floor{k}_acceleration") for k in (1, 2, 3)]
        else:
            names = [("force_N", "nominal_N")]
        for name, nominal in names:
            truth = own[name][_SKIP:]
            size = np.mean(truth**2)
            before += float(np.mean((own[nominal][_SKIP:] - truth) ** 2) / size)
            after += float(np.mean((simulated[name][_SKIP:] - truth) ** 2) / size)
    return math.sqrt(before), math.sqrt(after)


class Share(NamedTuple):
    """A proportion with its 95 % interval (Wilson 1927, doi:10.1080/01621459.1927.10502953)."""

    right: int
    of: int

    @property
    def value(self) -> float:
        return self.right / self.of if self.of else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        if not self.of:
            return math.nan, math.nan
        z, n, p = 1.96, self.of, self.value
        middle, half = p + z**2 / (2 * n), z * math.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
        return (middle - half) / (1 + z**2 / n), (middle + half) / (1 + z**2 / n)


def shares(rows: Sequence[Row]) -> dict[str, Share]:
    """The figures that are proportions."""

    def share(of: Callable[[Row], bool], right: Callable[[Row], bool] = lambda r: r.right) -> Share:
        chosen = [r for r in rows if of(r)]
        return Share(sum(map(right, chosen)), len(chosen))

    def single(r: Row) -> bool:
        return r.want == "effect" and len(r.causes) == 1

    return {
        "single effects named": share(single),
        "single effects named, or in a declared tie of 2 or 3": share(single, lambda r: r.right_or_tied),
        "weak single effects named": share(lambda r: single(r) and r.weak),
        "pairs named": share(lambda r: len(r.causes) == 2),
        "no false alarm (none, parameters)": share(lambda r: r.want in NOT_EFFECTS),
        "nothing invented (no effect where there is none)": share(
            lambda r: r.want in NOT_EFFECTS, lambda r: r.verdict in NOT_EFFECTS
        ),
        "unknown recognised": share(lambda r: r.want == "unknown"),
        "controls without an invented cause": share(lambda r: r.want == "own"),
        "stage": share(lambda r: r.want in ("effect", "unknown"), lambda r: r.stage_right),
        "all": share(lambda r: True),
    }


@dataclass(frozen=True)
class Numbers:
    """The figures that are not proportions: reduction of the gap on tests outside the case, expected calibration error,
    the same for exact probabilities (mean, .95 quantile), seconds per case."""

    shrink_median: float
    shrink_worst_tenth: float
    shrink_count: int
    calibration_error: float
    exact_calibration_error: tuple[float, float]
    seconds_median: float
    seconds_worst: float


def numbers(rows: Sequence[Row]) -> Numbers:
    """Reduction of the gap over the cases with an effect, calibration and time over all cases."""
    shrink = [r.shrink for r in rows if r.want == "effect" and math.isfinite(r.shrink)]
    seconds = [r.seconds for r in rows] or [math.nan]
    return Numbers(
        float(np.median(shrink)) if shrink else math.nan,
        float(np.quantile(shrink, 0.1)) if shrink else math.nan,
        len(shrink),
        calibration_error(rows),
        exact_calibration_error(rows),
        float(np.median(seconds)),
        float(np.max(seconds)),
    )


@dataclass(frozen=True)
class Bin:
    """Answers of similar probability: mean stated probability, number of right answers, number of answers."""

    stated: float
    share: Share


def reliability(rows: Sequence[Row]) -> list[Bin]:
    """Answers by stated probability in bins of equal width; empty bins are omitted."""
    said = [r for r in rows if math.isfinite(r.probability)]
    out = []
    for k in range(_BINS):
        inside = [r for r in said if k == min(int(r.probability * _BINS), _BINS - 1)]
        if inside:
            mean = float(np.mean([r.probability for r in inside]))
            out.append(Bin(mean, Share(sum(r.right for r in inside), len(inside))))
    return out


def calibration_error(rows: Sequence[Row]) -> float:
    """Expected calibration error: mean over answers of |stated - observed| of their bin (Naeini et al. 2015).
    """
    found = reliability(rows)
    total = sum(b.share.of for b in found)
    return sum(b.share.of * abs(b.stated - b.share.value) for b in found) / total if total else math.nan


def exact_calibration_error(rows: Sequence[Row]) -> tuple[float, float]:
    """Mean and .95 quantile of the calibration error if every stated probability were exact: the resolution of the
    figure with so many answers (consistency resampling, Bröcker & Smith 2007, doi:10.1175/WAF993.1)."""
    said = np.array([r.probability for r in rows if math.isfinite(r.probability)])
    if not len(said):
        return math.nan, math.nan
    rng = np.random.default_rng(_SEED)
    inside = np.minimum((said * _BINS).astype(int), _BINS - 1)[:, None] == np.arange(_BINS)
    excess = (rng.random((_DRAWS, len(said))) < said) - said
    errors = np.sum(np.abs(excess @ inside), axis=1) / len(said)
    return float(np.mean(errors)), float(np.quantile(errors, 0.95))


def read_answer(folder: Path) -> dict[str, Any]:
    """`diagnosis.json` of a folder."""
    answer: dict[str, Any] = json.loads((folder / "diagnosis.json").read_text())
    return answer
