"""Search for the causes of a frame's gap: from the case to the fits.

The first step locates the fault: every block between measured channels is tested separately
(`attribution.frame_blocks`). The second step is the search and verdict of a damper's diagnosis, over the
catalogue without the causes that clean blocks rule out.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrdamp.diagnosis.attribution.frame_blocks import (
    Block,
    blocks,
    place_shares,
    shares_by_stage,
)
from mrdamp.diagnosis.attribution.frame_damper import damper_evidence, frame_baseline_law
from mrdamp.diagnosis.attribution.frame_laws import OtherLaw, other_law
from mrdamp.diagnosis.case.audit import audit
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.channels.comparison import Compared
from mrdamp.diagnosis.channels.frame_comparison import Part, compared_parts
from mrdamp.diagnosis.constants import CAUSE, LAW_FORMS, NUMBER
from mrdamp.diagnosis.evidence.judgement import decided, not_established, scored, unexplained
from mrdamp.diagnosis.evidence.structure_numbers import deviations, promoted
from mrdamp.diagnosis.evidence.verdict import Decision
from mrdamp.diagnosis.fits.final import predicted_gap
from mrdamp.diagnosis.fits.frame_search import FrameSearch
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.problem.frame import COARSE, FINE, FrameRig, averaged
from mrdamp.diagnosis.problem.noise import Noise, baseline_gap, channel_noise, floors, own_cost
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.report.result import Where
from mrdamp.diagnosis.searched import Progress, Searched
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.sampling import derivative

#: s, window over which samples are averaged; Hz, the remaining band (half of its inverse).
_AVERAGE = 0.008
LIMITS = Limits(singles=5, beam=2, additions=3, depth=2, polished=2, base=4)
#: Number of fits with free parameters (the best for each number of causes) whose structural parameters are
#: checked for outliers.
_LOOKED_AT = 3
#: Share of the excess that may remain before the structural parameters are freed, if several storeys are
#: faulty.
_LEFT = 0.02
#: Share of the noise's cost above which the integration error requires a smaller step.
_STEP_ERROR = 0.03
#: Share of the noise's cost by which a cause in a faulty block has to reduce the cost.
_SEEN = 0.003
#: Noise of a storey's balance, over its output, up to which it rules the force sensor out: a gain of .9 is a tenth of
#: the force, and hid in 10 % of noise.
_SHARP = 0.05
#: Largest number of records in a search.
_RECORDS = 4


def reduced(case: Case, found: Sequence[Block] = (), threads: int = 1) -> tuple[Case, FrameRig]:
    """The case averaged over _AVERAGE, from which its noise is known, and its rig. threads: number of
    parameter sets that are simulated in parallel."""
    block = max(1, round(_AVERAGE / case.records[0].sample_time))
    clean = frozenset(b.name for b in found if b.clean)
    quiet = len(clean) == len(found)
    sharp = frozenset(b.name for b in found if b.clean and b.noise < _SHARP)
    settled = bool(case.baseline)
    rig = FrameRig(case.model, case.records, block, clean, sharp, quiet=quiet, threads=threads, settled=settled)
    repeats = tuple((averaged(r, block), k) for r, k in case.repeats)
    return replace(case, records=tuple(averaged(r, block) for r in case.records), repeats=repeats), rig


def search_frame(case: Case, jobs: int, progress: Progress, limits: Limits | None) -> Searched:
    """Completed search of a frame's case. Raises InputError."""
    limits, given = limits or LIMITS, case.model
    notes = list(audit(case))
    progress("trying each storey, accelerometer and the damper alone", 0.01)
    found = blocks(case)
    if case.baseline:
        progress("identifying the law on the baseline", 0.02)
    again = frame_baseline_law(case, found, jobs)
    if again is not None:
        case = replace(case, model=again.model)
        found = blocks(case)
        notes.append(again.note())
    small, rig = reduced(case, found, jobs)
    noise, note = channel_noise(case, rig, rig.block, small)
    notes += note
    rig = stepped(rig, noise)
    untouched = Problem(replace(rig, raw=case.baseline), coarse=True) if case.baseline else None
    base = baseline_gap(untouched, rig)

    def part(begin: float, end: float) -> Progress:
        return lambda what, share: progress(what, begin + (end - begin) * share)

    channels = compared_without_law(case, rig, found)
    search = _search(rig, noise, base, limits, part(0.05, 0.45))
    _, decision = judge(search, rig, channels)
    storeys = [b for b in found if b.kind == "storey" and not b.clean]
    unexplained = any(c.unexplained for c in channels)
    outside = any(search.solved(f) for f in search.rivals) or (search.inexact and unexplained)
    if len(storeys) > 1 and decision.verdict != "none" and decision.unexplained > _LEFT and not outside:
        rig = replace(rig, free_structure=True)
        search = _search(rig, noise, base, limits, part(0.45, 0.7), search)
    # The search takes few records, averaged; what is told is of all of them as they were logged.
    whole = replace(rig, as_logged=True)
    floor, covered, before = floors(Problem(whole, coarse=True), noise, {}), (len(small.records),) * 2, None
    if case.baseline:
        before = predicted_gap(given, Problem(replace(whole, raw=case.baseline)))
    return FrameSearched(
        small, whole, search, noise, floor, untouched, channels, notes, again, "", covered, before, None, case, found
    )


