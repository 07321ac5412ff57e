"""A diagnosis from case to answer."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp.core import Array
from mrdamp.diagnosis.attribution.interfaces import Parts, parts
from mrdamp.diagnosis.attribution.stage_evidence import StageEvidence, of_one_stage
from mrdamp.diagnosis.attribution.stages import (
    LAW_STAGE,
    cause_shares,
    record_shares,
    regimes,
    stage_intervals,
    stage_shares,
)
from mrdamp.diagnosis.case.audit import audit
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.channels.comparison import compared, sensor_agrees
from mrdamp.diagnosis.constants import NONE_ABOVE, PREDICTABLE, UNSTEADY
from mrdamp.diagnosis.evidence.baseline import of_baseline
from mrdamp.diagnosis.evidence.ceiling import of_fit
from mrdamp.diagnosis.evidence.penalties import of_damper, of_itself
from mrdamp.diagnosis.evidence.resample import Interval, spread
from mrdamp.diagnosis.evidence.ties import tie_classes, unseen
from mrdamp.diagnosis.evidence.verdict import (
    Decision,
    Scored,
    beyond,
    by_causes,
    decide,
    of_cause,
    with_lapse,
)
from mrdamp.diagnosis.fits.final import Settled, heldout, settle
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.regimes import regime_cost
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.fits.store import Store
from mrdamp.diagnosis.hypotheses.outside import plain
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.noise import Noise, channel_noise, floors, repeatable, trust
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.problem.rig import Rig, models_of
from mrdamp.diagnosis.report.file_gaps import with_file_gaps
from mrdamp.diagnosis.report.next_test import next_test
from mrdamp.diagnosis.report.result import Candidate, Diagnosis, Gap, Named, Remainder, Step, Where
from mrdamp.diagnosis.report.sentence import sentence

Progress = Callable[[str, float], None]

#: Samples of residuals that a search keeps, a channel of a record counted each.
_SAMPLES = 20_000
_RESAMPLES, _SEED = 2000, 3
#: Fits of an unknown cause that are tried on records left out.
_NEAREST = 6
#: Share of the excess that a cause may leave of records left out, where tests do not repeat.
_CARRIED = 0.5
#: Share of the excess that free numbers leave, below which those at an end of their range may be further off yet.
_FAR_OFF = 0.02
#: Simulators with parameters drawn within their intervals.
_DRAWN = 20


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
    settled = settle(search, chosen, mend=decision.verdict != "none", rig=rig)
    decision = carried_over(search, settled, decision)
    progress("looking at what is tied and unseen", 0.85)
    answer = assemble(case, rig, search, fits, decision, settled, noise, floor, notes, begun)
    answer = replace(answer, compared=tuple(c.to_dict() for c in channels))
    return with_file_gaps(
        answer, case, settled.problem, settled.fit.residual, base if case.baseline else None
    )


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
    doubts = {
        id(f): of_damper(search.problem.rig, f, search.base, agrees=agrees, inexact=search.inexact)
        for f in fits
    }
    for one, nats in ({} if baseline is None else of_baseline(baseline, fits)).items():
        doubts[one] += nats
    decision = decide(
        scored(fits, doubts, search.direct),
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


def carried_over(search: Search, settled: Settled, decision: Decision) -> Decision:
    """The decision; `unknown` where two runs of one test differ by more than their noise and the cause that fits the
    records says little of those left out: what changes from run to run is fitted by anything with numbers enough.
    `parameters` where free numbers alone came to their end after the search, and leave noise of records left out."""
    if search.inexact:
        return decision
    left = max(search.problem.cost(settled.heldout) - decision.floor, 0.0) / decision.excess
    law = decision.chosen.free and not decision.chosen.causes
    if decision.verdict == "unknown" and law and search.steady and decision.outside is None:
        unknown = beyond(left, decision.excess, decision.floor, causes=False)
        if unknown < min(decision.unknown, 0.5):
            return replace(decision, verdict="parameters", unknown=unknown)
    if search.steady or decision.verdict != "effect" or left <= _CARRIED:
        return decision
    return replace(decision, verdict="unknown", unknown=max(decision.unknown, UNSTEADY))


def scored(
    fits: Sequence[Fit],
    doubts: Mapping[int, float] | None = None,
    direct: Mapping[str, float] | None = None,
) -> list[Scored]:
    """What the verdict goes by. doubts: by id of a fit, direct: by cause (see `Scored`)."""
    return [
        Scored(
            f.hypothesis.causes,
            bool(f.hypothesis.nominal),
            f.cost,
            len(f.point) - len(f.hypothesis.nominal),
            index,
            (doubts or {}).get(id(f), 0.0) + of_itself(f),
            f.move,
            sum((direct or {}).get(cause, 0.0) for cause in f.hypothesis.causes),
        )
        for index, f in enumerate(fits)
    ]


def assemble(
    case: Case,
    rig: Rig,
    search: Search,
    fits: list[Fit],
    decision: Decision,
    settled: Settled,
    noise: Noise,
    floor: Array,
    notes: list[str],
    begun: float,
) -> Diagnosis:
    chosen = fits[decision.chosen.index]
    known = by_causes([_scored_of(f) for f in fits], decision.probabilities)
    if decision.verdict == "none":
        known = {(): 1.0}
    sets = {causes: p * (1 - decision.unknown) for causes, p in known.items()} | {
        ("unknown",): decision.unknown
    }
    sets = dict(sorted(sets.items(), key=lambda item: (-item[1], item[0])))
    weighed = [c for c, p in list(sets.items())[:6] if p > 1e-4 or not c]
    sets = with_lapse(sets)
    causes = of_cause(sets)
    rms = {name: pooled(gaps) for name, gaps in (("floor", floor), ("heldout", settled.heldout))}
    whole = settled.problem
    nominal = whole.of_settings([{}])[0]
    nominal_gaps = whole.gaps(nominal)
    recalibrated = heldout(whole, _on_whole(search, whole, search.base))
    waterfall = [_step("nominal", nominal_gaps), _step("recalibrated", recalibrated)]
    free = bool(chosen.hypothesis.nominal)
    for k in range(1, len(chosen.hypothesis.causes)):
        part = search.smallest(free, chosen.hypothesis.causes[:k])
        if part is not None:
            part = _on_whole(search, whole, part)
            waterfall.append(_step("+ " + " + ".join(part.hypothesis.causes), heldout(whole, part)))
    label = " + ".join(chosen.hypothesis.causes) or "recalibrated"
    last = _step(f"+ {label}" if chosen.hypothesis.causes else label, settled.heldout)
    waterfall = [*waterfall, last] if chosen.hypothesis.causes else [waterfall[0], last]
    around = spread(settled.problem, settled.fit)
    intervals = around.intervals() if decision.verdict != "none" else {}
    named = _named(search, chosen, settled.fit, causes, intervals) if decision.verdict == "effect" else ()
    for name in settled.fit.at_bounds:
        notes.append(f"{name} stands at an end of its range")
    if not settled.fit.converged:
        notes.append("the final fit was still moving when its iterations were used up")
    notes += search.failed
    if noise.source != "repeat":
        notes.append("no repeat of a test among the records: the noise floor is the one of the high band")
    predictable = _predictable(settled, search.floor)
    gap = Gap(
        nominal=pooled(nominal_gaps),
        recalibrated=pooled(recalibrated),
        corrected=rms["heldout"],
        noise_floor=rms["floor"],
        interval=last.interval,
        ceiling=_ceiling(settled, predictable, rms["floor"]),
    )
    residual = settled.fit.residual
    conditions, halves = _conditions(whole)
    put_in = parts(rig, float(noise.levels[0])) if isinstance(rig, DamperRig) else Parts.none()
    unknown = decision.verdict == "unknown"
    level, near = float(noise.levels[-1]), of_one_stage(search)
    evidence = StageEvidence.of(search.problem, level, near, search.base) if unknown else None
    where = Where(
        stages=stage_shares(search, chosen, decision.verdict, put_in.found, evidence),
        intervals=stage_intervals(search, chosen, decision.verdict, put_in.found, put_in.drawn, evidence),
        measured=put_in.found,
        records=record_shares(whole, nominal),
        regimes=regimes(conditions, nominal, halves),
    )
    candidates = tuple(Candidate(c, sets[c], _candidate_gap(search, fits, c)) for c in weighed)
    pictures: dict[str, Any] = {
        "nominal": nominal / whole.weights,
        "corrected": residual / whole.weights,
        "measured": whole.measured(),
        **{f"condition {k}": v for k, v in conditions.items()},
        "blocks": [[b.record, b.channel, b.span.start, b.span.stop] for b in whole.blocks],
        "records": [r.name for r in rig.records],
        "channels": list(rig.channels),
    }
    model = rig.model(settled.fit.settings if decision.verdict != "none" else {})
    ties = tie_classes(search, chosen, known) if decision.verdict == "effect" else ()
    hidden = unseen(search, chosen)
    test, signal = next_test(search, chosen, fits, decision, ties, hidden, noise.levels)
    found = Diagnosis(
        case=case.name,
        rig=case.model.rig,
        verdict=decision.verdict,
        sentence="",
        effects=named,
        candidates=candidates,
        indistinguishable=ties,
        where=where,
        gap=gap,
        waterfall=tuple(waterfall),
        next_experiment=test,
        next_signal=signal,
        corrected=model,
        unseen=hidden,
        notes=tuple(notes),
        corrections=settled.corrections,
        intervals=intervals,
        drawn=models_of(rig, around.settings(), _DRAWN) if intervals else (),
        probabilities=causes,
        seconds=time.monotonic() - begun,
        outside=_outside(search, chosen),
        remainder=_remainder(search, settled, conditions, halves, rms, predictable),
        standing=None if decision.standing is None else asdict(decision.standing),
        pictures=pictures,
    )
    return found


def _on_whole(search: Search, whole: Problem, found: Fit) -> Fit:
    """A fit of a search's excerpts, as it stands, with the residuals of the whole records."""
    return found if whole.rig is search.problem.rig else fit(whole, found.hypothesis, found.point, most=0)


