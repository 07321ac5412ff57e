"""From a search and its final fit to the answer: figures on whole records, causes with parameters, location
of the gap."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

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
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.constants import MATERIAL, NONE_ABOVE, PREDICTABLE
from mrdamp.diagnosis.evidence.ceiling import of_fit
from mrdamp.diagnosis.evidence.consistency import RegimeEstimate, by_regime, hull
from mrdamp.diagnosis.evidence.resample import Interval, spread
from mrdamp.diagnosis.evidence.ties import tie_classes, unseen
from mrdamp.diagnosis.evidence.verdict import (
    Decision,
    Scored,
    by_causes,
    lapse_of,
    of_cause,
    with_lapse,
)
from mrdamp.diagnosis.fits.final import FinalFit, heldout
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.outside import PREFIX, plain
from mrdamp.diagnosis.hypotheses.terms import Term
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.noise import Noise
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.problem.rig import Rig, models_of
from mrdamp.diagnosis.report.next_test import next_test
from mrdamp.diagnosis.report.result import (
    Candidate,
    Diagnosis,
    Gap,
    Named,
    Remainder,
    Where,
    pooled,
    step,
)
from mrdamp.diagnosis.signatures.loops import Signature, compared
from mrdamp.model.core import Array
from mrdamp.records.motion import share_of_stroke

#: Number of simulators with parameters drawn within their intervals.
_DRAWN = 20


def assemble(
    case: Case,
    rig: Rig,
    search: Search,
    fits: list[Fit],
    decision: Decision,
    final: FinalFit,
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
    regimes_of = _by_regime(chosen, final) if decision.verdict == "effect" else {}
    worse = {cause: [r.label() for r in estimates if r.worse] for cause, estimates in regimes_of.items()}
    # Two channels that differ whatever the law do not depend on it.
    beside = search.inexact and not decision.apart
    sets = with_lapse(sets, lapse_of(decision.verdict, inexact=beside, worse=any(worse.values())))
    causes = of_cause(sets)
    rms = {name: pooled(gaps) for name, gaps in (("floor", floor), ("heldout", final.heldout))}
    whole = final.problem
    nominal = whole.of_settings([{}])[0]
    nominal_gaps = whole.gaps(nominal)
    recalibrated = heldout(whole, _on_whole(search, whole, search.base))
    waterfall = [step("nominal", nominal_gaps), step("recalibrated", recalibrated)]
    free = bool(chosen.hypothesis.nominal)
    for k in range(1, len(chosen.hypothesis.causes)):
        part = search.smallest(free, chosen.hypothesis.causes[:k])
        if part is not None:
            part = _on_whole(search, whole, part)
            waterfall.append(step("+ " + " + ".join(part.hypothesis.causes), heldout(whole, part)))
    label = " + ".join(chosen.hypothesis.causes) or "recalibrated"
    last = step(f"+ {label}" if chosen.hypothesis.causes else label, final.heldout)
    waterfall = [*waterfall, last] if chosen.hypothesis.causes else [waterfall[0], last]
    around = spread(final.problem, final.fit)
    intervals = around.intervals() if decision.verdict != "none" else {}
    named = _named(search, chosen, final, causes, intervals, regimes_of) if decision.verdict == "effect" else ()
    for cause, some in worse.items():
        if some:
            notes.append(f"{cause} makes the gap larger in {', '.join(some)}: verify it before use")
    for name in final.fit.at_bounds:
        notes.append(f"{name} is at a limit of its range")
    if not final.fit.converged:
        notes.append("the final fit had not converged at its largest number of iterations")
    notes += search.failed
    if noise.source != "repeat":
        notes.append("no repeat of a test among the records: the noise floor is the one of the high band")
    if search.curved < 1 - MATERIAL:
        notes.append(
            f"the law's dependence on the command is wrong: with curves of the command in place of its coefficients it"
            f" leaves {100 * search.curved:.0f} % of its squared error on left-out records"
        )
    if search.inexact and not case.baseline:
        notes.append(
            "no fit reaches the noise and there are no baseline records: records of the rig in the state in which the"
            " simulator was identified (mrdamp case --baseline) separate its own error from a change"
        )
    left, ceiling = remaining(search, final, pooled(nominal_gaps), rms["floor"])
    gap = Gap(
        nominal=pooled(nominal_gaps),
        recalibrated=pooled(recalibrated),
        corrected=rms["heldout"],
        noise_floor=rms["floor"],
        interval=last.interval,
        ceiling=ceiling,
    )
    residual = final.fit.residual
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
    model = rig.model(final.fit.settings if decision.verdict != "none" else {})
    ties = tie_classes(search, chosen, known) if decision.verdict == "effect" else ()
    hidden = unseen(search, chosen)
    test, signal = next_test(search, chosen, fits, decision, ties, hidden, noise.levels)
    loops = _signatures(whole, nominal, residual) if isinstance(rig, DamperRig) else ()
    found = Diagnosis(
        case=case.name,
        rig=case.model.rig,
        question=case.question,
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
        corrections=final.corrections,
        intervals=intervals,
        drawn=models_of(rig, around.settings(), _DRAWN) if intervals else (),
        probabilities=causes,
        seconds=time.monotonic() - begun,
        outside=_outside(search, chosen),
        remainder=None if decision.verdict == "none" else left,
        standing=None if decision.standing is None else asdict(decision.standing),
        pictures=pictures,
        signatures=loops,
    )
    return found


def _signatures(whole: Problem, nominal: Array, corrected: Array) -> tuple[Signature, ...]:
    """Signatures of the loops of a damper's own force: measured, and of both simulators by their residuals."""
    measured = whole.measured()
    series = {"measured": measured} | {
        name: measured + r / whole.weights for name, r in (("nominal", nominal), ("corrected", corrected))
    }
    own = [b for b in whole.blocks if whole.rig.channels[b.channel] == "force_N"]
    motions = [whole.rig.conditions(b.record)["displacement (m)"][whole.taken(b.record)] for b in own]
    return compared(motions, {name: [values[b.span] for b in own] for name, values in series.items()})


