"""What the gap of a measured frame costs a controller, by the diagnosis of its records.

The rig itself is not run: the corrected simulator stands for it, with simulators drawn from the diagnosis' intervals.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from mrdamp.control.base import Controller
from mrdamp.control.registry import Site
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.run import diagnose
from mrdamp.errors import InputError
from mrdamp.files import together, write_atomic
from mrdamp.gap.scenario import CRITERIA, Options, Progress, Scenario, relative_error, with_range
from mrdamp.model import Model
from mrdamp.simulation.criteria import Criteria

Interval = tuple[float, float]


@dataclass(frozen=True)
class CaseGap:
    """verdict, named: of the diagnosis; gap: of the corrected simulator. motions: unseen ones. error: of the nominal
    simulator in the controller's criteria, mean relative, against the corrected one. Scores (as in `Row`): promised, of
    the controller tuned on the nominal simulator, there; kept, of the same in the corrected one; retuned, of the one
    tuned on the corrected one, there; None if it is not tuned. Intervals: 2.5 and 97.5 % over the drawn simulators in
    place of the corrected one; None without any.
    """

    case: str
    controller: str
    verdict: str
    named: tuple[str, ...]
    gap: float
    motions: tuple[str, ...]
    error: float
    error_interval: Interval | None
    promised: float
    kept: float
    kept_interval: Interval | None
    retuned: float | None = None
    retuned_interval: Interval | None = None


def of_case(
    options: Options, case: Case, out: Path, *, jobs: int = 1, progress: Progress = lambda what, share: None
) -> CaseGap:
    """Diagnoses a frame's case, runs the controller in its simulators, and writes gap.json, diagnosis.txt and
    corrected.json. Raises InputError.
    """
    if case.model.rig != "frame":
        raise InputError(f"{case.name}: the case is of a damper; allowed: a case of rig 'frame'")
    nominal = case.model
    if "command_max" not in nominal.parameters:
        largest = max(float(np.max(np.abs(r.command))) for r in case.records)
        nominal = replace(nominal, parameters={**nominal.parameters, "command_max": largest})
    scenario = Scenario(nominal, options, jobs, trainings=out / "trainings")
    progress("tuning on the nominal simulator", 0.0)
    first = scenario.tune([nominal], Site.of(nominal))
    progress("diagnosis", 0.2)
    found = diagnose(case, jobs=jobs)
    corrected, drawn = with_range(found.corrected, nominal), [with_range(m, nominal) for m in found.drawn]
    progress("the controller in the corrected simulator", 0.6)

    def ran(model: Model, controller: Controller) -> list[Criteria]:
        return [scenario.criteria(model, controller, load) for load in scenario.loads]

    before, after = ran(nominal, first), ran(corrected, first)
    others = [ran(m, first) for m in drawn]
    answer = CaseGap(
        case.name,
        options.controller,
        found.verdict,
        tuple(e.effect if e.place is None else f"{e.effect}@{e.place}" for e in found.effects),
        found.gap.corrected,
        tuple(load.name for load in scenario.loads),
        _error(before, after),
        _interval([_error(before, other) for other in others]),
        scenario.score(before),
        scenario.score(after),
        _interval([scenario.score(other) for other in others]),
    )
    if options.tuned or scenario.learning:
        progress("tuning again", 0.75)
        again = scenario.tune([corrected], Site.of(corrected))
        answer = replace(
            answer,
            retuned=scenario.score(ran(corrected, again)),
            retuned_interval=_interval([scenario.score(ran(m, again)) for m in drawn]),
        )
    out.mkdir(parents=True, exist_ok=True)
    with together():
        write_atomic(out / "diagnosis.txt", f"{found.sentence}\n")
        corrected.write(out / "corrected.json")
        write_atomic(out / "gap.json", json.dumps(asdict(answer), indent=1) + "\n")
    return answer


def rows(found: CaseGap) -> list[tuple[str, str]]:
    """What is printed: name and value."""
    said = [
        ("diagnosis", " + ".join(found.named) or found.verdict),
        ("gap of the corrected simulator", f"{100 * found.gap:.1f} % of the records"),
        ("motions", f"{', '.join(found.motions)}, at five times their speed"),
        ("score", "mean of peak drift and peak acceleration over those without a damper; less is better"),
        ("error of the nominal simulator", _said(100 * found.error, found.error_interval, 100, " %")),
        ("score promised by the nominal simulator", f"{found.promised:.3f}"),
        ("score in the corrected one", _said(found.kept, found.kept_interval)),
    ]
    if found.verdict == "unknown":
        said.append(("check", "the cause is not known: the corrected simulator is not the rig, and no figure is its"))
    if found.retuned is not None:
        said.append(("tuned again on the corrected one", _said(found.retuned, found.retuned_interval)))
    return said


def _said(value: float, ends: Interval | None, scale: float = 1.0, unit: str = "") -> str:
    digits = 1 if unit else 3
    text = f"{value:.{digits}f}{unit}"
    return text if ends is None else f"{text} ({scale * ends[0]:.{digits}f} to {scale * ends[1]:.{digits}f})"


def _error(before: Sequence[Criteria], after: Sequence[Criteria]) -> float:
    return float(np.mean([relative_error(before, after, name) for name in CRITERIA]))


def _interval(values: Sequence[float]) -> Interval | None:
    if not values:
        return None
    low, high = np.percentile(values, [2.5, 97.5])
    return float(low), float(high)