def _outside(search: Search, chosen: Fit) -> dict[str, Any] | None:
    """The cause outside the catalogue that the gap looks like, where the verdict went by one; gaps on the records that
    it and the catalogue's nearest causes (`chosen`) were fitted to."""
    found = search.looks_like
    if found is None:
        return None
    (term,) = found.hypothesis.terms
    return {
        "cause": term.cause,
        "form": term.form,
        "stage": term.stage,
        "what": plain(term),
        "gap": pooled(search.problem.gaps(found.residual)),
        "nearest_gap": pooled(search.problem.gaps(chosen.residual)),
    }


def _predictable(settled: Settled, floor: float) -> float:
    """Share of what the corrected simulator leaves beyond the noise that a model of any form would predict."""
    return of_fit(settled.problem, settled.fit.residual, floor).predictable


def _ceiling(settled: Settled, predictable: float, noise: float) -> float:
    """Gap that a model of any form would leave on records left out. noise: gap of it."""
    left = pooled(settled.heldout)
    return float(np.sqrt(max(left**2 - predictable * max(left**2 - noise**2, 0.0), 0.0)))


def _remainder(
    search: Search,
    settled: Settled,
    conditions: Mapping[str, Array],
    halves: Array,
    rms: Mapping[str, float],
    predictable: float,
) -> Remainder | None:
    """What is left beyond the noise; None where that is no gap."""
    left, noise = rms["heldout"], rms["floor"]
    if left**2 <= NONE_ABOVE * noise**2:
        return None
    whole = settled.problem
    nominal = pooled(whole.gaps(whole.of_settings([{}])[0]))
    share = (left**2 - noise**2) / max(nominal**2 - noise**2, 1e-12)
    if search.looks_like is not None:
        (term,) = search.looks_like.hypothesis.terms
        of, stage = "outside", term.stage
    elif predictable >= PREDICTABLE:
        of, stage = "law", LAW_STAGE
    else:
        of, stage = "unpredictable", None
    return Remainder(left, share, of, stage, regimes(conditions, settled.fit.residual, halves)[:3])


