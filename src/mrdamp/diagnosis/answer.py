"""The answer, made once from a search and what is concluded from it: figures on whole records, causes with
parameters, location of the gap."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from mrdamp.diagnosis.attribution.stages import LAW_STAGE, cause_shares, record_shares, regimes
from mrdamp.diagnosis.constants import MATERIAL, NONE_ABOVE, PREDICTABLE
from mrdamp.diagnosis.evidence.ceiling import of_fit
from mrdamp.diagnosis.evidence.consistency import RegimeEstimate, hull
from mrdamp.diagnosis.evidence.judgement import scored, stated
from mrdamp.diagnosis.evidence.resample import Interval, spread
from mrdamp.diagnosis.evidence.ties import tie_classes, unseen
from mrdamp.diagnosis.evidence.verdict import by_causes, of_cause
from mrdamp.diagnosis.fits.final import AGREEMENT, FinalFit, heldout, predicted_gap
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.outside import PREFIX, plain
from mrdamp.diagnosis.hypotheses.terms import KNOWN, Term
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.make import with_model
from mrdamp.diagnosis.problem.residuals import Problem, pooled
from mrdamp.diagnosis.problem.rig import models_of
from mrdamp.diagnosis.report.next_test import next_test
from mrdamp.diagnosis.report.result import LAW_AGAIN, Candidate, Diagnosis, Gap, Named, Remainder, Step, step
from mrdamp.diagnosis.searched import Concluded, Searched
from mrdamp.diagnosis.signatures.loops import Signature, compared
from mrdamp.model import Model
from mrdamp.model.attributes import attributes, defaults
from mrdamp.model.core import Array
from mrdamp.records.motion import share_of_stroke

Causes = tuple[str, ...]
#: Number of simulators with parameters drawn within their intervals.
_DRAWN = 20
#: A cause that is a change with a higher probability is so without a note.
_SURELY = 0.9


def answer(found: Searched, concluded: Concluded, begun: float) -> Diagnosis:
    """The answer, from a search and what is concluded from it. begun: s, start of the run (`time.monotonic`)."""
    search, case, fits, chosen = found.search, found.case, concluded.fits, concluded.chosen
    decision, verdict, final = concluded.decision, concluded.decision.verdict, concluded.final
    handed = concluded.handed
    named = verdict == "effect"
    whole, residual, floor = final.problem, handed.fit.residual, pooled(found.floor)
    nominal = whole.nominal()

    regimes_of = concluded.regimes if named else {}
    known = by_causes(scored(fits), decision.probabilities)
    sets = stated(search, decision, fits, concluded.regimes)
    least = min(sets.values()) + 1e-4
    weighed = [c for c, p in list(sets.items())[:6] if p > least or not c]
    causes = of_cause(sets)
    around = spread(handed.problem, handed.fit)
    intervals = around.intervals() if verdict != "none" else {}
    intervals = widened(search, chosen, final, intervals, regimes_of) if named else intervals
    ties = tie_classes(search, chosen, known) if named else ()
    hidden = unseen(search, chosen)
    test, signal = next_test(search, chosen, fits, decision, ties, hidden, found.noise.levels)
    conditions, halves = _conditions(whole)
    shares, nearby = record_shares(whole, nominal), regimes(conditions, nominal, halves)
    again = found.again
    given = whole if again is None else whole.like(with_model(whole.rig, again.given))
    first = given.nominal()
    model = handed.problem.rig.model(handed.fit.settings if verdict != "none" else {})
    fitted = nominal if verdict == "none" else residual
    gaps, off = _by_files({"nominal": (case.model, nominal), "corrected": (model, fitted)}, handed.problem)
    alone = gaps["nominal"]  # of the law without a cause
    # Of simulators that are not fitted there is one figure, that of the file.
    bars = [step("nominal", given.gaps(first)).at(alone if again is None else predicted_gap(again.given, whole))]
    if again is not None:
        bars.append(step(LAW_AGAIN, whole.gaps(nominal)).at(alone))
    recalibrated = heldout(whole, _on_whole(search, whole, search.base))
    waterfall = (*bars, *_further_bars(search, concluded, recalibrated, bars[-1]))
    gap = Gap(
        nominal=bars[0].gap,
        recalibrated=pooled(recalibrated),
        corrected=gaps["corrected"],
        noise_floor=floor,
        interval=waterfall[-1].interval,
        baseline=found.before,
        left_out=waterfall[-1].gap,
    )
    effects = named_effects(search, chosen, final, causes, intervals, regimes_of) if named else ()
    if again is not None:  # the fit's shares are of what the law of the baseline leaves
        effects = tuple(replace(e, share=e.share * gap.share(alone)) for e in effects)
    notes = [*_notes(found, concluded, regimes_of), *_may_be_none(effects), *off]
    law: dict[str, Any] | None = None
    if again is not None:
        law, left = {**again.to_dict(), "gap": alone}, gap.corrected
        model, gap = beside_given(again.given, model, gap, bars[0])
        if model is again.given:
            notes.append(f"what was found leaves {100 * left:.1f} %: the given simulator is handed over")
            law = None
    rest, ceiling = _remaining(search, handed, gap)
    own = {"effect": tuple(sorted(chosen.hypothesis.causes)), "none": (), "parameters": ("parameters",)}.get(verdict)
    # Errors (samples,) of the forces of the given simulator and of the one that is handed over.
    errors = {"nominal": first / given.weights}
    kept = again is not None and model is again.given
    errors["corrected"] = errors["nominal"] if kept else residual / whole.weights
    other = concluded.other
    return Diagnosis(
        case=case.name,
        rig=case.model.rig,
        question=case.question,
        verdict=verdict,
        effects=effects,
        candidates=tuple(
            Candidate(c, sets[c], waterfall[-1].gap if c == own else _candidate_gap(search, fits, c))
            for c in weighed
        ),
        indistinguishable=ties,
        where=replace(found.where(chosen, verdict, causes), records=shares, regimes=nearby),
        gap=replace(gap, ceiling=ceiling),
        waterfall=waterfall,
        next_experiment=test,
        next_signal=signal,
        corrected=model,
        unseen=hidden,
        notes=tuple(notes),
        intervals=intervals,
        drawn=models_of(handed.problem.rig, around.settings(), _DRAWN) if intervals else (),
        probabilities=causes,
        compared=tuple(c.to_dict() for c in found.compared),
        seconds=time.monotonic() - begun,
        outside=_outside(search, chosen),
        beyond_baseline=found.beyond or None,
        covered=found.covered,
        baseline_law=law,
        other_law=None if other is None else other.to_dict(handed_over=handed is not final),
        remainder=None if verdict == "none" else rest,
        standing=None if decision.standing is None else asdict(decision.standing),
        signatures=_signatures(whole, errors) if isinstance(found.rig, DamperRig) else (),
        pictures={
            **errors,
            "measured": whole.measured(),
            **{f"condition {k}": v for k, v in conditions.items()},
            "blocks": [[b.record, b.channel, b.span.start, b.span.stop] for b in whole.blocks],
            "records": [r.name for r in found.rig.records],
            "channels": list(found.rig.channels),
        },
    )


def beside_given(given: Model, model: Model, gap: Gap, bar: Step) -> tuple[Model, Gap]:
    """The simulator that is handed over and the gaps, where the law was identified again: the given simulator, of which
    `bar` is, where it predicts the records better than what was found (`model`)."""
    if bar.gap < gap.corrected:
        return given, replace(gap, corrected=bar.gap, left_out=bar.gap, interval=bar.interval)
    return model, gap


def _further_bars(search: Search, concluded: Concluded, recalibrated: Array, alone: Step) -> list[Step]:
    """Bars after those of the nominal simulator: free numbers, each cause, and the simulator that is handed over.
    recalibrated (blocks,): gaps of the free numbers alone on records left out. alone: bar of the simulator that is
    handed over unchanged."""
    chosen, handed, whole = concluded.chosen, concluded.handed, concluded.final.problem
    causes = chosen.hypothesis.causes
    if handed is not concluded.final:
        return [step(f"law {handed.problem.rig.model({}).law}", handed.heldout)]
    bars = [step("recalibrated", recalibrated)]
    if not causes:
        free = bool(handed.fit.hypothesis.nominal)
        return [step("recalibrated", handed.heldout)] if free else [*bars, replace(alone, name="unchanged")]
    for k in range(1, len(causes)):
        part = search.smallest(bool(chosen.hypothesis.nominal), causes[:k])
        if part is not None:
            name = "+ " + " + ".join(part.hypothesis.causes)
            bars.append(step(name, heldout(whole, _on_whole(search, whole, part))))
    return [*bars, step("+ " + " + ".join(handed.fit.hypothesis.causes or causes), handed.heldout)]


def _by_files(simulators: Mapping[str, tuple[Model, Array]], problem: Problem) -> tuple[dict[str, float], list[str]]:
    """Gaps of simulators as `mrdamp predict` gives them with their files, and notes where the gap of the fit, by its
    residual (samples,), is another one."""
    gaps, notes = {}, []
    for name, (model, residual) in simulators.items():
        file, own = predicted_gap(model, problem), pooled(problem.gaps(residual))
        gaps[name] = file
        if abs(file - own) > AGREEMENT:
            notes.append(
                f"the {name} simulator has a gap of {100 * file:.1f} % by its file and {100 * own:.1f} % in the fit:"
                " the displacement's noise acts on the law; figures are the file's"
            )
    return gaps, notes


def _notes(
    found: Searched, concluded: Concluded, regimes_of: Mapping[str, Sequence[RegimeEstimate]]
) -> list[str]:
    """Findings of the audit and of the search."""
    search, fitted, notes = found.search, concluded.handed.fit, list(found.notes)
    for cause, estimates in regimes_of.items():
        worse = [r.label() for r in estimates if r.worse]
        if worse:
            notes.append(f"{cause} makes the gap larger in {', '.join(worse)}: verify it before use")
    known = getattr(found.rig, "known", {})
    ends = {name for settings in known.values() for name in settings}
    notes += [f"{name} is at a limit of its range" for name in fitted.at_bounds if name not in ends]
    notes += [
        f"{t.name} is known from two channels of one quantity; its interval is the range about that, {100 * KNOWN:g} %"
        for t in fitted.hypothesis.terms
        if t.name in known
    ]
    if not fitted.converged:
        notes.append("the final fit had not converged at its largest number of iterations")
    notes += search.failed
    if found.noise.source != "repeat":
        notes.append("no repeat of a test among the records: the noise floor is the one of the high band")
    if search.curved < 1 - MATERIAL:
        notes.append(
            f"the law's dependence on the command is wrong: with curves of the command in place of its coefficients it"
            f" leaves {100 * search.curved:.0f} % of its squared error on left-out records"
        )
    if search.inexact and not found.case.baseline:
        notes.append(
            "no fit reaches the noise and there are no baseline records: records of the rig in the state in which the"
            " simulator was identified (mrdamp case --baseline) separate its own error from a change"
        )
    notes += [
        f"{cause}: probability {p:.2f} that it has changed; the simulator may miss it on the baseline's records too"
        for cause, p in concluded.decision.changed.items()
        if p < _SURELY
    ]
    return notes


def _may_be_none(effects: Sequence[Named]) -> list[str]:
    """Notes on named effects of a damper whose intervals all contain the value without the effect."""
    none = {row.name: value for row, value in zip(attributes(), defaults(), strict=True)}

    def within(e: Named) -> bool:
        ends = {f"{e.effect}_{short}": ends for short, ends in e.intervals.items()}
        return bool(ends) and all(low <= none.get(name, np.nan) <= high for name, (low, high) in ends.items())

    return [
        f"the intervals of {e.effect} contain the value without it: the records show that it acts, not how much"
        for e in effects
        if within(e)
    ]


def _signatures(whole: Problem, errors: Mapping[str, Array]) -> tuple[Signature, ...]:
    """Signatures of the loops of a damper's own force: measured, and of simulators by their errors (samples,)."""
    measured = whole.measured()
    series = {"measured": measured} | {name: measured + error for name, error in errors.items()}
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