@dataclass(frozen=True)
class FrameSearched(Searched):
    """A completed search of a frame's case. measured: the case as measured. blocks: parts between measured channels."""

    rig: FrameRig
    measured: Case
    blocks: tuple[Block, ...]

    def judged(self, progress: Progress) -> tuple[list[Fit], Decision, OtherLaw | None]:
        """See `Searched`."""
        search, given = self.search, (self.search, self.rig, self.compared)
        fits, decision = judge(*given)
        named = decision.chosen.causes if decision.verdict == "effect" else ()
        if self.again is not None or not search.inexact or not LAW_FORMS.intersection(named):
            return fits, decision, None
        progress("identifying other laws", 0.68)
        other = other_law(self.measured, search.problem, fits[decision.chosen.index], self.rig.threads)
        if other is None:
            return fits, decision, None
        return (*judge(*given, other.others), other) if other.others else (fits, not_established(decision), other)

    def where(self, chosen: Fit, verdict: str, causes: Mapping[str, float]) -> Where:
        """See `Searched`. With a wrong law the damper's block is always faulty."""
        search, found = self.search, self.blocks
        evidence = damper_evidence(self.measured, found) if verdict == "unknown" else None
        if search.inexact and any(c.unexplained for c in self.compared):
            found = tuple(b for b in found if b.kind != "damper")
        stages, intervals = shares_by_stage(search, chosen, verdict, found, evidence)
        places, ends = place_shares(self.blocks)
        return Where(stages, places=places, intervals=intervals, place_intervals=ends)


def compared_without_law(case: Case, rig: FrameRig, found: Sequence[Block]) -> tuple[Compared, ...]:
    """Findings on the frame's parts that do not depend on the damper's law. Empty if the simulator already
    has effects in the frame, which the balances do not model."""
    if any(e.place is not None for e in case.model.effects):
        return ()
    parts = [Part(b.kind, b.place, b.noise, not b.clean) for b in found if b.place is not None]
    return compared_parts(rig.structure, case.records, rig.catalogue, parts)


def judge(
    search: Search,
    rig: FrameRig,
    channels: Sequence[Compared] = (),
    only: Collection[str] | None = None,
) -> tuple[list[Fit], Decision]:
    """All fits, including those whose structural parameters are interpreted as effects, and the decision.

    channels: findings on storeys and accelerometers without a law; they have priority if the law is not the rig's.
    only: causes that may be named; None: all.
    """
    penalties: dict[int, float] = {}
    if rig.free_structure:
        free = search.ranked(True)
        penalties = {id(f): deviations(f).penalty() for f in free}
        for count in {len(f.hypothesis.causes) for f in free}:
            for f in [f for f in free if len(f.hypothesis.causes) == count][:_LOOKED_AT]:
                for named, penalty in promoted(rig, f, CAUSE + NUMBER):
                    key = named.hypothesis.key
                    if key not in search.fits or named.cost < search.fits[key].cost:
                        search.fits[key] = named
                        penalties[id(named)] = penalty
    fits = [*search.ranked(False), *search.ranked(True)]
    if only is not None:
        fits = [f for f in fits if set(f.hypothesis.causes) <= set(only)]
    if search.inexact:
        search.direct = {c.cause: c.nats for c in channels if c.cause is not None and not c.outside}
    decision = decided(search, fits, penalties)
    if search.inexact and any(c.unexplained for c in channels) and not search.direct:
        return fits, unexplained(decision, fits)
    first = fits[0]
    placed = first.hypothesis.terms and all(t.place is not None for t in first.hypothesis.terms)
    weak = placed and not rig.quiet and not search.inexact and first.cost < search.nominal_cost - _SEEN * search.floor
    if decision.verdict == "none" and weak:
        # A faulty block shows effects that are small compared with the noise of all channels together.
        left = search.unexplained(first)
        decision = replace(decision, verdict="effect", chosen=scored([first])[0], unexplained=left)
    return fits, decision


