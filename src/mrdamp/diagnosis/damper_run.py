"""Search for the causes of a damper's gap: from the case to the fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mrdamp.diagnosis.attribution.baseline_law import BaselineLaw, baseline_law, gap_by_file
from mrdamp.diagnosis.attribution.interfaces import parts
from mrdamp.diagnosis.attribution.stage_evidence import StageEvidence
from mrdamp.diagnosis.attribution.stages import stage_shares
from mrdamp.diagnosis.case.audit import audit
from mrdamp.diagnosis.case.coverage import within
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.channels.comparison import Compared, compared, sensor_unexplained
from mrdamp.diagnosis.channels.motion import motion
from mrdamp.diagnosis.constants import CAUSE, INEXACT, STALL_GAIN, UNSTEADY
from mrdamp.diagnosis.evidence.judgement import decided, unexplained
from mrdamp.diagnosis.evidence.penalties import of_damper
from mrdamp.diagnosis.evidence.verdict import Decision
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Term
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.noise import (
    Noise,
    baseline_gap,
    channel_noise,
    floors,
    own_cost,
    trust,
)
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.report.result import Where
from mrdamp.diagnosis.searched import Progress, Searched
from mrdamp.model.core import Array
from mrdamp.records import Record

#: Share of the excess left by free parameters below which the range of a parameter at its limit is extended.
_FAR_OFF = 0.02


def search_damper(case: Case, jobs: int, progress: Progress, limits: Limits | None) -> Searched:
    """Completed search of a damper's case. Raises InputError."""
    asked, (case, left) = case.records, within(case)
    how: dict[str, Any] = {"threads": jobs, "settled": bool(case.baseline)}
    rig = DamperRig(case.model, case.records, **how).with_motion()
    notes = list(audit(case))
    notes += [f"{name}: {how}: the baseline says nothing of a change there" for name, how in left.items()]
    noise, unsteady = channel_noise(case, rig)
    notes += unsteady
    again = law_of_baseline(case, rig, noise, progress, asked)
    if again is not None:
        case = replace(case, model=again.model)
        rig = DamperRig(again.model, case.records, **how).with_motion()
        notes.append(again.note())
    progress("comparing channels that see the same thing", 0.01)
    shared, moved = _compared(rig, case.records)
    channels = (*shared, *moved)
    rig = replace(
        rig,
        known={c.term.name: c.settings for c in shared if c.term is not None and c.settings is not None},
    )
    progress("recalibrating the nominal parameters", 0.02)
    untouched = _shortened(replace(rig, records=case.baseline)) if case.baseline else None
    base = baseline_gap(untouched, rig)
    if again is not None:  # the gap on records that a law was fitted to is not its error elsewhere
        base = np.maximum(base, again.searched)
    # What channels of the baseline show as well is no change.
    own = {c.cause: c.nats for pair in _compared(rig, case.baseline) for c in pair} if case.baseline else {}
    direct = {c.cause: max(c.nats - own.get(c.cause, 0.0), 0.0) for c in channels if c.cause is not None}
    given: dict[str, Any] = {"direct": direct, "missed": case.question == "missed", "base": base, "limits": limits}
    search, floor = begun(rig, noise, **given)
    ends = frozenset(search.base.at_bounds)
    if ends and search.unexplained(search.base) < _FAR_OFF:
        rig = replace(rig, wider=ends)
        search, floor = begun(rig, noise, **given)
    known = [t for t in rig.terms if t.name in rig.known]
    late = [
        replace(c.term, starts=(tuple(c.settings[q.name] for q in c.term.coordinates),))
        for c in moved
        if c.term is not None and c.settings is not None
    ]
    clearances = _clearance(search)
    if clearances and not case.baseline:  # the loops show it: it needs no evidence to be one cause more
        search.direct = {**search.direct, clearances[0].cause: CAUSE}
    for term in (*known, *late, *clearances):
        search.begin_with([term])
    if 1 < len(known) <= search.limits.depth:
        search.begin_with(known)
    search.run(lambda what, share: progress(what, 0.05 + 0.6 * share))
    beyond = "; ".join(left.values()) if len(left) == len(case.records) else ""
    before = None
    if case.baseline:
        before = gap_by_file(rig, case.model, case.baseline) if again is None else again.before
    covered = len(case.records), len(asked)
    others = tuple(r for r in asked if r.name in left) if covered[0] < covered[1] else ()
    return DamperSearched(
        case, rig, search, noise, floor, untouched, channels, notes, again, beyond, covered, before,
        Problem(DamperRig(case.model, others, **how)) if others else None,
    )  # fmt: skip


