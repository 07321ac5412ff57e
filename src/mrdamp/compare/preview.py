"""What a forecast of the ground motion is worth: receding-horizon commands of a frame with a part of it known."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp.compare.bench import UNCONTROLLED
from mrdamp.compare.comparison import Comparison
from mrdamp.compare.contenders import Contender
from mrdamp.compare.frame import FrameBench
from mrdamp.compare.frame_bound import PERIOD, Scales, frame_rollouts
from mrdamp.compare.receding import Receding
from mrdamp.compare.runner import Progress, run_all
from mrdamp.control.replay import Replay
from mrdamp.motions import GroundMotion

_VERSION = 1  # of the plans
#: s between two plans over the time known ahead, and periods of a block and blocks between two plans at most.
_BETWEEN, _MOST = 0.15, 6
_STARTS = "passive-on", "passive-off"  # runs that tell how long a motion is strong


@dataclass(frozen=True)
class Known:
    """A motion of which `seconds` ahead are known, in the frame's own time."""

    load: GroundMotion
    amplitude: float
    seconds: float


@dataclass(frozen=True)
class Plans:
    """Runs with plans on a bench, for `run_all`."""

    bench: FrameBench

    def key(self, task: Known) -> str:
        own = self.bench.key("passive-on", task.load, task.amplitude)
        return hashlib.sha256(
            json.dumps([_VERSION, asdict(receding(task.seconds)), own]).encode()
        ).hexdigest()[:32]

    def run(self, task: Known) -> dict[str, Any]:
        """Every measure of the commands in the bench's engine."""
        bench, load, amplitude = self.bench, task.load, task.amplitude
        free = bench.history(UNCONTROLLED, load, amplitude)
        played, period = bench.played(load, amplitude), min(bench.period, PERIOD)
        rollouts, scales = frame_rollouts(bench, played, period), Scales(free)
        runs = [bench.history(spec, load, amplitude) for spec in _STARTS]
        rollouts.periods = min(rollouts.periods, 1 + max(scales.last(run, period) for run in runs))
        found = receding(task.seconds).commands(
            rollouts, scales.objective(bench.bounds["clairvoyant"]), period
        )
        whole = np.zeros(int(np.floor(played.duration / period + 1e-9)) + 1)
        whole[: len(found)] = found[: len(whole)]
        replay = bench.driven(Replay(whole, period, row_name(task.seconds)), load, amplitude)
        values = bench.values(bench.kept(row_name(task.seconds), replay), bench.kept(UNCONTROLLED, free))
        return {"values": dict(values)}


def receding(seconds: float) -> Receding:
    """Plans for so much known ahead."""
    given = Receding(seconds)
    between = given.effort.holds[0] * PERIOD
    return replace(given, blocks=int(np.clip(round(_BETWEEN * seconds / between), 1, _MOST)))


def row_name(seconds: float) -> str:
    """Of the row of a comparison."""
    return f"known-{seconds:g}"


def with_previews(
    bench: FrameBench,
    result: Comparison,
    loads: Sequence[GroundMotion],
    seconds: Sequence[float],
    *,
    jobs: int = 1,
    keep: Path | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """A comparison with a row for each time that the motion is known ahead. jobs, keep: see `run_all`."""
    cases = list(itertools.product(loads, result.amplitudes))
    shape = 1, len(loads), len(result.amplitudes)
    values = dict(result.values)
    for known in seconds:
        tasks = [Known(load, amplitude, known) for load, amplitude in cases]
        found = run_all(
            Plans(bench), tasks, jobs=jobs, keep=keep, progress=progress, what=f"{known:g} s known"
        )
        values[row_name(known)] = {
            m.key: np.array([f["values"][m.key] for f in found]).reshape(shape) for m in bench.measures
        }
    rows = tuple(Contender(row_name(k), (row_name(k),), bound=True) for k in seconds)
    return replace(result, contenders=(*result.contenders, *rows), values=values)
