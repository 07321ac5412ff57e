"""Effects of the catalogue fitted along with a law: named ones, or those that its records pay for (`auto`).

What a simulator misses on the records that it was identified on and the choice of a model's form are one question. The
diagnosis answers it: every effect of the catalogue is fitted along with the law, and judged on records left out.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.damper_run import begun
from mrdamp.diagnosis.evidence.judgement import scored
from mrdamp.diagnosis.evidence.verdict import by_causes, of_cause
from mrdamp.diagnosis.fits.final import final_fit, least_left_out
from mrdamp.diagnosis.fits.least_squares import fit
from mrdamp.diagnosis.fits.screening import screen
from mrdamp.diagnosis.hypotheses.nominal_effects import setting_name
from mrdamp.diagnosis.hypotheses.terms import Term
from mrdamp.diagnosis.problem.command_hold import with_hold
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.noise import channel_noise
from mrdamp.diagnosis.report.changes import unit_of
from mrdamp.diagnosis.report.sentence import number
from mrdamp.diagnosis.run import concluded, searched
from mrdamp.diagnosis.searched import Progress, silent
from mrdamp.errors import InputError
from mrdamp.identify.fit import FIT_STEPS, Problem, descend, error, model_of, pooled
from mrdamp.identify.fit import Fit as IdentifiedFit
from mrdamp.identify.laws import EXTRAS, Coordinate
from mrdamp.model import Model, damper_effects
from mrdamp.records import Record, RecordSet

#: In place of names: whatever the records pay for.
AUTO = "auto"
#: What the law's own numbers are: its size, and the preload.
_OF_LAW = "sensor_gain", "sensor_offset"


def sorted_extras(extras: Sequence[str]) -> tuple[list[str], list[str]]:
    """Effects that a law's own fit takes, and others or `AUTO`. Raises InputError for what is neither."""
    allowed = [AUTO, *dict.fromkeys((*EXTRAS, *(e for e in damper_effects() if e not in _OF_LAW)))]
    for extra in extras:
        if extra not in allowed:
            raise InputError(f"{extra!r} cannot be fitted along; allowed: {', '.join(allowed)}")
    more = [e for e in dict.fromkeys(extras) if e not in EXTRAS]
    if AUTO in more and len(more) > 1:
        raise InputError(f"{AUTO!r} finds the effects itself; allowed beside it: {', '.join(EXTRAS)}")
    return ["offset"] if list(extras) == [AUTO] else [e for e in extras if e in EXTRAS], more


@dataclass(frozen=True)
class Form:
    """A model with the effects that its records pay for.

    effects: probability by name, None of one that was asked for; empty if there is none, and the model is the given
    one. left: share of the squared error of the law without them that they leave on left-out records, both fitted in
    the same way. beside: effects of the model that left-out records pay for and that are not established, with the
    share of the squared error without them that they leave there.
    """

    model: Model
    effects: Mapping[str, float | None]
    left: float = 1.0
    beside: Mapping[str, float] = field(default_factory=dict)

    def lines(self) -> list[str]:
        """What the effects are worth, for a person."""
        if not self.effects:
            return ["no effect of the catalogue pays for itself on left-out records"]
        named = ", ".join(f"{c} (probability {p:.2f})" if p is not None else c for c, p in self.effects.items())
        worth = f"they leave at most {100 * self.left:.0f} % of the squared error of the law alone"
        lines = [f"fitted along: {named}", *self._sizes(self.effects), f"  on records left out of the fits {worth}"]
        for name, left in self.beside.items():
            said = f"  beside them {name}, which is not established: it leaves {100 * left:.0f} % of that"
            lines += [said, *self._sizes([name])]
        return lines

    def _sizes(self, names: Collection[str]) -> list[str]:
        """Parameters of some effects, a line for each."""
        return [
            f"  {e.name}: "
            + ", ".join(number(k, v, None, unit_of(setting_name(e.name, k, e.place))) for k, v in e.parameters.items())
            for e in self.model.effects
            if e.name in names
        ]

    def applied(self, fit: IdentifiedFit, records: RecordSet) -> IdentifiedFit:
        """An identification with this model in place of its own, and the errors of the records with it."""
        if not self.effects:
            return fit
        fitted, held = (tuple(error(self.model, r) for r in half) for half in (records.train, records.validation))
        return replace(fit, model=self.model, train=fitted, held_out=held, space=None, point=())