def _on_whole(search: Search, whole: Problem, found: Fit) -> Fit:
    """A fit of excerpts, unchanged, with the residuals of the whole records."""
    return found if whole.rig is search.problem.rig else fit(whole, found.hypothesis, found.point, most=0)


def _outside(search: Search, chosen: Fit) -> dict[str, Any] | None:
    """The cause outside the catalogue that explains the gap, if it decided the verdict; gaps on the records
    of the search for it and for the catalogue's best causes (`chosen`)."""
    found = search.looks_like
    if found is None:
        return None
    (term,) = found.hypothesis.terms
    return {
        "cause": term.cause,
        "form": term.form,
        "stage": term.stage,
        "what": plain(term),
        "parameters": {
            name.removeprefix(PREFIX): value
            for name, value in found.settings.items()
            if name.startswith(PREFIX) and name not in term.fixed
        },
        "gap": pooled(search.problem.gaps(found.residual)),
        "nearest_gap": pooled(search.problem.gaps(chosen.residual)),
    }


def remaining(search: Search, final: FinalFit, nominal: float, noise: float) -> tuple[Remainder | None, float]:
    """The remaining error beyond the noise, None if the corrected simulator reaches the noise, and the gap of a model
    of any form on left-out records.

    nominal: gap of the nominal simulator. noise: gap due to noise.
    """
    residual = final.fit.residual
    predictable = of_fit(final.problem, residual, search.floor).predictable
    left = pooled(final.heldout)
    ceiling = float(np.sqrt(max(left**2 - predictable * max(left**2 - noise**2, 0.0), 0.0)))
    if left**2 <= NONE_ABOVE * noise**2:
        return None, ceiling
    share = (left**2 - noise**2) / max(nominal**2 - noise**2, 1e-12)
    if search.looks_like is not None:
        (term,) = search.looks_like.hypothesis.terms
        of, stage = "outside", term.stage
    elif predictable >= PREDICTABLE:
        of, stage = "law", LAW_STAGE
    else:
        of, stage = "unpredictable", None
    conditions, halves = _conditions(final.problem)
    return Remainder(left, share, of, stage, regimes(conditions, residual, halves)[:3]), ceiling


