"""From fits to an answer: evidence of each set of causes, probabilities, and the verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.diagnosis.constants import (
    CAUSE_PENALTY,
    EQUALLY,
    FLOOR_RESOLUTION,
    FREE_PENALTY,
    INDEPENDENT,
    LAPSE,
    LAPSE_NONE,
    LAPSE_UNKNOWN,
    LAPSE_WORSE,
    LAW_PENALTY,
    LOGIT_TEMPER,
    MOVE,
    MOVE_PENALTY,
    NONE_ABOVE,
    NUMBER_PENALTY,
    OUTSIDE_PENALTY,
    REDUCIBLE,
    RESOLUTION,
    STEEPNESS,
    UNKNOWN_ABOVE,
    UNSTEADY,
    WRONG_FORM,
)
from mrdamp.diagnosis.evidence.established import Standing, softmax, standing, utility
from mrdamp.model.core import Array


@dataclass(frozen=True)
class Scored:
    """A fitted set of causes and its evidence.

    cost: sum of squared residuals. numbers: number of free coordinates of its effects. index: place in the
    list of fits. penalty: nats against it. move: RMS of the relative changes of the nominal parameters.
    direct: nats for its causes from channels that measure the same quantity. left_out: share that it leaves of the
    left-out squares of the simulator without its causes.
    """

    causes: tuple[str, ...]
    free: bool
    cost: float
    numbers: int
    index: int = -1
    penalty: float = 0.0
    move: float = 0.0
    direct: float = 0.0
    left_out: float = 1.0


@dataclass(frozen=True)
class Decision:
    """The verdict and the fit behind it.

    probabilities: of each fit in order. unexplained: share of the excess that the chosen fit leaves. floor:
    cost of the noise. unknown: probability that the cause is not in the catalogue; the others share the rest.
    outside: index of the rival that explains the gap better than the catalogue, or None. apart: channels of
    one quantity differ and nothing in the catalogue explains it, so that no cause may be named for it.
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


def decide(
    fits: Sequence[Scored],
    floor: float,
    rivals: Sequence[Scored] = (),
    *,
    steady: bool = True,
    inexact: bool = False,
    own: float = 0.0,
) -> Decision:
    """The verdict over fits, one of which is the nominal simulator (no causes, not free).

    floor: cost of the noise. rivals: fits of causes outside the catalogue; if one of them has more evidence
    than all sets of the catalogue, the answer is `unknown` and the chosen fit is the catalogue's best. It is named as
    a hint if it leaves no more than that.
    steady: False if two runs of one test differ by more than their noise, which neither `none` nor
    `parameters` explains. inexact: no fit comes near the noise, so that a cause has to be established against
    every other explanation. own: cost of the nominal simulator on the rig's baseline, if there is one; a gap
    up to this size is none.
    """
    nominal = next(f for f in fits if not f.causes and not f.free)
    least = min(f.cost for f in fits)
    # The least cost of any fit counts as noise, up to a limit: it contains inter-sample motion and initial
    # states.
    floor = min(max(least, floor), NONE_ABOVE**2 / 2 * floor)
    excess = max(nominal.cost - floor, 1e-12)
    resolution = RESOLUTION + FLOOR_RESOLUTION * floor / excess

    def evidence(some: Sequence[Scored]) -> Array:
        if inexact:
            return np.array([_utility(f, baseline=own > 0) for f in some])
        return np.array([_evidence(f, floor, excess, resolution) for f in some])

    scores = evidence(fits)
    probabilities = tuple(float(p) for p in softmax(scores))
    # The answer is the most probable set of causes over all its forms, in its best form.
    known = by_causes(fits, probabilities)
    found = standing(known) if inexact else None
    likely = _simplest(known)
    if found is not None:
        likely = _fitted_with(known, found.causes) if found.probability > 0.5 else _without_cause(known)
    chosen = fits[max((k for k, f in enumerate(fits) if _named(f) == likely), key=lambda k: float(scores[k]))]
    left = max(chosen.cost - floor, 0.0) / excess
    if steady and nominal.cost <= NONE_ABOVE * floor and least >= (1 - REDUCIBLE) * nominal.cost:
        return Decision("none", nominal, probabilities, 1.0, floor, excess)
    if not chosen.causes and not chosen.free:
        left = 1.0
    unknown = beyond(left, excess, floor, causes=bool(chosen.causes))
    if inexact:
        # The unchanged nominal simulator is the alternative "no cause".
        unknown = probabilities[fits.index(nominal)]
        if not chosen.causes:
            unknown = max(unknown, _without(chosen, left))
    other = evidence(rivals) - OUTSIDE_PENALTY
    outside = None
    if len(other):
        mass = float(np.sum(np.exp(other - scores.max())))
        rival = mass / (mass + float(np.sum(np.exp(scores - scores.max()))))
        unknown = rival + (1 - rival) * unknown
        nearest = rivals[int(np.argmax(other))]
        if rival > 0.5 and nearest.cost <= chosen.cost:
            outside = nearest.index
    decided = unknown
    if inexact:
        probabilities, unknown = _stated(scores, other, fits.index(nominal))
        if not chosen.causes:
            unknown = max(unknown, decided)
    if (
        steady
        and outside is None
        and nominal.cost <= NONE_ABOVE * floor
        and not (chosen.causes or chosen.free)
    ):
        # Free parameters fit some of the noise of few records; a reduction below its penalty is no gap.
        return Decision("none", nominal, probabilities, 1.0, floor, excess)
    if not steady and not chosen.causes:
        decided = unknown = max(unknown, UNSTEADY)
    if outside is not None or decided > (0.5 if inexact else (1 - unknown) * known[likely]):
        verdict = "unknown"
    else:
        verdict = "effect" if chosen.causes else "parameters"
    if verdict != "effect" and outside is None and nominal.cost <= NONE_ABOVE * own:
        return Decision("none", nominal, probabilities, 1.0, floor, excess)
    return Decision(verdict, chosen, probabilities, left, floor, excess, unknown, outside, found)


