"""The corrected simulator: the chosen causes fitted to all records with the full step."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from mrdamp.diagnosis.constants import EVIDENCE_GAIN, NUMBER
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.left_out import folds, predicted
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.problem.residuals import Problem, squared_gap
from mrdamp.diagnosis.problem.rig import Rig
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.predict import free_run

#: Number of fits of the chosen causes, in other forms, that are compared on left-out folds.
_FORMS = 3
#: A fit is accepted unchanged if the full step changes its cost by less than this share of the cost or of the
#: excess.
_SAME, _NOTHING = 0.02, 1e-5
#: Further iterations of a fit that had not converged; iterations of a fit to excerpts on the whole records.
_THROUGH, _WHOLE_STEPS = 8, 3
#: Free nominal parameters must reduce the mean square on left-out folds by this share.
_FREER = 0.1

#: Largest difference of two gaps of one simulator, as a share of the measurement's RMS.
AGREEMENT = 0.01


@dataclass(frozen=True)
class FinalFit:
    """The final fit, and its gaps (blocks,) on left-out records."""

    fit: Fit
    heldout: Array
    problem: Problem


def heldout(problem: Problem, found: Fit) -> Array:
    """Gaps (blocks,) of what a fit predicts of records, or parts of few records, that it was not fitted to."""
    return problem.gaps(predicted(problem, found, folds(problem)))


def final_fit(search: Search, best: Fit, *, rig: Rig | None = None) -> FinalFit:
    """A fit continued with the full step of the chain, as the handed-over simulator runs.

    rig: with the whole records, if the search used excerpts.
    """
    if not best.converged and best.hypothesis.coordinates:
        further = search.fitted(best.hypothesis, best.point, most=_THROUGH, stage=" through")
        best = min(further, best, key=lambda f: f.cost)
    if rig is None or rig is search.problem.rig:
        return _with_full_step(search, best)
    problem = Problem.thinned(rig, trust=search.problem.trust)
    final = fit(problem, best.hypothesis, best.point, most=_WHOLE_STEPS if best.hypothesis.coordinates else 0)
    return FinalFit(final, heldout(problem, final), problem)


def least_left_out(search: Search, chosen: Fit, *, fixed: bool = False) -> Fit:
    """The fit of the chosen causes with the least error on left-out folds, of those that a model file takes; of the
    nominal simulator itself. Parameters of a form count as those of a cause.

    Nominal parameters stay fixed unless free ones reduce the error by _FREER: they were identified on this
    rig. fixed: they do wherever there is such a fit.
    """
    if not chosen.hypothesis.coordinates:
        return chosen
    causes, rig = set(chosen.hypothesis.causes), search.problem.rig

    def penalised(f: Fit, cost: float) -> float:
        return float(EVIDENCE_GAIN * np.log(max(cost, 1e-300)) + NUMBER * len(f.point))

    found = {}
    for beside in (False, True):
        same = [f for f in search.ranked(beside) if set(f.hypothesis.causes) == causes and in_file(rig, f)]
        near = sorted(same, key=lambda f: penalised(f, f.cost))[:_FORMS]
        found[beside] = min(near, key=lambda f: penalised(f, search.left_out_cost(f)), default=None)
    fixed_law, free = found[False], found[True]
    if fixed_law is None or free is None:
        return fixed_law or free or chosen
    if fixed or search.left_out_cost(free) >= (1 - _FREER) * search.left_out_cost(fixed_law):
        return fixed_law
    return free


def in_file(rig: Rig, found: Fit) -> bool:
    """True if a model file takes the simulator of a fit: no coefficient is negative at both ends of the command."""
    with suppress(InputError):
        Model.from_dict(rig.model(found.settings).to_dict())
        return True
    return False


def predicted_gap(model: Model, problem: Problem) -> float:
    """RMS error over the measurement's RMS, by the path of `mrdamp predict` with a simulator's file; records and
    channels have equal weight."""
    rig, squares = problem.rig, []
    for k in problem.records:
        try:
            channels = rig.compared(free_run(model, rig.driven(k)), k)
        except InputError:
            return float("nan")
        dt = rig.records[k].sample_time
        squares += [squared_gap(one, other, dt) for one, other in zip(channels, rig.measured(k), strict=True)]
    return float(np.sqrt(np.mean(squares)))


def _with_full_step(search: Search, found: Fit) -> FinalFit:
    fine = search.problem.like(coarse=False)
    final = replace(fit(fine, found.hypothesis, found.point, most=0), converged=found.converged)
    # If the step of the search was small enough, its fit is the result.
    if abs(final.cost - found.cost) > max(_SAME * found.cost, _NOTHING * search.excess):
        known = search.law_columns(found)
        final = fit(fine, found.hypothesis, found.point, most=2, known=known, frozen=known is not None)
    return FinalFit(final, heldout(fine, final), fine)