def form_with(
    alone: IdentifiedFit, records: Sequence[Record], causes: Sequence[str], *, threads: int = 1,
    progress: Progress = silent,
) -> Form:
    """A law that was fitted to the records with these effects, one after the other, in the forms with the least error
    on left-out records, then all together. `[AUTO]`: those that the records pay for. Raises InputError."""
    model = alone.model
    if list(causes) == [AUTO]:
        return form_of(model, records, threads=threads, progress=progress)
    with threadpool_limits(limits=1):
        case, _ = with_hold(Case(model.name, Path(), model, tuple(records), (), own=len(records)), threads)
        rig = DamperRig(case.model, case.records, threads=threads).with_motion()
        search, _ = begun(rig, channel_noise(case, rig)[0], missed=True)
        found = search.base
        for k, cause in enumerate(causes):
            progress(f"fitting {cause}", k / len(causes))
            tests = screen(search, found, [t for t in rig.terms if t.cause == cause])
            known = search.law_columns(found)
            tasks = [(*search.start_from(found, p.term, p.start, p.by), known, np.inf) for p in tests]
            if not (tried := search.keep_tried(tasks)):
                raise InputError(f"{records[0].label}: no form of {cause} that these records could show")
            found = least_left_out(search, min(tried, key=lambda f: f.cost))
        final = final_fit(search, found, rig=rig)
    left = search.left_out_cost(found) / search.left_out_cost(search.base)
    progress("fitting all together", 1.0)
    whole = _together(alone, rig.model(final.fit.settings), found.hypothesis.terms, records, threads)
    return Form(whole, dict.fromkeys(causes), left)


def _together(
    alone: IdentifiedFit, model: Model, terms: Sequence[Term], records: Sequence[Record], threads: int
) -> Model:
    """A model with its law and its effects fitted together from where they are; as it is if that is no nearer.

    alone: the fit of its law without them, which has taken their place as far as it could and is moved back.
    """
    assert alone.space is not None
    more = tuple(Coordinate(c.name, c.start, c.low, c.high, c.log) for term in terms for c in term.coordinates)
    fixed = {name: value for term in terms for name, value in term.fixed.items()}
    search = replace(alone.space, plain=(*alone.space.plain, *more), fixed=fixed)
    problem = Problem(search, records, threads, freed=False, hold=bool(model.hold))
    found = model_of(search, descend(problem, search.point(model.attributes), FIT_STEPS)[2])
    moved = replace(model, parameters={**model.parameters, **found.parameters}, effects=found.effects)
    return min((model, moved), key=lambda m: pooled([error(m, r) for r in records]))


def form_of(
    model: Model,
    records: Sequence[Record],
    *,
    threads: int = 1,
    progress: Progress = silent,
) -> Form:
    """The effects of the catalogue that a model of a damper misses on the records that it was identified on, fitted
    along with its law. Raises InputError."""
    case = Case(model.name, Path(), model, tuple(records), (), own=len(records))
    with threadpool_limits(limits=1):
        found = searched(case, threads, progress, None)
        made = concluded(found, progress)
    search, chosen, decision = found.search, made.chosen, made.decision
    if decision.verdict != "effect":
        return Form(model, {})
    alone = search.base if chosen.hypothesis.nominal else search.fits[False, frozenset()]
    likely = of_cause(by_causes(scored(made.fits), decision.probabilities))
    share, causes, last = 1 - decision.unknown, chosen.hypothesis.causes, made.final.fit
    beside = [cause for cause in last.hypothesis.causes if cause not in causes]  # one at most (`with_unnamed`)
    left = search.left_out_cost(chosen)
    with_all = fit(search.problem, last.hypothesis, last.point, most=0) if beside else chosen
    return Form(
        found.rig.model(last.settings),
        {cause: share * likely[cause] for cause in causes},
        left / search.left_out_cost(alone),
        dict.fromkeys(beside, search.left_out_cost(with_all) / left),
    )