def _stated(scores: Array, other: Array, nominal: int) -> tuple[tuple[float, ...], float]:
    """Stated probabilities of the fits and of an unknown cause, from tempered utilities of fits and rivals.

    The nominal simulator (index `nominal`) is excluded. Source: Guo et al. (2017), On calibration of modern
    neural networks (temperature scaling).
    """
    stated = softmax(np.concatenate([scores, other]) / LOGIT_TEMPER)
    unknown = float(stated[nominal] + np.sum(stated[len(scores) :]))
    own = stated[: len(scores)].copy()
    own[nominal] = 0.0
    return tuple(float(p) for p in own / max(own.sum(), 1e-300)), unknown


def _simplest(known: Mapping[tuple[str, ...], float]) -> tuple[str, ...]:
    """The most probable set of causes, or a part of it that is at least EQUALLY times as probable."""
    likely = next(iter(known))
    parts = [s for s, p in known.items() if s and set(s) < set(likely) and p >= EQUALLY * known[likely]]
    return parts[0] if parts else likely


def _fitted_with(known: Mapping[tuple[str, ...], float], causes: tuple[str, ...]) -> tuple[str, ...]:
    """The set of causes as fitted: the most probable one that contains them if they were not fitted alone."""
    wanted = set(causes)
    return next((s for s in known if set(s) == wanted), None) or next(s for s in known if wanted <= set(s))


def _without_cause(known: Mapping[tuple[str, ...], float]) -> tuple[str, ...]:
    none: tuple[tuple[str, ...], ...] = ((), ("parameters",))
    return max(none, key=lambda k: known.get(k, 0.0))


def _without(chosen: Scored, left: float) -> float:
    """Probability of an unknown cause if no fit reaches the noise and no cause is established: free
    parameters are the answer in proportion to what they explain."""
    return beyond(left, 1.0, 1.0, causes=True) if chosen.free else UNSTEADY


def _utility(found: Scored, *, baseline: bool) -> float:
    """Utility (nats) of a fit over the simulator without its causes, if the law is not the rig's. baseline: its
    parameters are those of the baseline; a change of them is a cause of its own."""
    if not found.causes and not found.free:
        return 0.0
    law = found.free and (baseline or not found.causes)
    own = utility(found.left_out, len(found.causes), found.numbers, law=law, penalty=found.penalty)
    return own + found.direct


def beyond(left: float, excess: float, floor: float, *, causes: bool) -> float:
    """Probability that the best fit is not the cause, by the share of the excess that it leaves and, without
    causes, by the ratio to the noise floor."""
    ratio = left / UNKNOWN_ABOVE
    if not causes:
        ratio = max(ratio, left * excess / (WRONG_FORM * floor))
    return float(ratio**STEEPNESS / (1 + ratio**STEEPNESS))


def _evidence(found: Scored, floor: float, excess: float, resolution: float) -> float:
    left = max(found.cost - floor, 0.0) / excess
    freed = _free_penalty(found.move) if found.causes else LAW_PENALTY
    penalty = (
        freed * found.free + CAUSE_PENALTY * len(found.causes) + NUMBER_PENALTY * found.numbers + found.penalty
    )
    return -0.5 * INDEPENDENT * math.log(left + resolution) - penalty + found.direct


def _free_penalty(move: float) -> float:
    """Penalty of free nominal parameters with a cause, by the size of their change."""
    return FREE_PENALTY + MOVE_PENALTY * min(move / MOVE, 1.0)


def idle_penalty(move: float) -> float:
    """Difference between the penalties of free nominal parameters alone and with a cause. If the cause
    explains nothing beyond the free parameters, these carry their full penalty."""
    return max(LAW_PENALTY - _free_penalty(move), 0.0)


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
    if not inexact:
        return LAPSE
    if verdict == "effect":
        return LAPSE_WORSE if worse else LAPSE
    return {"unknown": LAPSE_UNKNOWN, "none": LAPSE_NONE}.get(verdict, LAPSE)


def _named(f: Scored) -> tuple[str, ...]:
    return tuple(sorted(f.causes)) if f.causes or not f.free else ("parameters",)


def of_cause(sets: Mapping[tuple[str, ...], float]) -> dict[str, float]:
    """Marginal probability of each cause; largest first."""
    out: dict[str, float] = {}
    for causes, p in sets.items():
        for cause in causes or ("none",):
            out[cause] = out.get(cause, 0.0) + p
    return dict(sorted(out.items(), key=lambda item: (-item[1], item[0])))


def shapley(costs: Mapping[frozenset[str], float], causes: Sequence[str]) -> dict[str, float]:
    """Shapley share of each cause in the reduction of the cost, averaged over the orders of adding.

    costs: by set of causes, including the empty one; a set that was not fitted counts as the best of its
    subsets.
    """

    def cost(members: frozenset[str]) -> float:
        return min(value for key, value in costs.items() if key <= members)

    out = dict.fromkeys(causes, 0.0)
    n = len(causes)
    for cause in causes:
        others = [c for c in causes if c != cause]
        for bits in range(2 ** len(others)):
            inside = frozenset(c for k, c in enumerate(others) if bits >> k & 1)
            weight = math.factorial(len(inside)) * math.factorial(n - len(inside) - 1) / math.factorial(n)
            out[cause] += weight * (cost(inside) - cost(inside | {cause}))
    return out
