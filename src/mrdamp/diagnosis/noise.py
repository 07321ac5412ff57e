"""What two runs of one test differ by: the noise floor of every block of residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrdamp.core import Array
from mrdamp.diagnosis.case import Case
from mrdamp.diagnosis.problem import SKIP, Problem
from mrdamp.diagnosis.rig import Rig
from mrdamp.diagnosis.smoothing import noise_level
from mrdamp.diagnosis.terms import Settings

#: Gap of noise at which a block counts 0.7: errors of form are of this size.
_CLEAR = 0.012


@dataclass(frozen=True)
class Noise:
    """Standard deviation of each channel's noise (channels,), in its unit, and where it is known from."""

    levels: Array
    source: str  # "repeat" or "high band"


def channel_noise(case: Case, rig: Rig) -> Noise:
    """From the repeats where there are any, else from what no smooth signal holds: the fifth differences.

    Two runs differ by both their noises; the mean square is halved. A constant difference (an offset that drifts
    between tests) counts as noise.
    """
    pairs = [(case.records[k], r) for r, k in case.repeats if k is not None]
    levels = np.empty(len(rig.channels))
    for c, name in enumerate(rig.channels):
        if pairs:
            squares = []
            for first, second in pairs:
                skip = round(SKIP / first.sample_time)
                squares.append(np.mean((first.channel(name) - second.channel(name))[skip:] ** 2) / 2)
            levels[c] = np.sqrt(np.mean(squares))
        else:
            levels[c] = np.median([noise_level(r.channel(name)) for r in case.records])
    return Noise(levels, "repeat" if pairs else "high band")


def floors(problem: Problem, noise: Noise, settings: Settings) -> Array:
    """Gap (blocks,) that the noise alone leaves: the outputs' own, and the inputs' carried through the simulator."""
    carried = {k: problem.rig.input_noise(settings, k) for k in problem.records}
    return np.array(
        [np.hypot(noise.levels[b.channel], carried[b.record][b.channel]) / b.size for b in problem.blocks]
    )


def trust(problem: Problem, floor: Array) -> dict[tuple[int, int], float]:
    """What each block counts, by (record, channel): less, the more of it is noise (floor (blocks,), as gaps)."""
    counts = 1 / np.hypot(1.0, floor / _CLEAR)
    return {(b.record, b.channel): float(c) for b, c in zip(problem.blocks, counts, strict=True)}
