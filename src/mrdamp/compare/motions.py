"""Ground motions for tuning and for evaluation of controllers; no motion is in both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mrdamp.errors import InputError
from mrdamp.files import SUFFIXES, files_in
from mrdamp.motions import GroundMotion, kanai_tajimi, read_motion

PEAK = 3.4  # m/s2, of every synthetic motion at amplitude 1

UNSEEN_AMPLITUDES = (0.4, 1.0, 1.6)

#: Of a recorded motion: the mean over the peak at most, and the peak, m/s2. The largest on record is about 40.
_MEAN, _PEAK = 0.5, 50.0


@dataclass(frozen=True)
class Soil:
    """Clough-Penzien ground: frequency, rad/s, and damping ratio; the second filter is a tenth of the frequency."""

    name: str
    frequency: float
    damping: float


SOILS = (Soil("firm", 15.6, 0.6), Soil("medium", 10.0, 0.4), Soil("soft", 5.0, 0.3))
#: Seeds from nine million on are for judging alone; the embedded motion is one that policies are trained on.
_UNSEEN = ((9_000_001, 0), (9_000_002, 1), (9_000_003, 1), (9_000_004, 2), (9_000_005, 0), (9_000_006, 0))
_TUNING = ((101, 0), (102, 1), (103, 2))


def unseen_motions() -> tuple[GroundMotion, ...]:
    """Six motions on three soils, peak 3.4 m/s2, at full size's speed."""
    return tuple(synthetic(seed, SOILS[k]) for seed, k in _UNSEEN)


def tuning_motions() -> tuple[GroundMotion, ...]:
    """Three motions, one a soil, with seeds that no unseen motion has."""
    return tuple(synthetic(seed, SOILS[k]) for seed, k in _TUNING)


def synthetic(seed: int, soil: Soil) -> GroundMotion:
    """25 s of filtered noise on a soil, peak 3.4 m/s2 (`mrdamp.motions.kanai_tajimi`)."""
    motion = kanai_tajimi(
        seed, pga=PEAK, ground_frequency=soil.frequency, ground_damping=soil.damping,
        filter_frequency=0.1 * soil.frequency,
    )  # fmt: skip
    return replace(motion, name=f"{soil.name}_{seed}")


def read_motions(paths: Sequence[Path | str]) -> tuple[GroundMotion, ...]:
    """Motions of files, or of every .csv, .csv.gz and .AT2 in a folder; names are made different.

    Raises InputError where there is none, or one of zeros.
    """
    motions: list[GroundMotion] = []
    for file in (f for path in paths for f in files_in(Path(path), (*SUFFIXES, ".at2"))):
        motion = read_motion(file)
        if not motion.acceleration.any():
            raise InputError(f"{file}: the motion is zero throughout; there is nothing to control")
        taken = sum(m.name.split("#")[0] == motion.name for m in motions)
        motions.append(replace(motion, name=f"{motion.name}#{taken + 1}") if taken else motion)
    return tuple(motions)


def doubtful(motion: GroundMotion) -> list[str]:
    """What is likely a mistake of a recorded motion: a line each."""
    mean, peak = float(np.mean(motion.acceleration)), motion.pga
    found = []
    if abs(mean) > _MEAN * peak:
        found.append(f"{motion.name}: its mean is {mean:.3g} m/s2, its peak {peak:.3g}; take an offset out")
    if peak > _PEAK:
        found.append(f"{motion.name}: its peak is {peak:.3g} m/s2; usual are up to {_PEAK:g}: motions are in m/s2")
    return found
