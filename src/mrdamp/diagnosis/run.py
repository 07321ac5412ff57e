"""A diagnosis from case to answer."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp.diagnosis.case.audit import audit
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.channels.comparison import compared, sensor_agrees
from mrdamp.diagnosis.constants import UNSTEADY
from mrdamp.diagnosis.evidence.baseline import of_baseline
from mrdamp.diagnosis.evidence.penalties import of_damper, of_itself
from mrdamp.diagnosis.evidence.verdict import (
    Decision,
    Scored,
    beyond,
    decide,
)
from mrdamp.diagnosis.fits.final import FinalFit, final_fit, heldout
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.regimes import regime_cost
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.fits.store import Store
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.noise import Noise, channel_noise, floors, repeatable, trust
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.problem.rig import Rig
from mrdamp.diagnosis.report.assembly import assemble
from mrdamp.diagnosis.report.file_gaps import with_file_gaps
from mrdamp.diagnosis.report.result import Diagnosis
from mrdamp.diagnosis.report.sentence import sentence
from mrdamp.model.core import Array

Progress = Callable[[str, float], None]

#: Samples of residuals that a search keeps, a channel of a record counted each.
_SAMPLES = 20_000
#: Fits of an unknown cause that are tried on records left out.
_NEAREST = 6
#: Share of the excess that a cause may leave of records left out, where tests do not repeat.
_CARRIED = 0.5
#: Share of the excess that free numbers leave, below which those at an end of their range may be further off yet.
_FAR_OFF = 0.02


def make_rig(case: Case, threads: int = 1) -> Rig:
    """The rig of a case. threads: that run settings side by side."""
    if case.model.rig == "frame":
        from mrdamp.diagnosis.problem.frame import FrameRig

        return FrameRig(case.model, case.records, threads=threads)
    return DamperRig(case.model, case.records, threads=threads)


def diagnose(
    case: Case,
    *,
    jobs: int = 1,
    progress: Progress = lambda what, share: None,
    limits: Limits | None = None,
    store: Store | None = None,
) -> Diagnosis:
    """The answer for a case; the same for any number of jobs, and for a run that goes on from a store.

    Raises InputError.
    """
    store = store or Store()
    # The same sums in the same order on every machine; the work is done elsewhere.
    with threadpool_limits(limits=1):
        if case.model.rig == "frame":
            from mrdamp.diagnosis.frame_run import LIMITS, diagnose_frame

            found = diagnose_frame(case, jobs=jobs, progress=progress, limits=limits or LIMITS, store=store)
        else:
            found = _diagnose_damper(case, jobs, progress, limits or Limits(), store)
    return found.with_sentence(sentence(found))


def _diagnose_damper(case: Case, jobs: int, progress: Progress, limits: Limits, store: Store) -> Diagnosis:
    begun = time.monotonic()
    rig = make_rig(case, jobs)
    assert isinstance(rig, DamperRig)
    rig = rig.with_motion()
    notes = list(audit(case))
    progress("comparing channels that see the same thing", 0.01)
    channels = compared(rig.records, rig.terms, rig.nominal_model.attributes)
    rig = replace(
        rig,
        known={c.term.name: c.settings for c in channels if c.term is not None and c.settings is not None},
    )
    noise, unsteady = repeatable(channel_noise(case, rig), case, rig)
    notes += unsteady
    progress("recalibrating the nominal parameters", 0.02)
    untouched = _baseline(replace(rig, records=case.baseline)) if case.baseline else None
    base = baseline_gap(untouched, rig)
    search, floor = _searching(rig, noise, limits, jobs, store, base)
    ends = frozenset(search.base.at_bounds)
    if ends and search.unexplained(search.base) < _FAR_OFF:
        rig = replace(rig, wider=ends)
        search, floor = _searching(rig, noise, limits, jobs, store, base)
    search.steady = noise.steady
    search.direct = {c.cause: c.nats for c in channels if c.cause is not None}
    for term in (t for t in rig.terms if t.name in rig.known):
        search.begin_with(term)
    search.run(lambda what, share: progress(what, 0.05 + 0.6 * share))
    fits, decision = judge(search, agrees=sensor_agrees(channels), baseline=untouched)
    decision = with_nearest(search, fits, decision)
    chosen = fits[decision.chosen.index]
    progress("fitting the corrected simulator", 0.7)
    final = final_fit(search, chosen, mend=decision.verdict != "none", rig=rig)
    decision = carried_over(search, final, decision)
    final, decision = never_worse(search, fits, final, decision)
    progress("looking at what is tied and unseen", 0.85)
    answer = assemble(case, rig, search, fits, decision, final, noise, floor, notes, begun)
    answer = replace(answer, compared=tuple(c.to_dict() for c in channels))
    return with_file_gaps(answer, case, final.problem, final.fit.residual, base if case.baseline else None)


def _baseline(rig: DamperRig) -> Problem:
    """Residuals of the baseline's records. rig: with those."""
    short = rig.searched()
    stride = max(1, round(sum(r.n for r in short.records) * len(rig.channels) / _SAMPLES))
    return Problem(short, stride=stride, coarse=True)


def baseline_gap(problem: Problem | None, rig: Rig) -> Array:
    """(channels,) RMS gap that the nominal simulator leaves of the baseline's records, 0 without any."""
    if problem is None:
        return np.zeros(len(rig.channels))
    gaps = problem.gaps(problem.of_settings([{}])[0])
    channel = np.array([b.channel for b in problem.blocks])
    return np.array([np.sqrt(np.mean(gaps[channel == c] ** 2)) for c in range(len(rig.channels))])


