"""Search for the causes of a damper's gap: from the case to the fits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mrdamp.diagnosis.case.audit import audit
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.channels.comparison import Compared, compared, sensor_unexplained
from mrdamp.diagnosis.channels.motion import motion
from mrdamp.diagnosis.constants import CAUSE, INEXACT, STALL_GAIN, UNSTEADY
from mrdamp.diagnosis.evidence.judgement import decided, unexplained
from mrdamp.diagnosis.evidence.penalties import of_damper
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.fits.store import Store
from mrdamp.diagnosis.hypotheses.terms import Term
from mrdamp.diagnosis.problem.baseline_law import BaselineLaw, baseline_law
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.noise import (
    Noise,
    baseline_gap,
    channel_noise,
    floors,
    own_cost,
    repeatable,
    trust,
)
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.report.result import Diagnosis, Where
from mrdamp.diagnosis.searched import Judged, Searched
from mrdamp.model.core import Array
from mrdamp.records import Record

Progress = Callable[[str, float], None]

#: Number of residual samples in a search, over all channels and records.
_SAMPLES = 20_000
#: Share of the excess left by free parameters below which the range of a parameter at its limit is extended.
_FAR_OFF = 0.02


def search_damper(case: Case, jobs: int, progress: Progress, limits: Limits | None, store: Store) -> Searched:
    """Completed search of a damper's case. Raises InputError."""
    rig = DamperRig(case.model, case.records, threads=jobs).with_motion()
    notes = list(audit(case))
    noise, unsteady = repeatable(channel_noise(case, rig), case, rig)
    notes += unsteady
    again = _law_of_baseline(case, rig, noise, progress)
    if again is not None:
        case = replace(case, model=again.model)
        rig = DamperRig(again.model, case.records, threads=jobs).with_motion()
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
    search, floor = _searching(rig, noise, limits or Limits(), jobs, store, base)
    ends = frozenset(search.base.at_bounds)
    if ends and search.unexplained(search.base) < _FAR_OFF:
        rig = replace(rig, wider=ends)
        search, floor = _searching(rig, noise, limits or Limits(), jobs, store, base)
    search.steady = noise.steady
    # What channels of the baseline show as well is no change.
    own = {c.cause: c.nats for pair in _compared(rig, case.baseline) for c in pair} if case.baseline else {}
    search.direct = {c.cause: max(c.nats - own.get(c.cause, 0.0), 0.0) for c in channels if c.cause is not None}
    known = [t for t in rig.terms if t.name in rig.known]
    for term in (*known, *_clearance(search)):
        search.begin_with([term])
    if 1 < len(known) <= search.limits.depth:
        search.begin_with(known)
    search.run(lambda what, share: progress(what, 0.05 + 0.6 * share))

    apart = sensor_unexplained(channels)

    def complete(answer: Diagnosis, chosen: Fit) -> Diagnosis:
        where = in_sensor(answer.where) if apart else answer.where
        return replace(answer, where=where, compared=tuple(c.to_dict() for c in channels))

    def judged() -> Judged:
        fits, decision = judge(search, untouched)
        if not apart:
            return fits, decision
        like = search.looks_like
        if like is not None and all(t.stage != "sensor" for t in like.hypothesis.terms):
            search.looks_like, decision = None, replace(decision, outside=None)
        return fits, unexplained(decision, fits)

    return Searched(case, rig, search, noise, floor, base, notes, judged, complete, again)


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


def _law_of_baseline(case: Case, rig: DamperRig, noise: Noise, progress: Progress) -> BaselineLaw | None:
    """The law identified again on the baseline, if the given simulator does not reach the noise there."""
    if not case.baseline:
        return None
    untouched = _shortened(replace(rig, records=case.baseline))
    own = own_cost(untouched, baseline_gap(untouched, rig))
    if own <= INEXACT * untouched.cost(floors(untouched, noise, {})):
        return None
    progress("identifying the law on the baseline", 0.01)
    return baseline_law(rig, case.baseline)


def judge(search: Search, baseline: Problem | None = None) -> Judged:
    """All fits of a search and the decision. baseline: residuals of the rig's baseline records."""
    fits = [*search.ranked(False), *search.ranked(True)]
    rig = search.problem.rig
    unsure = search.inexact and not search.own
    penalties = {id(f): of_damper(rig, f, unsure=unsure) for f in fits}
    return fits, decided(search, fits, penalties, baseline)


def in_sensor(where: Where) -> Where:
    """Where the gap lies, for a force sensor that is at fault whatever the law; the other stages share the rest."""
    stages = {name: (1 - UNSTEADY) * share for name, share in where.stages.items()}
    stages["sensor"] = stages.get("sensor", 0.0) + 1 - sum(stages.values())
    return replace(where, stages=stages)


def _shortened(rig: DamperRig) -> Problem:
    """Residuals of a rig's records; of excerpts if the records are long."""
    short = rig.searched()
    stride = max(1, round(sum(r.n for r in short.records) * len(rig.channels) / _SAMPLES))
    return Problem(short, stride=stride, coarse=True)


def _searching(
    rig: DamperRig, noise: Noise, limits: Limits, jobs: int, store: Store, base: Array
) -> tuple[Search, Array]:
    """A new search on excerpts of long records, and the gaps (blocks,) due to noise alone.

    base: (channels,) gap of the nominal simulator on the rig's baseline.
    """
    plain = _shortened(rig)
    floor = floors(plain, noise, {})
    problem = Problem(plain.rig, stride=plain.stride, coarse=True, trust=trust(plain, floor))
    search = Search(problem, problem.cost(floor), limits, jobs, store, own=own_cost(problem, base))
    return search, floor
