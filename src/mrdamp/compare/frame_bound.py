"""Clairvoyant commands of a frame's damper: searched for on the chain, evaluated in the bench's own engine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mrdamp.compare.beam import least
from mrdamp.compare.bench import UNCONTROLLED
from mrdamp.compare.clairvoyant import Path, Peaks, search
from mrdamp.compare.frame import FrameBench
from mrdamp.compare.rollouts import Rollouts
from mrdamp.control.passive import Replay
from mrdamp.envs.frame import Frame
from mrdamp.envs.frame_rows import FrameChain
from mrdamp.model import FLOOR_SENSOR_EFFECTS
from mrdamp.model.core import Array
from mrdamp.motions import GroundMotion
from mrdamp.simulation.rows import Stepping
from mrdamp.simulation.stepping import FrameRun

#: s, of the clairvoyant command at most.
PERIOD = 1e-3
#: s, of the chain. What a search makes small is within 0.3 % of what it is at a quarter of this step.
_STEP = 1e-3
#: Of the largest sample under the starts, what a search still looks at; what comes behind the last such sample keeps
#: the start's command.
_STILL = 0.4
_EXTRA = "passive-off"  # a start besides the given ones: far from all of them


def frame_bound(
    bench: FrameBench, starts: Mapping[str, Sequence[str]], load: GroundMotion, amplitude: float
) -> dict[str, Any]:
    """For `mrdamp.compare.bound`.

    The first bound is searched for from its starts and from passive-off, the others from what the first one found and
    from their starts but the best. None is worse than the best of its starts, whose run takes its place otherwise.
    """
    free = bench.history(UNCONTROLLED, load, amplitude)
    uncontrolled = bench.kept(UNCONTROLLED, free)
    period = min(bench.period, PERIOD)
    specs = dict.fromkeys([spec for some in starts.values() for spec in some] + [_EXTRA])
    runs = {spec: bench.history(spec, load, amplitude) for spec in specs}
    played = bench.played(load, amplitude)
    commands = {spec: _held_commands(run, period, played.duration) for spec, run in runs.items()}
    rollouts, peaks = frame_rollouts(bench, played, period), Scales(free)
    rollouts.periods = min(rollouts.periods, 1 + max(peaks.last(run, period) for run in runs.values()))
    out: dict[str, Any] = {}
    first: Path | None = None
    for name, weights in bench.bounds.items():
        own = starts[name]
        begin = {spec: commands[spec] for spec in (own if first is None else own[1:])}
        begin |= {_EXTRA: commands[_EXTRA]} if first is None else {next(iter(bench.bounds)): first.commands}
        paths = search(rollouts, list(begin.items()), peaks.objective(weights))
        first = first or paths[0]
        tail = commands.get(paths[0].name, commands[_EXTRA])
        found = np.concatenate([paths[0].commands, tail[len(paths[0].commands) :]])
        replay = bench.driven(Replay(found, period, name), load, amplitude)
        judged = [bench.values(bench.kept(name, run), uncontrolled) for run in (replay, runs[own[0]])]
        out[name] = {
            "values": least(judged, weights),
            "paths": [{"start": p.name, "values": p.values, "ended": p.ended} for p in paths],
        }
    return out


class Scales:
    """What the channels (drifts, accelerations) are taken over: the uncontrolled peaks, as J1 and J2."""

    def __init__(self, free: FrameRun) -> None:
        self.storeys = free.drift.shape[1]
        largest = np.abs(free.drift).max(), np.abs(free.acceleration).max()
        self.scale = np.repeat(largest, self.storeys)

    def objective(self, weights: Mapping[str, float]) -> Peaks:
        of = np.array([weights.get(key, 0.0) for key in ("J1", "J2")])
        return Peaks(of, self.scale, np.repeat([0, 1], self.storeys))

    def last(self, run: FrameRun, period: float) -> int:
        """The period after which no sample is large."""
        size = np.abs(np.hstack([run.drift, run.acceleration])) / self.scale
        for group in (slice(0, self.storeys), slice(self.storeys, None)):
            size[:, group] /= size[:, group].max()
        return int(np.ceil(run.time[np.flatnonzero(size.max(axis=1) >= _STILL)[-1]] / period))


def frame_rollouts(bench: FrameBench, played: GroundMotion, period: float) -> Rollouts:
    """On the chain, with the drifts and accelerations as channels."""
    ideal = tuple(e for e in bench.model.effects if e.place is None or e.name not in FLOOR_SENSOR_EFFECTS)
    model, largest = replace(bench.model, effects=ideal), np.array([bench.site.command_max])

    def make(n: int) -> FrameChain:
        return FrameChain(Frame(model), Stepping(period, min(period, _STEP), largest, n))

    names = make(1).names
    floors = range(1, bench.site.frame.storeys + 1)
    columns = [names.index(f"{what}_{j}") for what in ("drift", "acceleration") for j in floors]
    return Rollouts(make, played, columns, 0.0, float(largest[0]))


def _held_commands(run: FrameRun, period: float, duration: float) -> Array:
    """A run's commands (n,) at a period (s), held as they were."""
    time = period * np.arange(int(np.floor(duration / period + 1e-9)) + 1)
    at = np.searchsorted(run.time, time + 1e-9, side="right") - 1
    return np.asarray(run.command[at])