def _named(
    search: Search,
    chosen: Fit,
    final: Fit,
    probabilities: dict[str, float],
    intervals: dict[str, Interval],
) -> tuple[Named, ...]:
    shares = cause_shares(search, chosen, lambda f: f.cost)
    settings, out = final.settings, []
    for term in chosen.hypothesis.terms:
        names = {c.name: c.name.removeprefix(f"{term.effect}_").partition("@")[0] for c in term.coordinates}
        short = {names[n]: settings[n] for n in names if n in settings}
        out.append(
            Named(
                term.effect,
                term.stage,
                term.place,
                min(probabilities.get(term.cause, 0.0), 1.0),
                short,
                shares[term.cause] / search.excess,
                {names[n]: intervals[n] for n in names if n in intervals},
            )
        )
    return tuple(out)


def _scored_of(f: Fit) -> Scored:
    return Scored(f.hypothesis.causes, bool(f.hypothesis.nominal), f.cost, 0)


def _candidate_gap(search: Search, fits: list[Fit], causes: tuple[str, ...]) -> float:
    if causes == ("unknown",):
        return pooled(search.problem.gaps(search.residual))
    wanted = set() if causes == ("parameters",) else set(causes)
    alike = [f for f in fits if set(f.hypothesis.causes) == wanted]
    if not wanted:  # the nominal simulator as it is, or recalibrated
        alike = [f for f in alike if bool(f.hypothesis.nominal) == bool(causes)]
    found = min(alike, key=lambda f: f.cost)
    return pooled(heldout(search.problem, found))


def pooled(gaps: Array) -> float:
    """Gap of all blocks together: records and channels count the same."""
    return float(np.sqrt(np.mean(gaps**2)))


def _step(name: str, gaps: Array) -> Step:
    """A bar with its interval by resampling blocks of records."""
    rng = np.random.default_rng(_SEED)
    picks = rng.integers(0, len(gaps), (_RESAMPLES, len(gaps)))
    low, high = np.percentile(np.sqrt(np.mean(gaps[picks] ** 2, axis=1)), [2.5, 97.5])
    return Step(name, pooled(gaps), (float(low), float(high)))


def _conditions(problem: Problem) -> tuple[dict[str, Array], Array]:
    """Conditions in the order of the residuals (samples,), and one half of the samples: every other second."""
    parts: dict[str, list[Array]] = {}
    halves = []
    for b in problem.blocks:
        record = problem.rig.records[b.record]
        take = problem.taken(b.record)
        for name, values in problem.rig.conditions(b.record).items():
            parts.setdefault(name, []).append(values[take])
        halves.append(np.floor(record.time[take]) % 2 == 0)
    return {name: np.concatenate(v) for name, v in parts.items()}, np.concatenate(halves)
