"""Noise floor of every block of residuals, from repeated tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.constants import INEXACT
from mrdamp.diagnosis.hypotheses.terms import Settings
from mrdamp.diagnosis.problem.residuals import Problem, compared
from mrdamp.diagnosis.problem.rig import Rig
from mrdamp.model.core import Array
from mrdamp.records.smoothing import noise_level

#: Gap due to noise at which a block's weight is 0.7; model errors are of this size.
_CLEAR = 0.012


@dataclass(frozen=True)
class Noise:
    """Standard deviation of each channel's noise (channels,), in its unit, and its source.

    steady: False if two runs of one test differ by more than their noise.
    """

    levels: Array
    source: str  # "repeat" or "high band"
    steady: bool = True


def channel_noise(
    case: Case, rig: Rig, block: int = 1, averaged: Case | None = None
) -> tuple[Noise, list[str]]:
    """Noise from the repeats or, without any, from the fifth differences, which vanish for smooth signals; and notes on
    what does not repeat.

    The difference of two runs contains the noise of both; its mean square is halved. A constant difference (an offset
    that drifts between tests) counts as noise, any other change beyond the high band as a gap. case: as measured.
    averaged: the case over blocks of so many samples, if the rig has these; their high band would contain the motion.
    """
    white = np.array([np.median([noise_level(r.channel(name)) for r in case.records]) for name in rig.channels])
    white /= np.sqrt(block)
    compare = averaged or case
    pairs = [(compare.records[k], r) for r, k in compare.repeats if k is not None]
    if not pairs:
        return Noise(white, "high band"), []
    levels, notes = white.copy(), []
    for c, name in enumerate(rig.channels):
        apart = [(a.channel(name) - b.channel(name))[compared(a.n, a.sample_time)] for a, b in pairs]
        varying = float(np.mean([np.var(d) / 2 for d in apart]))
        if varying > INEXACT * white[c] ** 2 > 0:
            ratio = np.sqrt(varying) / white[c]
            notes.append(
                f"{name} does not repeat: two runs of one test differ by {ratio:.1f} times its noise"
            )
        else:
            levels[c] = np.sqrt(np.mean([np.mean(d**2) / 2 for d in apart]))
    return Noise(levels, "repeat", not notes), notes


def floors(problem: Problem, noise: Noise, settings: Settings) -> Array:
    """Gap (blocks,) due to noise alone: of the outputs, and of the inputs propagated through the simulator.
    """
    carried = {k: problem.rig.input_noise(settings, k) for k in problem.records}
    share = problem.rig.noise_shares
    return np.array(
        [
            np.hypot(share[b.record, b.channel] * noise.levels[b.channel], carried[b.record][b.channel]) / b.size
            for b in problem.blocks
        ]
    )


def trust(problem: Problem, floor: Array) -> dict[tuple[int, int], float]:
    """Weight of each block, by (record, channel): it decreases with the share of noise. floor (blocks,): gaps
    due to noise."""
    counts = 1 / np.hypot(1.0, floor / _CLEAR)
    return {(b.record, b.channel): float(c) for b, c in zip(problem.blocks, counts, strict=True)}


def baseline_gap(problem: Problem | None, rig: Rig) -> Array:
    """(channels,) RMS gap of the nominal simulator on the baseline's records; 0 without any."""
    if problem is None:
        return np.zeros(len(rig.channels))
    gaps = problem.gaps(problem.nominal())
    channel = np.array([b.channel for b in problem.blocks])
    return np.array([np.sqrt(np.mean(gaps[channel == c] ** 2)) for c in range(len(rig.channels))])


def own_cost(problem: Problem, base: Array) -> float:
    """Cost that corresponds to gaps (channels,) of the rig's baseline."""
    return problem.cost(np.array([base[b.channel] for b in problem.blocks]))
