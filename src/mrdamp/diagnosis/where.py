"""Where the gap lies: shares by stage of the chain, by record, and the regimes that hold more than their part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mrdamp.core import Array
from mrdamp.diagnosis.fit import Fit
from mrdamp.diagnosis.problem import Problem
from mrdamp.diagnosis.result import Regime
from mrdamp.diagnosis.search import Search
from mrdamp.diagnosis.terms import STAGES
from mrdamp.diagnosis.verdict import shapley

#: Without a cause that explains it, a stage counts by this power of what its effects explain best.
_SHARPNESS = 3.0
#: Where the law's own numbers act: they stand between the field and the mechanics.
LAW_STAGE = "fluid"


def stage_shares(search: Search, chosen: Fit, verdict: str) -> dict[str, float]:
    """Shares (adding up to 1) of the gap by stage.

    With causes named, their Shapley shares in the fall of the cost; free numbers of the law count as fluid. Without
    a cause (`unknown`), what the effects of each stage explain at best, sharpened: the stage whose effects come
    nearest is where the cause most likely sits.
    """
    stages = [s for s in STAGES if any(t.stage == s for t in search.problem.rig.terms)]
    if verdict in ("none", "parameters") or (verdict == "effect" and not chosen.hypothesis.terms):
        return {s: float(s == LAW_STAGE) for s in stages}
    if verdict == "unknown":
        return _nearest(search, stages)
    shares = dict.fromkeys(stages, 0.0)
    free = bool(chosen.hypothesis.nominal)
    costs = {
        frozenset(f.hypothesis.causes): f.cost for f in reversed(search.ranked(free))
    }  # the best form of each set comes last, and stays
    if free:
        fall = search.nominal_cost - search.base.cost
        shares[LAW_STAGE] += 0.5 * max(fall, 0.0)
    stage = {t.cause: t.stage for t in chosen.hypothesis.terms}
    for cause, share in shapley(costs, chosen.hypothesis.causes).items():
        shares[stage[cause]] += max(share, 0.0)
    total = sum(shares.values())
    if not total > 0:
        return {s: 1 / len(stages) for s in stages}
    return {s: value / total for s, value in shares.items()}


def _nearest(search: Search, stages: Sequence[str]) -> dict[str, float]:
    explained = dict.fromkeys(stages, 1e-3)
    for free in (False, True):
        base = search.nominal_cost if not free else search.base.cost
        for f in search.ranked(free):
            of = {t.stage for t in f.hypothesis.terms}
            if len(of) == 1 and base > search.floor:
                share = (base - f.cost) / (base - search.floor)
                only = of.pop()
                explained[only] = max(explained[only], share)
    weights = {s: value**_SHARPNESS for s, value in explained.items()}
    total = sum(weights.values())
    return {s: value / total for s, value in weights.items()}


def record_shares(problem: Problem, residual: Array) -> dict[str, float]:
    """Share of the sum of gaps squared by record."""
    squares = problem.gaps(residual) ** 2
    out: dict[str, float] = {}
    for b, value in zip(problem.blocks, squares, strict=True):
        name = problem.rig.records[b.record].name
        out[name] = out.get(name, 0.0) + float(value)
    total = sum(out.values()) or 1.0
    return {name: value / total for name, value in out.items()}


def regimes(
    conditions: Mapping[str, Array], residual: Array, halves: Array, least: float = 1.5, bins: int = 4
) -> tuple[Regime, ...]:
    """Regions in which the squared residual is `least` times its mean, found on one half and confirmed on the other.

    conditions: name -> (samples,); residual (samples,) weighted; halves (samples,) bool: which half to find on.
    Regions are the quarters of each condition's range of values.
    """
    power = residual**2
    found = []
    for name, values in conditions.items():
        edges = np.quantile(values, np.linspace(0, 1, bins + 1))
        if not edges[-1] > edges[0]:
            continue
        for k in range(bins):
            inside = (values >= edges[k]) & ((values < edges[k + 1]) | (k == bins - 1))
            ratios = []
            for half in (halves, np.logical_not(halves)):
                n = np.count_nonzero(inside & half)
                mean = float(np.mean(power[half]))
                ratios.append(float(np.mean(power[inside & half])) / mean if n > 20 and mean > 0 else 0.0)
            if min(ratios) > least:
                share = float(np.sum(power[inside]) / max(np.sum(power), 1e-30))
                what = f"{name} from {edges[k]:.3g} to {edges[k + 1]:.3g}"
                found.append(Regime(what, share, float(np.mean(inside))))
    found.sort(key=lambda r: (-r.share_of_gap / max(r.share_of_samples, 1e-9), r.what))
    return tuple(found[:6])