def _search(
    rig: FrameRig,
    noise: Noise,
    base: Array,
    limits: Limits,
    progress: Progress,
    before: Search | None = None,
) -> Search:
    """A completed search.

    base: (channels,) gap of the nominal simulator on the rig's baseline. before: a search on the same records with
    other nominal parameters, whose fits with fixed parameters are reused.
    """
    problem = Problem(rig, most_different(rig.raw), coarse=True)
    floor = floors(problem, noise, {})
    progress("recalibrating the nominal parameters", 0.0)
    cost, own = float(np.sum(floor**2)) / len(rig.channels), own_cost(problem, base)
    search = FrameSearch(problem, cost, limits, own=own, steady=noise.steady)
    if before is not None:
        search.cache = before.cache.with_fixed_law()
        for found in before.ranked(False):
            if len(found.hypothesis.causes) == 1:
                search.keep(found)
    search.run(progress)
    return search


def stepped(rig: FrameRig, noise: Noise) -> FrameRig:
    """The rig with integration steps for a search. Records with jumps of the command are averaged further if
    they would need even smaller steps: a Bouc-Wen damper is a stiff spring after a jump."""
    for full_rate in (True, False):
        rig = replace(rig, full_rate=full_rate, jump_step=COARSE, coarse_step=COARSE)
        records = most_different(rig.raw)
        floor = floors(Problem(rig, records, coarse=True), noise, {})
        for jumps in (True, False):
            for step in (FINE, FINE / 2):
                if too_coarse(Problem(rig, records, coarse=True), floor, jumps):
                    rig = replace(rig, jump_step=step) if jumps else replace(rig, coarse_step=step)
        if not too_coarse(Problem(rig, records, coarse=True), floor, True):
            break
    return rig


def too_coarse(problem: Problem, floor: Array, jumps: bool) -> bool:
    """True if the nominal simulator's integration error is not small compared with the noise, in the records
    whose command jumps or in the others. floor (blocks,): gaps due to noise."""
    rig = problem.rig
    assert isinstance(rig, FrameRig)
    halved = (
        replace(rig, jump_step=rig.jump_step / 2) if jumps else replace(rig, coarse_step=rig.coarse_step / 2)
    )
    half = Problem(halved, problem.records, coarse=True)
    apart = problem.gaps(problem.of_settings([{}])[0] - half.of_settings([{}])[0])
    return problem.cost(apart) > _STEP_ERROR * problem.cost(floor)


def most_different(records: Sequence[Record]) -> tuple[int, ...]:
    """Indices of at most _RECORDS records. Of two records with similar command and ground motion the later
    one is left out."""
    signs = []
    for r in records:
        u, ground = r.command, r.channel("ground_acceleration_m_s2")
        steps = float(np.std(derivative(u, r.sample_time)))
        rate = float(np.std(derivative(ground, r.sample_time)) / (np.std(ground) or 1.0))
        signs.append((float(np.mean(u)), float(np.std(u)), steps, np.log(rate)))
    # Different commands are more informative than different ground motions, to which a structure responds
    # alike.
    scaled = np.array(signs) / np.maximum(np.std(signs, axis=0), 1e-9) * [1, 1, 1, 0.5]
    kept = list(range(len(records)))
    while len(kept) > _RECORDS:
        pairs = [(float(np.linalg.norm(scaled[a] - scaled[b])), a, b) for a in kept for b in kept if a < b]
        kept.remove(min(pairs)[2])
    return tuple(kept)