def _searching(
    rig: DamperRig, noise: Noise, limits: Limits, jobs: int, store: Store, base: Array
) -> tuple[Search, Array]:
    """A search that has not begun, on excerpts of long records, and the gaps (blocks,) that noise alone leaves.

    base: (channels,) gap that the simulator leaves of the rig's baseline.
    """
    short = rig.searched()
    total = sum(r.n for r in short.records) * len(rig.channels)
    stride = max(1, round(total / _SAMPLES))
    plain = Problem(short, stride=stride, coarse=True)
    floor = floors(plain, noise, {})
    problem = Problem(short, stride=stride, coarse=True, trust=trust(plain, floor))
    search = Search(problem, problem.cost(floor), limits, jobs, store)
    search.own = own_cost(problem, base)
    return search, floor


def own_cost(problem: Problem, base: Array) -> float:
    """Cost that gaps (channels,) of the rig's baseline stand for."""
    return problem.cost(np.array([base[b.channel] for b in problem.blocks]))


def judge(
    search: Search, *, agrees: bool = False, baseline: Problem | None = None
) -> tuple[list[Fit], Decision]:
    """All fits of a search and the decision over them. agrees: the force sensor reads what the load cell does;
    baseline: records of the rig as it was."""
    fits = [*search.ranked(False), *search.ranked(True)]
    penalties = {
        id(f): of_damper(search.problem.rig, f, search.base, agrees=agrees, inexact=search.inexact)
        for f in fits
    }
    for one, nats in ({} if baseline is None else of_baseline(baseline, fits)).items():
        penalties[one] += nats
    decision = decide(
        scored(fits, penalties, search.direct),
        search.floor,
        scored(search.rivals),
        steady=search.steady,
        inexact=search.inexact,
        own=search.own,
    )
    if decision.outside is not None:
        search.looks_like = search.rivals[decision.outside]
    return fits, decision


def with_nearest(search: Search, fits: Sequence[Fit], decision: Decision) -> Decision:
    """The decision; where the cause is unknown, with the fit that leaves least on records left out as the chosen one.

    What has the most evidence of a cause may be nothing at all where no cause explains much; a simulator is still to be
    handed over that is as near as the catalogue allows.
    """
    if decision.verdict != "unknown":
        return decision
    near = sorted(range(len(fits)), key=lambda k: (fits[k].cost, fits[k].hypothesis.name))[:_NEAREST]
    if (
        search.inexact
    ):  # a law that is not the rig's is bent by anything: what holds in other regimes, or nothing
        near.append(next(k for k, f in enumerate(fits) if not f.hypothesis.coordinates))
        best = min(near, key=lambda k: regime_cost(search.problem, fits[k]))
    else:
        best = min(near, key=lambda k: search.problem.cost(heldout(search.problem, fits[k])))
    found = fits[best]
    left = max(found.cost - decision.floor, 0.0) / decision.excess
    return replace(decision, chosen=replace(scored([found])[0], index=best), unexplained=left)


def carried_over(search: Search, final: FinalFit, decision: Decision) -> Decision:
    """The decision; `unknown` where two runs of one test differ by more than their noise and the cause that fits the
    records says little of those left out: what changes from run to run is fitted by anything with numbers enough.
    `parameters` where free numbers alone came to their end after the search, and leave noise of records left out."""
    if search.inexact:
        return decision
    left = max(search.problem.cost(final.heldout) - decision.floor, 0.0) / decision.excess
    law = decision.chosen.free and not decision.chosen.causes
    if decision.verdict == "unknown" and law and search.steady and decision.outside is None:
        unknown = beyond(left, decision.excess, decision.floor, causes=False)
        if unknown < min(decision.unknown, 0.5):
            return replace(decision, verdict="parameters", unknown=unknown)
    if search.steady or decision.verdict != "effect" or left <= _CARRIED:
        return decision
    return replace(decision, verdict="unknown", unknown=max(decision.unknown, UNSTEADY))


def never_worse(
    search: Search, fits: Sequence[Fit], final: FinalFit, decision: Decision
) -> tuple[FinalFit, Decision]:
    """The final fit and the decision; the nominal simulator unchanged, and no cause, where the fit leaves more of whole
    records left out of it than the nominal simulator does."""
    problem = final.problem
    nominal = fit(problem, Hypothesis(()), np.zeros(0), most=0)
    gaps = problem.gaps(nominal.residual)
    if decision.verdict == "none" or problem.cost(final.heldout) <= problem.cost(gaps):
        return final, decision
    index = next(k for k, f in enumerate(fits) if not f.hypothesis.coordinates)
    unchanged = replace(
        decision,
        verdict="unknown",
        chosen=replace(scored([fits[index]])[0], index=index),
        unexplained=1.0,
        unknown=max(decision.unknown, UNSTEADY),
    )
    return FinalFit(nominal, (), gaps, problem), unchanged


def scored(
    fits: Sequence[Fit],
    penalties: Mapping[int, float] | None = None,
    direct: Mapping[str, float] | None = None,
) -> list[Scored]:
    """What the verdict goes by. penalties: by id of a fit, direct: by cause (see `Scored`)."""
    return [
        Scored(
            f.hypothesis.causes,
            bool(f.hypothesis.nominal),
            f.cost,
            len(f.point) - len(f.hypothesis.nominal),
            index,
            (penalties or {}).get(id(f), 0.0) + of_itself(f),
            f.move,
            sum((direct or {}).get(cause, 0.0) for cause in f.hypothesis.causes),
        )
        for index, f in enumerate(fits)
    ]
