"""Diagnosis from case to answer, for a damper and for a frame."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.damper_run import search_damper
from mrdamp.diagnosis.evidence.further import with_further
from mrdamp.diagnosis.evidence.judgement import never_worse, with_nearest
from mrdamp.diagnosis.evidence.verdict import Decision
from mrdamp.diagnosis.fits.final import FinalFit, final_fit
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.store import Store
from mrdamp.diagnosis.frame_run import search_frame
from mrdamp.diagnosis.problem.command_hold import with_hold
from mrdamp.diagnosis.report.assembly import assemble
from mrdamp.diagnosis.report.file_gaps import with_file_gaps, with_given
from mrdamp.diagnosis.report.other_law import with_other_law
from mrdamp.diagnosis.report.result import Diagnosis
from mrdamp.diagnosis.report.sentence import sentence
from mrdamp.diagnosis.searched import Searched

Progress = Callable[[str, float], None]


def diagnose(
    case: Case,
    *,
    jobs: int = 1,
    progress: Progress = lambda what, share: None,
    limits: Limits | None = None,
    store: Store | None = None,
) -> Diagnosis:
    """The answer for a case. It does not depend on the number of jobs or on whether the run was resumed from
    a store.

    Raises InputError.
    """
    # One thread for BLAS: sums have the same order on every machine. Parallel work runs in processes.
    with threadpool_limits(limits=1):
        begun = time.monotonic()
        found = answered(searched(case, jobs, progress, limits, store or Store()), begun, progress)
    return found.with_sentence(sentence(found))


def searched(case: Case, jobs: int, progress: Progress, limits: Limits | None, store: Store) -> Searched:
    """Completed search of a case's rig; again with a held command, if only what was found shows that it is held."""
    search = search_frame if case.model.rig == "frame" else search_damper
    progress("reading the command between samples", 0.0)
    read, notes = with_hold(case, jobs)
    found = search(read, jobs, progress, limits, store)
    if notes and not read.model.hold:
        best = min(found.search.fits.values(), key=lambda f: (f.cost, f.hypothesis.name))
        again, said = with_hold(case, jobs, best.hypothesis.settings(best.point))
        if again.model.hold:
            found, notes = search(again, jobs, progress, limits, Store()), said
    return replace(found, notes=[*notes, *found.notes])


def answered(found: Searched, begun: float, progress: Progress) -> Diagnosis:
    """Answer from a search, without its sentence."""
    search, rig = found.search, found.rig
    fits, decision, final = concluded(found, progress)
    progress("looking at what is tied and unseen", 0.85)
    answer = assemble(
        found.case,
        rig,
        search,
        fits,
        decision,
        final,
        found.noise,
        found.floor,
        list(found.notes),
        begun,
    )
    answer = found.complete(answer, fits[decision.chosen.index])
    base = found.base if found.case.baseline else None
    answer = with_file_gaps(answer, found.case, final.problem, final.fit.residual, base)
    answer = with_other_law(answer, next(iter(found.others), None), search, final)
    return answer if found.again is None else with_given(answer, found.again, final.problem)


def concluded(
    found: Searched, progress: Progress = lambda what, share: None
) -> tuple[list[Fit], Decision, FinalFit]:
    """All fits of a search, the decision after the checks that need the final fit, and this fit."""
    search, rig = found.search, found.rig
    fits, decision = found.judge()
    fits, decision = with_further(search, fits, with_nearest(search, fits, decision))
    progress("fitting the corrected simulator", 0.7)
    mend = decision.verdict != "none" and not decision.apart
    final = final_fit(search, fits[decision.chosen.index], mend=mend, rig=rig)
    final, decision = never_worse(search, fits, final, decision)
    return fits, decision, final
