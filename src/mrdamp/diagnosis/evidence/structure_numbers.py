"""Free nominal parameters of a frame: outliers among the structural ones, and the scatter of the others.

A storey's stiffness and damping and a floor's mass are nominal parameters and causes at once. If all
parameters are slightly wrong, the verdict is `parameters`. If one deviates far more than the others, it is an
effect of that storey or floor. The scatter is estimated from the parameters themselves, with heavy tails
(Student, 2 degrees of freedom).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mrdamp.diagnosis.constants import (
    DAMPING_SCATTER,
    STRUCTURE_CHANGE,
    STRUCTURE_SAMPLES,
    STRUCTURE_SCATTER,
)
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Term
from mrdamp.diagnosis.problem.frame import FrameRig
from mrdamp.model.core import Array

#: Largest number of such effects.
_MOST = 2
_EFFECTS = {"stiffness": "storey_stiffness", "damping": "storey_damping", "mass": "floor_mass"}


@dataclass(frozen=True)
class Deviations:
    """Logarithms of fitted over nominal structural parameters (numbers,), without the common change of masses
    and stiffnesses.

    scale: 1, or the factor by which the parameter is known less well. error: standard errors (numbers,).
    """

    names: tuple[str, ...]
    columns: tuple[int, ...]
    values: Array
    scale: Array
    error: Array

    def penalty(self, without: tuple[int, ...] = ()) -> float:
        """Penalty (nats) of these deviations at the most likely scatter, `without` some of them."""
        keep = [k for k in range(len(self.names)) if k not in without]
        scatters = STRUCTURE_SCATTER * np.geomspace(1.0, 30.0, 25)
        least = np.inf
        for s in scatters:
            size = np.hypot(s * self.scale[keep], self.error[keep])
            own = np.hypot(STRUCTURE_SCATTER * self.scale[keep], self.error[keep])
            nats = np.sum(1.5 * np.log1p(0.5 * (self.values[keep] / size) ** 2) + np.log(size / own))
            least = min(least, float(nats))
        return least


def deviations(found: Fit) -> Deviations:
    """Deviations of a fit with free nominal parameters."""
    q = found.point
    names, columns = [], []
    for k, c in enumerate(found.hypothesis.nominal):
        if c.name.partition("@")[0] in _EFFECTS:
            names.append(c.name)
            columns.append(k)
    coordinates = [found.hypothesis.nominal[k] for k in columns]
    values = np.array([c.scale * q[k] for c, k in zip(coordinates, columns, strict=True)])
    kinds = [n.partition("@")[0] for n in names]
    common = float(np.median([v for v, kind in zip(values, kinds, strict=True) if kind != "damping"]))
    values = values - np.array([0.0 if kind == "damping" else common for kind in kinds])
    normal = found.jacobian.T @ found.jacobian
    normal += np.diag(1e-9 * np.max(np.diag(normal)) + found.hypothesis.prior() ** 2 * 1e-6)
    covariance = np.linalg.inv(normal) * found.cost / STRUCTURE_SAMPLES
    error = np.array([c.scale * np.sqrt(covariance[k, k]) for c, k in zip(coordinates, columns, strict=True)])
    scale = np.array([DAMPING_SCATTER if kind == "damping" else 1.0 for kind in kinds])
    return Deviations(tuple(names), tuple(columns), values, scale, error)


def promoted(rig: FrameRig, found: Fit, each: float) -> list[tuple[Fit, float]]:
    """The fit with one or two structural parameters interpreted as effects, and the remaining penalty.

    Only effects that each reduce the penalty by more than `each` nats. The simulator is the same.
    """
    d = deviations(found)
    out: list[tuple[Fit, float]] = []
    taken = {t.cause for t in found.hypothesis.terms}
    far = [
        k
        for k in range(len(d.names))
        if abs(d.values[k]) > STRUCTURE_CHANGE * d.scale[k]
        and abs(d.values[k]) > 3 * d.error[k]
        and _cause(d.names[k]) not in taken
    ]
    far.sort(key=lambda k: -abs(d.values[k]) / d.scale[k])
    whole = d.penalty()
    for count in range(1, _MOST + 1):
        for chosen in combinations(far[:4], count):
            penalty = d.penalty(chosen)
            if penalty < whole - count * each:
                out.append((_as_effects(rig, found, d, chosen), penalty))
    return out


def _cause(name: str) -> str:
    kind, _, place = name.partition("@")
    return f"{_EFFECTS[kind]}@{place}"


def _as_effects(rig: FrameRig, found: Fit, d: Deviations, chosen: tuple[int, ...]) -> Fit:
    """The same simulator with changes of nominal parameters expressed as effects."""
    terms: list[Term] = [next(t for t in rig.terms if t.cause == _cause(d.names[k])) for k in chosen]
    point, added, columns = found.point.copy(), [], []
    for k, term in zip(chosen, terms, strict=True):
        at, nominal = d.columns[k], found.hypothesis.nominal[d.columns[k]]
        rest = (
            found.point[at] - d.values[k] / nominal.scale
        )  # the common change of masses and stiffnesses stays nominal
        own = nominal.value(float(rest))
        change = nominal.value(float(found.point[at])) - own
        coordinate = term.coordinates[0]
        added.append(coordinate.point(change if term.effect == "floor_mass" else change / own))
        slope = (1.0 if term.effect == "floor_mass" else own) * coordinate.scale
        columns.append(
            found.jacobian[:, at] * slope / (nominal.scale * nominal.value(float(found.point[at])))
        )
        point[at] = rest
    hypothesis = Hypothesis(found.hypothesis.nominal, (*found.hypothesis.terms, *terms))
    jacobian = np.hstack([found.jacobian, np.array(columns).T])
    return Fit(
        hypothesis,
        np.concatenate([point, added]),
        found.cost,
        found.residual,
        jacobian,
        found.iterations,
        found.converged,
    )
