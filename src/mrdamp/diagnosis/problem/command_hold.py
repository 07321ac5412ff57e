"""Whether the rig holds its command between samples, where neither the case nor the log says.

A converter holds a command until the next sample; read along lines it comes half a sample early, and a delay of half a
sample looks almost like it. Both readings are compared with the responses, each with a delay of its own.
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

#: Delays from which the best one is sought, in samples.
_DELAYS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0)
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
    better with `settings` too: a lag that the simulator lacks smears its jumps.
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
    jumps = all(is_held(u) for u in commands if np.ptp(u) > 0)
    if clear < -_CLEAR and (settings or not jumps):
        return along, []
    if jumps:
        return held, ["the command jumps between constants: it is taken as held between samples"]
    return along, [
        "the records do not show whether the command is held between samples; it is read along lines, and held a"
        f" delay would be {5e2 * dt:.3g} ms shorter; 'hold' in case.json says which"
    ]


def _best(case: Case, sample_time: float, threads: int, settings: Mapping[str, float]) -> tuple[Array, float]:
    """Squared errors (parts,) with the best delay of the command beyond the simulator's, and this delay (s)."""
    problem = Problem(make_rig(case, threads))
    own = settings.get("command_delay_d", case.model.attributes.get("command_delay_d", 0.0))

    def residual(delays: Sequence[float]) -> Array:
        tried: list[Settings] = [
            {**settings, **({"command_delay_d": own + sample_time * d} if d else {})} for d in delays
        ]
        return problem.of_settings(tried)

    costs = np.sum(residual(_DELAYS) ** 2, axis=1)
    k = int(np.argmin(costs))
    found = minimize_scalar(
        lambda d: float(np.sum(residual([float(d)]) ** 2)),
        bounds=(_DELAYS[max(k - 1, 0)], _DELAYS[min(k + 1, len(_DELAYS) - 1)]),
        method="bounded",
        options={"xatol": 0.02, "maxiter": 12},
    )
    best = float(found.x) if found.fun < costs[k] else _DELAYS[k]
    at = residual([best])[0]
    parts = [part for b in problem.blocks for part in np.array_split(at[b.span], _PARTS)]
    return np.array([float(np.sum(part**2)) for part in parts]), sample_time * best