def _named(
    search: Search,
    chosen: Fit,
    final: FinalFit,
    probabilities: dict[str, float],
    intervals: dict[str, Interval],
    regimes_of: Mapping[str, tuple[RegimeEstimate, ...]],
) -> tuple[Named, ...]:
    shares = cause_shares(search, chosen, lambda f: f.cost)
    settings, out = final.fit.settings, []
    for term in _last_forms(chosen, final):
        names = {c.name: c.name.removeprefix(f"{term.effect}_").partition("@")[0] for c in term.coordinates}
        own = {c.name: intervals[c.name] for c in term.coordinates if c.name in intervals}
        if search.inexact:
            own = hull(own, regimes_of[term.cause])
        out.append(
            Named(
                term.effect,
                term.stage,
                term.place,
                min(probabilities.get(term.cause, 0.0), 1.0),
                _short(settings, names),
                shares[term.cause] / search.excess,
                _short(own, names),
                tuple(
                    replace(r, parameters=_short(r.parameters, names), intervals=_short(r.intervals, names))
                    for r in regimes_of[term.cause]
                ),
            )
        )
    return tuple(out)


def _last_forms(chosen: Fit, final: FinalFit) -> list[Term]:
    """The named causes' terms, each in the form of the final fit, which may be another one."""
    last = {t.cause: t for t in reversed(final.fit.hypothesis.terms)}
    return [last.get(t.cause, t) for t in chosen.hypothesis.terms]


def _by_regime(chosen: Fit, final: FinalFit) -> dict[str, tuple[RegimeEstimate, ...]]:
    """Estimates of each named cause from the records of single regimes."""
    return {t.cause: by_regime(final.problem, final.fit, t.cause) for t in _last_forms(chosen, final)}


def _short(values: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """Values of an effect's settings under the names that the effect gives them."""
    return {short: values[name] for name, short in names.items() if name in values}


def _scored_of(f: Fit) -> Scored:
    return Scored(f.hypothesis.causes, bool(f.hypothesis.nominal), f.cost, 0)


def _candidate_gap(search: Search, fits: list[Fit], causes: tuple[str, ...]) -> float:
    if causes == ("unknown",):
        return pooled(search.problem.gaps(search.residual))
    wanted = set() if causes == ("parameters",) else set(causes)
    alike = [f for f in fits if set(f.hypothesis.causes) == wanted]
    if not wanted:  # the nominal simulator, unchanged or recalibrated
        alike = [f for f in alike if bool(f.hypothesis.nominal) == bool(causes)]
    found = min(alike, key=lambda f: f.cost)
    return pooled(heldout(search.problem, found))


def _conditions(problem: Problem) -> tuple[dict[str, Array], Array]:
    """Variables of the regimes in the order of the residuals (samples,), and one half of the samples: every
    other second."""
    parts: dict[str, list[Array]] = {}
    halves = []
    for b in problem.blocks:
        record = problem.rig.records[b.record]
        take = problem.taken(b.record)
        conditions = problem.rig.conditions(b.record)
        conditions["share of the stroke since its turn"] = share_of_stroke(conditions["displacement (m)"])
        if all("temperature_C" in r.channels for r in problem.rig.records):
            conditions["temperature (C)"] = np.asarray(record.channel("temperature_C"))
        for name, values in conditions.items():
            parts.setdefault(name, []).append(values[take])
        halves.append(np.floor(record.time[take]) % 2 == 0)
    return {name: np.concatenate(v) for name, v in parts.items()}, np.concatenate(halves)
