"""Whether the rig holds its command between samples, where neither the case nor the log says.

A converter holds a command until the next sample; read along lines it comes half a sample early, and a delay of half a
sample looks almost like it. Both readings are compared with the responses, each with a delay and a lag of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.hypotheses.terms import Settings
from mrdamp.diagnosis.problem.make import make_rig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array
from mrdamp.records.log_filter import held as is_held
from mrdamp.records.log_filter import rings_before_jumps

#: Delays and time constants from which the best ones are sought, in samples.
_SAMPLES = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0)
#: Parts of each record's channel whose squared errors are compared, and standard errors from which they differ.
_PARTS, _CLEAR = 10, 3.0
#: Samples of a delay along lines that is a held command where the two readings are no further apart.
_HALF = 0.25, 0.75


def with_hold(
    case: Case, threads: int = 1, settings: Mapping[str, float] | None = None
) -> tuple[Case, list[str]]:
    """The case with the reading of the command that its responses show, and notes on it.

    settings: of the simulator, in addition to its own. Unchanged where the case says it, where no command varies and
    where jumps show a log's filter. Along lines, with a note, where the responses do not show it: the simulator that is
    handed over is then read as it was fitted. A command that jumps between constants is held unless lines are clearly
    better.
    """
    commands = [np.asarray(r.command) for r in case.records]
    varying = tuple(r for r, u in zip(case.records, commands, strict=True) if np.ptp(u) > 0)
    if case.model.hold is not None or not varying or any(map(rings_before_jumps, commands)):
        return case, []
    along, held = (replace(case, model=case.model.with_hold(hold)) for hold in (False, True))
    dt = max(r.sample_time for r in varying)
    both = [_best(replace(one, records=varying), dt, threads, settings or {}) for one in (along, held)]
    (lines, late), (steps, _) = both
    apart = lines - steps
    clear = float(np.mean(apart)) / max(float(np.std(apart, ddof=1)) / np.sqrt(len(apart)), 1e-300)
    if clear > _CLEAR:
        share = float(np.sqrt(np.sum(steps) / np.sum(lines)))
        return held, [
            f"the command is held between samples: {share:.2f} times the error of lines between them"
        ]
    if clear > -_CLEAR and _HALF[0] < late / dt < _HALF[1]:
        return held, [
            "the command is taken as held between samples, which fits as well as a delay of half a sample"
        ]
    if clear < -_CLEAR:
        return along, []
    if all(is_held(u) for u in commands if np.ptp(u) > 0):
        return held, ["the command jumps between constants: it is taken as held between samples"]
    return along, [
        "the records do not show whether the command is held between samples; it is read along lines, and held a"
        f" delay would be {5e2 * dt:.3g} ms shorter; 'hold' in case.json says which"
    ]


def _best(case: Case, sample_time: float, threads: int, settings: Mapping[str, float]) -> tuple[Array, float]:
    """Squared errors (parts,) with the best delay of the command beyond the simulator's and the best further lag, which
    smears jumps as lines do, and this delay (s)."""
    problem = Problem(make_rig(case, threads))
    names = ("command_delay_d", "driver_lag_tau2")
    own = [settings.get(name, case.model.attributes.get(name, 0.0)) for name in names]

    def residual(points: Sequence[Sequence[float]]) -> Array:
        """Of delays and time constants in samples (points, 2)."""
        tried: list[Settings] = [
            {**settings, **{n: o + sample_time * x for n, o, x in zip(names, own, q, strict=True) if x}} for q in points
        ]
        return problem.of_settings(tried)

    best = [0.0, 0.0]
    for k in (0, 1, 0):
        def along(x: float, k: int = k) -> list[float]:
            return [x, best[1]] if k == 0 else [best[0], x]

        costs = np.sum(residual([along(x) for x in _SAMPLES]) ** 2, axis=1)
        at = int(np.argmin(costs))
        found = minimize_scalar(
            lambda x: float(np.sum(residual([along(float(x))]) ** 2)),
            bounds=(_SAMPLES[max(at - 1, 0)], _SAMPLES[min(at + 1, len(_SAMPLES) - 1)]),
            method="bounded",
            options={"xatol": 0.02, "maxiter": 12},
        )
        best[k] = float(found.x) if found.fun < costs[at] else _SAMPLES[at]
    rest = residual([best])[0]
    parts = [part for b in problem.blocks for part in np.array_split(rest[b.span], _PARTS)]
    return np.array([float(np.sum(part**2)) for part in parts]), sample_time * best[0]
