"""The effects that a law's own identification records pay for: `mrdamp identify --extras auto`.

What a simulator misses on the records that it was identified on and the choice of a model's form are one question. The
diagnosis answers it: every effect of the catalogue is fitted along with the law, and judged on records left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.evidence.judgement import scored
from mrdamp.diagnosis.evidence.verdict import by_causes, of_cause
from mrdamp.diagnosis.run import concluded, searched
from mrdamp.diagnosis.searched import Progress, silent
from mrdamp.identify.fit import Fit as IdentifiedFit
from mrdamp.identify.fit import error
from mrdamp.model import Model
from mrdamp.records import Record, RecordSet


@dataclass(frozen=True)
class Form:
    """A model with the effects that its records pay for.

    effects: probability by name; empty if there is none, and the model is the given one. left: share of the squared
    error of the law without them that they leave on left-out records, both fitted in the same way.
    """

    model: Model
    effects: Mapping[str, float]
    left: float = 1.0

    def lines(self) -> list[str]:
        """What the effects are worth, for a person."""
        if not self.effects:
            return ["no effect of the catalogue pays for itself on left-out records"]
        named = ", ".join(f"{name} (probability {p:.2f})" for name, p in self.effects.items())
        worth = f"they leave {100 * self.left:.0f} % of the squared error of the law alone"
        return [f"fitted along: {named}", f"  on records left out of the fits {worth}"]

    def applied(self, fit: IdentifiedFit, records: RecordSet) -> IdentifiedFit:
        """An identification with this model in place of its own, and the errors of the records with it."""
        if not self.effects:
            return fit
        fitted, held = (tuple(error(self.model, r) for r in half) for half in (records.train, records.validation))
        return replace(fit, model=self.model, train=fitted, held_out=held, space=None, point=())


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
    share = 1 - decision.unknown
    return Form(
        found.rig.model(made.final.fit.settings),
        {cause: share * likely[cause] for cause in chosen.hypothesis.causes},
        search.left_out_cost(chosen) / search.left_out_cost(alone),
    )
