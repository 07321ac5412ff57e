"""From fits to an answer: evidence of each set of causes, probabilities, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mrdamp.diagnosis.constants import (
    CAUSE,
    LAPSE,
    LAPSE_INEXACT,
    LAPSE_WORSE,
    LAW,
    NONE_ABOVE,
    OUTSIDE_PENALTY,
    TEMPER,
    UNKNOWN_ABOVE,
    UNSTEADY,
)
from mrdamp.diagnosis.evidence.established import Standing, softmax, standing, utility
from mrdamp.model.core import Array


@dataclass(frozen=True)
class Scored:
    """A fitted set of causes and its evidence.

    cost: sum of squared residuals. numbers: number of free coordinates of its effects. index: place in the
    list of fits. penalty: nats against it.
    direct: nats for its causes from channels that measure the same quantity. left_out: share that it leaves of the
    left-out squares of the simulator without its causes.
    """

    causes: tuple[str, ...]
    free: bool
    cost: float
    numbers: int
    index: int = -1
    penalty: float = 0.0
    direct: float = 0.0
    left_out: float = 1.0


@dataclass(frozen=True)
class Decision:
    """The verdict and the fit behind it.

    probabilities: of each fit in order. unexplained: share of the excess that the chosen fit leaves. floor:
    cost of the noise. unknown: probability that the cause is not in the catalogue; the others share the rest.
    outside: index of the rival that explains the gap better than the catalogue, or None. apart: channels of
    one quantity differ and nothing in the catalogue explains it, so that no cause may be named for it. changed:
    probability of each cause that it is new since the baseline (`evidence.changed`).
    """

    verdict: str
    chosen: Scored
    probabilities: tuple[float, ...]
    unexplained: float
    floor: float
    excess: float
    unknown: float = 0.0
    outside: int | None = None
    standing: Standing | None = None
    apart: bool = False
    changed: Mapping[str, float] = field(default_factory=dict)


def decide(
    fits: Sequence[Scored], floor: float, rivals: Sequence[Scored] = (), *, steady: bool = True, own: float = 0.0
) -> Decision:
    """The verdict over fits, one of which is the nominal simulator (no causes, not free).

    floor: cost of the noise. rivals: fits of causes outside the catalogue; if those that leave no more than the
    catalogue's best have more evidence than all its sets, the answer is `unknown` and the most probable one a hint.
    steady: False if two runs of one test differ by more than their noise, which neither `none` nor
    `parameters` explains. own: cost of the nominal simulator on the rig's baseline, if there is one; a gap
    up to this size is none.
    """
    nominal = next(f for f in fits if not f.causes and not f.free)
    # The least cost of any fit counts as noise, up to a limit: it contains inter-sample motion and initial
    # states.
    floor = min(max(min(f.cost for f in fits), floor), NONE_ABOVE**2 / 2 * floor)
    excess = max(nominal.cost - floor, 1e-12)
    law = next((f for f in fits if f.free and not f.causes), None)
    free = of_parameters(law, baseline=own > 0)
    scores = np.array([of_fit(f, free) for f in fits])
    # The answer is the most probable set of causes over all its forms, in its best form.
    known = by_causes(fits, [float(p) for p in softmax(scores)])
    found = standing(known)
    named = found is not None and found.probability > 0.5
    likely = _fitted_with(known, found.causes) if found is not None and named else _without_cause(known)
    chosen = fits[max((k for k, f in enumerate(fits) if _named(f) == likely), key=lambda k: float(scores[k]))]
    left = max(chosen.cost - floor, 0.0) / excess if chosen.causes or chosen.free else 1.0
    # A rival with the larger error is no better explanation.
    rivals = [r for r in rivals if r.cost <= chosen.cost]
    other = np.array([of_fit(f, free) for f in rivals]) - OUTSIDE_PENALTY
    shares, place = softmax(np.concatenate([scores, other])), fits.index(nominal)
    rival = float(np.sum(shares[len(fits) :]))
    outside = rivals[int(np.argmax(other))].index if rival > 0.5 else None
    least = 0.0  # probability of an unknown cause, beside a rival, if none is named
    if not chosen.causes:
        least = rival + (1 - rival) * (beyond(left) if chosen.free and steady else UNSTEADY)
    verdict = "unknown"
    if outside is None and max(rival + float(shares[place]), least) <= 0.5:
        verdict = "effect" if chosen.causes else "parameters"
    stated = _tempered(shares, [*map(_named, fits), *(("outside",) for _ in rivals)])[: len(fits)]
    beside = 1 - float(stated.sum() - stated[place])
    stated[place] = 0.0
    probabilities = tuple(float(p) for p in stated / max(stated.sum(), 1e-300))
    decision = Decision(verdict, chosen, probabilities, left, floor, excess, beside, outside, found)
    if verdict != "effect" and outside is None:
        none = no_gap(decision, fits, max(own, floor if steady else 0.0))
        if none is not None:
            return none
    return replace(decision, unknown=max(beside, least))


def _tempered(shares: Array, sets: Sequence[tuple[str, ...]]) -> Array:
    """Probabilities (fits,) of which the sums over each set of causes are tempered.

    Source: Guo et al. (2017), On calibration of modern neural networks (temperature scaling).
    """
    total: dict[tuple[str, ...], float] = {}
    for causes, p in zip(sets, shares, strict=True):
        total[causes] = total.get(causes, 0.0) + float(p)
    out = shares * np.array([max(total[causes], 1e-300) ** (1 / TEMPER - 1) for causes in sets])
    return np.asarray(out / out.sum())


def no_gap(decision: Decision, fits: Sequence[Scored], quiet: float) -> Decision | None:
    """The decision that there is no gap; None if the nominal simulator's cost is above NONE_ABOVE times `quiet`, the
    cost of the noise or of its error on the baseline. An unknown cause has one half there; those of the catalogue keep
    their probabilities."""
    shares = (1 - decision.unknown) * np.array(decision.probabilities)
    place = next(k for k, f in enumerate(fits) if not f.causes and not f.free)
    shares[place] += 1 - shares.sum()
    cost = fits[place].cost
    if cost > NONE_ABOVE * quiet:
        return None
    return replace(
        decision,
        verdict="none",
        chosen=replace(fits[place], index=place),
        probabilities=tuple(map(float, shares)),
        unexplained=1.0,
        unknown=_even_at_one((cost / max(quiet, 1e-300) - 1) / (NONE_ABOVE - 1)),
        standing=None,
    )


def _fitted_with(known: Mapping[tuple[str, ...], float], causes: tuple[str, ...]) -> tuple[str, ...]:
    """The set of causes as fitted: the most probable one that contains them if they were not fitted alone."""
    wanted = set(causes)
    return next((s for s in known if set(s) == wanted), None) or next(s for s in known if wanted <= set(s))


def _without_cause(known: Mapping[tuple[str, ...], float]) -> tuple[str, ...]:
    none: tuple[tuple[str, ...], ...] = ((), ("parameters",))
    return max(none, key=lambda k: known.get(k, 0.0))


def of_parameters(law: Scored | None, *, baseline: bool) -> tuple[float, float]:
    """Utility (nats) of wrong nominal parameters (`law`: they alone are free): alone, and beside a cause.

    Without a baseline, which determines them, they count as a cause, and beside one they are no worse than fixed ones.
    """
    gain = 0.0 if law is None else utility(law.left_out, 0, 0, penalty=law.penalty)
    alone = gain - (LAW if baseline else CAUSE)
    return alone, alone if baseline else max(alone, 0.0)


def of_fit(found: Scored, free: tuple[float, float] = (0.0, 0.0)) -> float:
    """Utility (nats) of a fit over the nominal simulator. free: of free nominal parameters (`of_parameters`)."""
    alone, beside = free if found.free else (0.0, 0.0)
    if not found.causes:
        return alone
    own = utility(found.left_out, len(found.causes), found.numbers, penalty=found.penalty)
    return own + found.direct + beside


def beyond(left: float) -> float:
    """Probability that free nominal parameters alone are not the cause, by the share of the excess that they leave."""
    return _even_at_one(left / UNKNOWN_ABOVE)


def _even_at_one(ratio: float) -> float:
    """Probability of a fault by its size over the limit of a verdict without it: one half there."""
    return float(max(ratio, 0.0) ** 2 / (1 + ratio**2))


def by_causes(fits: Sequence[Scored], probabilities: Sequence[float]) -> dict[tuple[str, ...], float]:
    """Probability of each set of causes, summed over fixed and free fits and over forms; largest first."""
    out: dict[tuple[str, ...], float] = {}
    for f, p in zip(fits, probabilities, strict=True):
        key = _named(f)
        out[key] = out.get(key, 0.0) + p
    return dict(sorted(out.items(), key=lambda item: (-item[1], item[0])))


def with_lapse(sets: Mapping[tuple[str, ...], float], lapse: float = LAPSE) -> dict[tuple[str, ...], float]:
    """Probabilities of sets of causes with the lapse rate spread evenly; their order is unchanged.

    Source: Wichmann & Hill (2001), doi:10.3758/BF03194544, eq. 1.
    """
    return {causes: (1 - lapse) * p + lapse / len(sets) for causes, p in sets.items()}


def lapse_of(verdict: str, *, inexact: bool, worse: bool) -> float:
    """Lapse rate of an answer. inexact: no fit reaches the noise. worse: a named cause makes the gap larger in a
    regime."""
    if inexact and verdict in ("unknown", "none"):
        return LAPSE_INEXACT
    return LAPSE_WORSE if inexact and worse else LAPSE


def _named(f: Scored) -> tuple[str, ...]:
    return tuple(sorted(f.causes)) if f.causes or not f.free else ("parameters",)


def of_cause(sets: Mapping[tuple[str, ...], float]) -> dict[str, float]:
    """Marginal probability of each cause; largest first."""
    out: dict[str, float] = {}
    for causes, p in sets.items():
        for cause in causes or ("none",):
            out[cause] = out.get(cause, 0.0) + p
    return dict(sorted(out.items(), key=lambda item: (-item[1], item[0])))
