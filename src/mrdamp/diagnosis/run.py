"""Diagnosis from case to answer, for a damper and for a frame."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp.diagnosis.answer import answer
from mrdamp.diagnosis.attribution.frame_laws import law_handed_over
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.damper_run import search_damper
from mrdamp.diagnosis.evidence.changed import since_baseline
from mrdamp.diagnosis.evidence.consistency import RegimeEstimate, by_regime
from mrdamp.diagnosis.evidence.further import with_further, with_unnamed
from mrdamp.diagnosis.evidence.judgement import likely, never_worse, with_nearest
from mrdamp.diagnosis.fits.final import FinalFit, final_fit, least_left_out
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.frame_run import search_frame
from mrdamp.diagnosis.problem.command_hold import with_hold
from mrdamp.diagnosis.report.result import Diagnosis
from mrdamp.diagnosis.searched import Concluded, Progress, Searched, silent


def diagnose(
    case: Case,
    *,
    jobs: int = 1,
    progress: Progress = silent,
    limits: Limits | None = None,
) -> Diagnosis:
    """The answer for a case. It does not depend on the number of jobs.

    Raises InputError.
    """
    # One thread for BLAS: sums have the same order on every machine. Parallel work runs in processes.
    with threadpool_limits(limits=1):
        begun = time.monotonic()
        found = searched(case, jobs, progress, limits)
        conclusion = concluded(found, progress)
        progress("looking at what is tied and unseen", 0.85)
        return answer(found, conclusion, begun)


def searched(case: Case, jobs: int, progress: Progress, limits: Limits | None) -> Searched:
    """Completed search of a case's rig; again where what was found shows another reading of the command."""
    search = search_frame if case.model.rig == "frame" else search_damper
    progress("reading the command between samples", 0.0)
    read, notes = with_hold(case, jobs)
    found = search(read, jobs, progress, limits)
    if notes:
        best = found.search.least
        again, said = with_hold(case, jobs, best.hypothesis.settings(best.point))
        if again.model.hold != read.model.hold:
            found, notes = search(again, jobs, progress, limits), said
    return replace(found, notes=[*notes, *found.notes])


def concluded(found: Searched, progress: Progress = silent) -> Concluded:
    """The decision over the fits of a search after the checks that need the final fit, and this fit."""
    search = found.search
    fits, decision, other = found.judged(progress)
    fits, decision = with_further(search, fits, with_nearest(search, fits, decision))
    decision = since_baseline(search, found.baseline, fits, decision)
    progress("fitting the corrected simulator", 0.7)

    def fitted(*, fixed: bool = False) -> tuple[Fit, FinalFit, dict[str, tuple[RegimeEstimate, ...]]]:
        chosen = least_left_out(search, fits[decision.chosen.index], fixed=fixed)
        final = final_fit(search, chosen, rig=found.rig)
        causes = decision.chosen.causes if decision.verdict == "effect" else ()
        return chosen, final, {cause: by_regime(final.problem, final.fit, cause) for cause in causes}

    chosen, final, regimes = fitted()
    before, decision = decision.chosen, likely(search, decision, fits, regimes)
    if decision.chosen is not before:
        chosen, final, regimes = fitted()
    others: dict[str, Any] = {"baseline": found.baseline, "uncovered": found.uncovered}
    checked = never_worse(search, fits, chosen, final, decision, **others)
    if decision.verdict == "effect" != checked[1].verdict and chosen.hypothesis.nominal and found.uncovered:
        # A law fitted to some regimes may fail in others, where the cause alone holds.
        chosen, final, regimes = fitted(fixed=True)
        checked = never_worse(search, fits, chosen, final, decision, **others)
    final, decision = checked
    if decision.verdict == "effect" and search.missed:
        parent = least_left_out(search, fits[decision.chosen.index])
        more = with_unnamed(search, parent)
        if more is not parent:
            tried = final_fit(search, more, rig=found.rig)
            final = min(final, tried, key=lambda one: one.problem.cost(one.heldout))
    by_law = law_handed_over(other, final) if other is not None and decision.verdict == "unknown" else None
    return Concluded(fits, decision, regimes, final, by_law or final, other)
