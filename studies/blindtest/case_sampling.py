"""Composition of a blind test: single effects, pairs, weak effects, no gap, wrong parameters, unknown causes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from studies.blindtest import causes, unknown
from studies.blindtest.sizing import OWN, Task

#: Shares of the cases of a rig.
_SHARES = {"single": 0.5, "pair": 0.16, "weak": 0.08, "none": 0.07, "parameters": 0.08, "unknown": 0.11}
#: The same if the law is not the rig's: one case in five has no other cause.
_MISFIT_SHARES = {"single": 0.58, "weak": 0.1, "own": 0.2, "unknown": 0.12}
#: Share of the frame among all cases.
_FRAMES = 0.25
#: Pairs of one mechanism, or in which one effect always hides the other.
_NOT_TOGETHER = (
    {"gas_spring", "sensor_offset"},
    {"channel_shift", "sensor_lag"},
    {"driver_lag", "command_delay"},
)


def draw(seed: np.random.SeedSequence, count: int, rig: str = "both", *, misfit: bool = False) -> list[Task]:
    """`count` tasks in random order, with names that do not depend on their content.

    rig: `damper`, `frame` or `both`. misfit: the law is not the rig's.
    """
    rng = np.random.default_rng(seed)
    frames = {"damper": 0, "frame": count, "both": round(_FRAMES * count)}[rig]
    tasks = [*_rig(rng, "damper", count - frames, misfit), *_rig(rng, "frame", frames, misfit)]
    order = rng.permutation(len(tasks))
    named = [tasks[k] for k in order]
    return [Task(f"case_{k:03d}", t.rig, t.label, t.weak, t.misfit) for k, t in enumerate(named, 1)]


def _rig(rng: np.random.Generator, rig: str, count: int, misfit: bool) -> list[Task]:
    from studies.blindtest import frame_causes

    singles = list(causes.EFFECTS) if rig == "damper" else frame_causes.labels()
    groups = unknown.GROUPS if rig == "damper" else frame_causes.GROUPS
    pools: dict[str, list[str]] = {
        "single": singles,
        "pair": _pairs(singles),
        "weak": singles,
        "none": ["none"],
        "parameters": ["parameters"],
        "own": [OWN],
    }
    tasks = []
    for kind, number in _apportioned(count, _MISFIT_SHARES if misfit else _SHARES).items():
        labels = _outside(rng, groups, number) if kind == "unknown" else _without_repetition(rng, pools[kind], number)
        tasks += [Task("", rig, label, kind == "weak", misfit) for label in labels]
    return tasks


def _outside(rng: np.random.Generator, groups: Sequence[Sequence[str]], number: int) -> list[str]:
    """Causes outside the catalogue, alternating between both groups."""
    orders = [_without_repetition(rng, group, number) for group in groups]
    first = int(rng.integers(2))
    return [f"~{orders[(first + k) % 2][k // 2]}" for k in range(number)]


def _apportioned(count: int, shares: Mapping[str, float]) -> dict[str, int]:
    """Whole numbers by the largest-remainder method."""
    exact = {kind: share * count for kind, share in shares.items()}
    whole = {kind: int(value) for kind, value in exact.items()}
    rest = sorted(exact, key=lambda kind: whole[kind] - exact[kind])
    for kind in rest[: count - sum(whole.values())]:
        whole[kind] += 1
    return whole


def _without_repetition(rng: np.random.Generator, pool: Sequence[str], number: int) -> list[str]:
    """Labels from the pool; none is repeated before all have occurred."""
    out: list[str] = []
    while len(out) < number:
        out += [pool[k] for k in rng.permutation(len(pool))]
    return out[:number]


def _pairs(singles: Sequence[str]) -> list[str]:
    """Pairs of effects from different stages."""

    def stage(label: str) -> str:
        name = label.partition("@")[0]
        return causes.EFFECTS[name][0] if name in causes.EFFECTS else "structure"

    pairs = [(a, b) for a, b in combinations(singles, 2) if stage(a) != stage(b)]
    return [f"{a}+{b}" for a, b in pairs if {a.partition("@")[0], b.partition("@")[0]} not in _NOT_TOGETHER]
