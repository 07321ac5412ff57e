"""Shares of the gap by stage of the chain and by record, and regimes with more than their share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from mrdamp.diagnosis.attribution.shares import Intervals, Measured, Regime, Shares, intervals, of_total
from mrdamp.diagnosis.attribution.stage_evidence import StageEvidence
from mrdamp.diagnosis.evidence.resample import draws, group_sums, seconds
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import STAGES, Settings
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array

#: Stage of the nominal parameters, which act between the field and the mechanics.
LAW_STAGE = "fluid"


def stage_shares(
    search: Search,
    chosen: Fit,
    verdict: str,
    measured: Sequence[Measured] = (),
    drawn: Array | None = None,
    evidence: StageEvidence | None = None,
    causes: Mapping[str, float] | None = None,
) -> tuple[Shares, Intervals]:
    """Shares of the gap by stage, adding up to 1, and their 95 % intervals by bootstrap over seconds; none if the
    shares follow by definition.

    With named causes: the covariance of each cause's change of the simulated channels, at its fitted
    parameters, with the whole change. Changes of nominal parameters count as fluid. Without a cause
    (`unknown`): that of the cause outside the catalogue that explains the gap, else the evidence of each stage
    (`evidence`), or without any the stages of the catalogue's causes by their probabilities (`causes`). Measured
    interfaces (`measured`; drawn (draws, measured): their shares in the same draws) take precedence.
    """
    stages = [s for s in STAGES if any(t.stage == s for t in search.problem.rig.terms)]
    if verdict == "effect" and chosen.hypothesis.terms:
        table = changes(search, chosen)
        rows = [_of_changes(stages, sums, chosen) for sums in draws(len(table)) @ table]
        return _of_changes(stages, table.sum(axis=0), chosen), intervals(rows)
    if verdict != "unknown":
        return {s: float(s == LAW_STAGE) for s in stages}, {}
    if search.looks_like is not None:
        (term,) = search.looks_like.hypothesis.terms
        return {s: float(s == term.stage) for s in stages}, {}

    def within(parts: Sequence[float], found: Mapping[str, float]) -> dict[str, float]:
        return _within({s: found.get(s, 0.0) for s in stages}, parts, measured)

    if evidence is None:
        of = {t.cause: t.stage for t in search.problem.rig.terms}
        known = {s: sum(p for cause, p in (causes or {}).items() if of.get(cause) == s) for s in stages}
        return within([m.share for m in measured], of_total(known, 1 / len(stages))), {}
    parts = np.zeros((len(evidence.values) - 1, len(measured))) if drawn is None else drawn
    rows = [within(own.tolist(), evidence.at(k)) for k, own in enumerate(parts)]
    return within([m.share for m in measured], evidence.at()), intervals(rows)


def changes(search: Search, chosen: Fit) -> Array:
    """Changes by the parts of a corrected simulator, its causes in their order, then the nominal parameters: sums
    (seconds, parts) of a part's change times the whole change, over samples weighted as the residuals are.

    A part's change is its Shapley value: the mean over all orders of switching the parts on with their fitted
    parameters. Nothing is fitted again, because a law that is refitted without a cause compensates for it.
    """
    hypothesis, q = chosen.hypothesis, iter(chosen.point.tolist())
    law: Settings = {c.name: c.value(next(q)) for c in hypothesis.nominal}
    settings: dict[str, Settings] = {cause: {} for cause in hypothesis.causes}
    for term in hypothesis.terms:
        settings[term.cause] |= dict(term.fixed) | {c.name: c.value(next(q)) for c in term.coordinates}
    parts = [*settings.values(), law]
    n = len(parts)
    sets: list[Settings] = [
        {k: v for i, p in enumerate(parts) if bits >> i & 1 for k, v in p.items()} for bits in range(2**n)
    ]
    rows = search.problem.of_settings(sets)
    change = np.zeros((search.problem.samples, n))
    for i in range(n):
        for bits in (b for b in range(2**n) if not b >> i & 1):
            inside = bits.bit_count()
            weight = math.factorial(inside) * math.factorial(n - inside - 1) / math.factorial(n)
            change[:, i] += weight * (rows[bits | 1 << i] - rows[bits])
    whole = rows[-1] - rows[0]
    return group_sums(change * whole[:, None], seconds(search.problem))


def _of_changes(stages: Sequence[str], sums: Array, chosen: Fit) -> dict[str, float]:
    """Shares of the stages from the sums (parts,) of `changes`."""
    shares = dict.fromkeys(stages, 0.0)
    stage = {t.cause: t.stage for t in chosen.hypothesis.terms}
    for name, value in zip([*(stage[c] for c in chosen.hypothesis.causes), LAW_STAGE], sums, strict=True):
        shares[name] = shares.get(name, 0.0) + max(float(value), 0.0)
    return of_total(shares, 1 / len(shares))


def cause_shares(search: Search, chosen: Fit) -> dict[str, float]:
    """Share of the gap beyond the noise that each named cause explains: what the fit explains, divided by the causes'
    parts in its change (`changes`)."""
    sums = np.maximum(changes(search, chosen).sum(axis=0), 0.0)
    parts = (1 - search.unexplained(chosen)) * sums / max(float(sums.sum()), 1e-300)
    return dict(zip(chosen.hypothesis.causes, parts[:-1].tolist(), strict=True))


def _within(
    nearest: Mapping[str, float], parts: Sequence[float], measured: Sequence[Measured]
) -> dict[str, float]:
    """Shares of the stages within each measured part, which keeps its own share.

    An error of the displacement measurement changes the damper's motion. The part from the command to the
    load cell therefore contains that part of the sensor stage.
    """
    sizes = [max(p, 0.0) for p in parts]
    if not sum(sizes) > 0:
        return dict(nearest)
    out = dict.fromkeys(nearest, 0.0)
    for part, size in zip(measured, sizes, strict=True):
        inside = [s for s in part.stages if s in out]
        if "mount" in inside and "sensor" not in inside:
            inside.append("sensor")
        total = sum(nearest[s] for s in inside)
        for s in inside:
            out[s] += size / sum(sizes) * (nearest[s] / total if total > 0 else 1 / len(inside))
    return out


def record_shares(problem: Problem, residual: Array) -> dict[str, float]:
    """Share of each record in the sum of squared gaps."""
    squares = problem.gaps(residual) ** 2
    out: dict[str, float] = {}
    for b, value in zip(problem.blocks, squares, strict=True):
        name = problem.rig.records[b.record].name
        out[name] = out.get(name, 0.0) + float(value)
    return of_total(out)


def regimes(
    conditions: Mapping[str, Array], residual: Array, halves: Array, least: float = 1.5, bins: int = 4
) -> tuple[Regime, ...]:
    """Regions in which the squared residual exceeds `least` times its mean, found on one half and confirmed
    on the other.

    conditions: name -> (samples,). residual: (samples,), weighted. halves: (samples,) bool, the half for
    finding. Regions are the quarters of each condition's range of values (quantiles).
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
                ends = np.array([np.min(values[inside]), np.max(values[inside])])
                low, high = np.where(np.abs(ends) < 1e-6 * (edges[-1] - edges[0]), 0.0, ends)
                what = f"{name} {low:.3g}" if low == high else f"{name} from {low:.3g} to {high:.3g}"
                found.append(Regime(what, share, float(np.mean(inside))))
    found.sort(key=lambda r: (-r.share_of_gap / max(r.share_of_samples, 1e-9), r.what))
    return tuple(found[:6])