def _remaining(search: Search, final: FinalFit, gap: Gap) -> tuple[Remainder | None, float]:
    """The remaining error beyond the noise, None if the corrected simulator reaches the noise, and the gap of a
    regression on the same inputs on left-out records."""
    residual, noise = final.fit.residual, gap.noise_floor
    predictable = max(of_fit(final.problem, residual, search.floor), search.by_curves(final.fit.hypothesis))
    left = gap.left_out
    ceiling = float(np.sqrt(max(left**2 - predictable * max(left**2 - noise**2, 0.0), 0.0)))
    if pooled(final.heldout) ** 2 <= NONE_ABOVE * noise**2:
        return None, ceiling
    if search.looks_like is not None:
        (term,) = search.looks_like.hypothesis.terms
        of, stage = "outside", term.stage
    elif predictable >= PREDICTABLE:
        of, stage = "law", LAW_STAGE
    else:
        of, stage = "unpredictable", None
    conditions, halves = _conditions(final.problem)
    return Remainder(left, gap.share(left), of, stage, regimes(conditions, residual, halves)[:3]), ceiling


def widened(
    search: Search,
    chosen: Fit,
    final: FinalFit,
    intervals: Mapping[str, Interval],
    regimes_of: Mapping[str, tuple[RegimeEstimate, ...]],
) -> dict[str, Interval]:
    """Intervals that contain those of all regimes for the causes' settings, if no fit reaches the noise."""
    out = dict(intervals)
    for term in _last_forms(chosen, final) if search.inexact else ():
        out |= hull(term.coordinates, out, regimes_of[term.cause])
    return out


def named_effects(
    search: Search,
    chosen: Fit,
    final: FinalFit,
    probabilities: dict[str, float],
    intervals: dict[str, Interval],
    regimes_of: Mapping[str, tuple[RegimeEstimate, ...]],
) -> tuple[Named, ...]:
    shares = cause_shares(search, chosen)
    settings, out = final.fit.settings, []
    for term in _last_forms(chosen, final):
        names = {c.name: c.name.removeprefix(f"{term.effect}_").partition("@")[0] for c in term.coordinates}
        own = {c.name: intervals[c.name] for c in term.coordinates if c.name in intervals}
        out.append(
            Named(
                term.effect,
                term.stage,
                term.place,
                min(probabilities.get(term.cause, 0.0), 1.0),
                _short(settings, names),
                shares[term.cause],
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


def _short(values: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """Values of an effect's settings under the names that the effect gives them."""
    return {short: values[name] for name, short in names.items() if name in values}


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