def begun(
    rig: DamperRig, noise: Noise, *, base: Array | None = None, limits: Limits | None = None, **how: Any
) -> tuple[Search, Array]:
    """A new search on excerpts of long records, and the gaps (blocks,) due to noise alone. base (channels,): gaps of
    the baseline. how: of the `Search`."""
    plain = _shortened(rig)
    floor = floors(plain, noise, {})
    problem = plain.like(trust=trust(plain, floor))
    own = 0.0 if base is None else own_cost(problem, base)
    made = Search(problem, problem.cost(floor), limits or Limits(), own=own, steady=noise.steady, **how)
    return made, floor


@dataclass(frozen=True)
class DamperSearched(Searched):
    """A completed search of a damper's case."""

    rig: DamperRig

    def judged(self, progress: Progress) -> tuple[list[Fit], Decision, None]:
        """See `Searched`. A force sensor that is at fault whatever the law is no rival's doing."""
        fits, decision = judge(self.search)
        if self.beyond and decision.verdict != "none":
            return fits, unexplained(decision, fits), None
        if not sensor_unexplained(self.compared):
            return fits, decision, None
        like = self.search.looks_like
        if like is not None and all(t.stage != "sensor" for t in like.hypothesis.terms):
            self.search.looks_like, decision = None, replace(decision, outside=None)
        return fits, unexplained(decision, fits), None

    def where(self, chosen: Fit, verdict: str, causes: Mapping[str, float]) -> Where:
        """See `Searched`. A regression on the variables of each stage takes the law for the rig's: on records that the
        simulator was identified on it named the stage of the documented cause in 2 of 26 unknown answers, the
        candidates' probabilities in 11."""
        search, put_in = self.search, parts(self.rig, float(self.noise.levels[0]))
        evidence = None
        if verdict == "unknown" and self.case.question != "missed":
            exact = 0 < search.own <= INEXACT * search.floor
            evidence = StageEvidence.of(search.problem, float(self.noise.levels[-1]), exact=exact)
        drawn = put_in.drawn if put_in.found else None
        stages, intervals = stage_shares(search, chosen, verdict, put_in.found, drawn, evidence, causes)
        return Where(
            stages=in_sensor(stages) if sensor_unexplained(self.compared) else stages,
            intervals=intervals,
            measured=put_in.found,
        )


def _compared(rig: DamperRig, records: tuple[Record, ...]) -> tuple[tuple[Compared, ...], list[Compared]]:
    """Comparisons of channels of some records of a rig: those of one quantity, and the motion with its acceleration."""
    base = rig.nominal_model.attributes
    return compared(records, rig.terms, base), motion(records, rig.terms, base)


def _clearance(search: Search) -> list[Term]:
    """A clearance of the travel after a turn that the law alone lacks, if that travel is a cause by itself."""
    travel, left = search.stalls.missed(search.base.residual)
    if not (travel > 0 and -STALL_GAIN * np.log(left) > CAUSE):
        return []
    terms = [t for t in search.problem.rig.terms if t.effect == "backlash"]
    return [replace(t, starts=((travel, t.starts[0][1]),)) for t in terms]


def law_of_baseline(
    case: Case, rig: DamperRig, noise: Noise, progress: Progress, asked: Sequence[Record] = ()
) -> BaselineLaw | None:
    """The law identified again on the baseline, if the given simulator does not reach the noise there. asked: all
    records that the simulator is for."""
    if not case.baseline:
        return None
    untouched = _shortened(replace(rig, records=case.baseline))
    own = own_cost(untouched, baseline_gap(untouched, rig))
    if own <= INEXACT * untouched.cost(floors(untouched, noise, {})):
        return None
    progress("identifying the law on the baseline", 0.01)
    return baseline_law(rig, case.baseline, asked)


def judge(search: Search) -> tuple[list[Fit], Decision]:
    """All fits of a search and the decision."""
    fits = [*search.ranked(False), *search.ranked(True)]
    rig = search.problem.rig
    unsure = search.inexact and not search.own
    penalties = {id(f): of_damper(rig, f, unsure=unsure) for f in fits}
    return fits, decided(search, fits, penalties)


def in_sensor(stages: Mapping[str, float]) -> dict[str, float]:
    """Shares of the stages for a force sensor that is at fault whatever the law; the other stages share the rest."""
    out = {name: (1 - UNSTEADY) * share for name, share in stages.items()}
    return {**out, "sensor": out.get("sensor", 0.0) + 1 - sum(out.values())}


def _shortened(rig: DamperRig) -> Problem:
    """Residuals of a rig's records; of excerpts if the records are long."""
    return Problem.thinned(rig.searched(), coarse=True)
