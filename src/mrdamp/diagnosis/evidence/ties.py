"""Causes that these records cannot separate, and causes that they cannot show."""

from __future__ import annotations

from typing import Any

import numpy as np

from mrdamp.diagnosis.constants import HIDDEN_BELOW, NONE_ABOVE, TIE_COSINE, TIE_PROBABLE
from mrdamp.diagnosis.evidence.penalties import unreferenced
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Term
from mrdamp.model.core import Array

#: Settings whose effect decreases as they grow.
_INVERSE = frozenset({"saturation_i_s", "mount_compliance_k", "sensor_leakage_tau"})


def cosine(a: Array, b: Array) -> float:
    """Cosine of the angle between two changes (samples,)."""
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0 else 0.0


def tie_classes(
    search: Search, chosen: Fit, sets: dict[tuple[str, ...], float]
) -> tuple[tuple[str, ...], ...]:
    """Classes of causes that are equivalent to a named one, by probability, or by signature if they leave no more than
    the noise allows: as much as a simulator without a gap.

    sets: probability by set of causes. A class with `parameters`: a recalibration is equivalent.
    """
    named = set(chosen.hypothesis.causes)
    if not named:
        return ()
    free = bool(chosen.hypothesis.nominal)
    rivals: dict[str, set[str]] = {cause: set() for cause in named}
    if "sensor_gain" in named and not search.own and unreferenced(search.problem.rig, chosen):
        rivals["sensor_gain"].add("parameters")
    best = max(sets.values(), default=1.0)
    for causes, p in sets.items():
        members = set(causes)
        if p >= TIE_PROBABLE * best and len(members) == len(named) and len(named - members) == 1:
            rivals[(named - members).pop()] |= members - named
    for found in search.ranked(free):
        members = set(found.hypothesis.causes)
        if len(members) != len(named) or len(named - members) != 1:
            continue
        out, others = (named - members).pop(), named & members
        rest = search.smallest(free, others)
        if rest is None or found.cost > NONE_ABOVE * max(chosen.cost, search.floor):
            continue
        alike = cosine(chosen.residual - rest.residual, found.residual - rest.residual)
        if alike > TIE_COSINE:
            rivals[out] |= members - named
    return tuple(tuple(sorted({cause, *others})) for cause, others in sorted(rivals.items()) if others)


def unseen(search: Search, chosen: Fit) -> tuple[dict[str, Any], ...]:
    """Effects of the catalogue that these records cannot show in any form, each with the largest size that may be
    present.

    This is the size at which the signature, without the part that the free nominal parameters can reproduce,
    reaches a tenth of the remaining error. It is limited to the setting's range. A baseline fixes the nominal
    parameters.
    """
    base = search.fits[False, frozenset()] if search.own else search.base
    basis = np.linalg.qr(base.jacobian)[0] if base.jacobian.shape[1] else base.jacobian
    rough = search.problem.rougher(base.hypothesis)
    before = rough.residuals(base.hypothesis, base.point)[0]
    most: dict[str, tuple[float, Term]] = {}  # of each cause the form that shows most
    for term in (t for t in search.problem.rig.terms if not t.later):
        if term.cause in chosen.hypothesis.causes:
            continue
        hypothesis, point = search.start_from(base, term, 0)
        change = rough.residuals(hypothesis, point)[0] - before
        own = change - basis @ (basis.T @ change)
        size = float(np.linalg.norm(own)) / max(float(np.sqrt(chosen.cost)), 1e-12)
        most[term.cause] = max(most.get(term.cause, (size, term)), (size, term), key=lambda pair: pair[0])
    return tuple(
        {
            "effect": cause,
            "setting": term.coordinates[0].name,
            "could_hide": could_hide(term, HIDDEN_BELOW / max(size, 1e-9)),
        }
        for cause, (size, term) in most.items()
        if size < HIDDEN_BELOW
    )


def could_hide(term: Term, factor: float) -> float:
    """The first setting of a term at a multiple of its starting size, within its range."""
    first, start = term.coordinates[0], term.starts[0][0]
    if not first.log:
        value = first.start + factor * (start - first.start)
    else:
        value = start / factor if first.name.partition("@")[0] in _INVERSE else start * factor
    return min(max(value, first.low), first.high)
