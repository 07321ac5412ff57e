"""The best command sequence for a motion that is known in advance, by sequential linear programming on the chain.

Around a sequence the run is linearised by differences of the chain's own steps (`mrdamp.compare.rollouts`): what every
command adds to every near-peak. A linear programme finds the change within a trust region that makes the largest peaks
smallest. Of fractions of that change the best is kept, by simulation: sequential linear programming for a minimax
problem. It ends in a local optimum: what it finds can be reached, and the true optimum is as good or better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from mrdamp.compare.rollouts import Rollouts, sensitivity
from mrdamp.errors import InputError
from mrdamp.model.core import Array

Whole = NDArray[np.intp]

#: Fractions of a change that are tried by simulation.
_FRACTIONS = np.array([1.0, 0.5, 0.25, 0.12, 0.06, 0.03])


@dataclass(frozen=True)
class Effort:
    """holds: periods that a command is held over, one search after the other; horizon: periods before a peak in which
    commands are changed for it; near: share of its group's peak from which on a sample counts as a near-peak; most:
    steps of a search; trust: largest change of a command at first, least: where a search ends, both over its range;
    gain: of a step over the value, below which `patience` steps in a row end a search."""

    holds: tuple[int, ...] = (8, 4)
    horizon: int = 500
    near: float = 0.7
    most: int = 12
    trust: float = 0.3
    least: float = 5e-3
    gain: float = 1e-3
    patience: int = 3


@dataclass(frozen=True)
class Peaks:
    """What is made small: the sum over groups of a weight times the largest |channel| / scale of the group.

    weights (groups,); scale (channels,); group (channels,) of each channel.
    """

    weights: Array
    scale: Array
    group: Whole

    def value(self, y: Array) -> Array:
        """(n,) of channels (n, periods, channels)."""
        largest = np.abs(y).max(axis=1) / self.scale
        return np.asarray(
            sum(w * largest[:, self.group == g].max(axis=1) for g, w in enumerate(self.weights) if w > 0)
        )

    def near(self, y: Array, share: float, apart: int) -> tuple[Whole, Whole]:
        """Period and channel (m,) of samples of y (periods, channels) that are at least a share of their group's peak.

        Local peaks, and one in `apart` of the others. Periods do not decrease.
        """
        size = np.abs(y) / self.scale
        largest = np.array([size[:, self.group == g].max() for g in range(len(self.weights))])[self.group]
        counts = (self.weights[self.group] > 0) & (size >= share * largest)
        padded = np.pad(size, ((1, 1), (0, 0)))
        top = (size >= padded[:-2]) & (size >= padded[2:])
        top[::apart] = True
        counts[0] = False  # no command comes before it
        period, channel = np.nonzero(counts & top)
        return period, channel


@dataclass
class Path:
    """A search from one start. name: of the start; commands (periods,) and value: the best so far; values: after every
    step, that of the start first; ended: why it stopped.

    Where it stands: held (blocks,), the commands; present, their value; now, channels and states of their run; trust.
    """

    name: str
    commands: Array
    value: float
    values: list[float]
    ended: str = ""
    block_commands: Array = field(default_factory=lambda: np.empty(0), repr=False)
    present: float = field(default=np.inf, repr=False)
    now: tuple[Array, Array] = field(default_factory=lambda: (np.empty(0), np.empty(0)), repr=False)
    trust: float = field(default=0.0, repr=False)
    _small: int = field(default=0, repr=False)

    def begin(self, block_commands: Array, trust: float) -> None:
        self.block_commands, self.trust, self._small, self.ended = block_commands, trust, 0, ""

    def take(
        self, block_commands: Array, value: float, now: tuple[Array, Array], best: int, commands: Array, effort: Effort
    ) -> None:
        """The best of the fractions of a change, if it is better, and the next trust region."""
        gain = self.present - value
        if gain > 0:
            self.block_commands, self.present, self.now = block_commands, value, now
            self.trust = min(1.0, 2 * self.trust * float(_FRACTIONS[best]))
        else:
            self.trust *= float(_FRACTIONS[-1]) ** 0.5
        if value < self.value:
            self.value, self.commands = value, commands.copy()
        self.values.append(self.value)
        self._small = self._small + 1 if gain < effort.gain * self.present else 0
        if self.trust < effort.least:
            self.ended = "trust region"
        elif self._small >= effort.patience:
            self.ended = "small gains"


def search(
    rollouts: Rollouts,
    starts: Sequence[tuple[str, Array]],
    objective: Peaks,
    effort: Effort | None = None,
) -> tuple[Path, ...]:
    """One search from each start, a name and its commands (periods,), side by side; the best path first.

    A path is never worse than its start. Raises InputError.
    """
    if not starts:
        raise InputError("clairvoyant: no command sequence to start from; give at least one controller")
    effort = effort or Effort()
    given = np.stack([np.clip(u[: rollouts.periods], rollouts.low, rollouts.high) for _, u in starts])
    y, _ = rollouts.run(given)
    paths = [
        Path(name, u, float(v), [float(v)])
        for (name, _), u, v in zip(starts, given, objective.value(y), strict=True)
    ]
    for hold in effort.holds:
        _stage(rollouts, paths, objective, hold, effort)
    return tuple(sorted(paths, key=lambda path: path.value))


def _stage(rollouts: Rollouts, paths: Sequence[Path], objective: Peaks, hold: int, effort: Effort) -> None:
    """Searches with commands that are held over `hold` periods, from where each path stands."""
    first = np.arange(0, rollouts.periods, hold)  # of a block; the last one may be short
    for path in paths:
        total = np.add.reduceat(path.commands, first)
        path.begin(total / np.diff(np.append(first, len(path.commands))), effort.trust)
    y, states = rollouts.run(
        np.stack([_spread(path.block_commands, hold, rollouts.periods) for path in paths]), states=True
    )
    for path, channels, kept, value in zip(paths, y, states, objective.value(y), strict=True):
        path.now, path.present = (channels, kept), float(value)
    for _ in range(effort.most):
        live = [path for path in paths if not path.ended]
        if not live:
            return
        tried = np.stack([
            path.block_commands + _FRACTIONS[:, None] * _change(rollouts, objective, path, hold, effort)
            for path in live
        ]).clip(rollouts.low, rollouts.high)  # fmt: skip
        flat = _spread(tried.reshape(-1, tried.shape[-1]), hold, rollouts.periods)
        y, states = rollouts.run(flat, states=True)
        found = objective.value(y).reshape(tried.shape[:2])
        for i, path in enumerate(live):
            best = int(np.argmin(found[i]))
            row = i * len(_FRACTIONS) + best
            now = y[row].copy(), states[row].copy()
            path.take(tried[i, best], float(found[i, best]), now, best, flat[row], effort)
    for path in paths:
        path.ended = path.ended or "steps"


def _change(rollouts: Rollouts, objective: Peaks, path: Path, hold: int, effort: Effort) -> Array:
    """Change of the block commands (blocks,) from the linearised run."""
    y, states = path.now
    block_commands, commands = path.block_commands, _spread(path.block_commands, hold, rollouts.periods)
    period, channel = objective.near(y, effort.near, hold)
    horizon_periods = np.zeros(rollouts.periods, dtype=bool)
    for k in np.unique(period):
        horizon_periods[max(0, k - effort.horizon) : k] = True
    at = np.flatnonzero(horizon_periods)
    each = sensitivity(rollouts.slopes(states, commands, at), at, period, channel, effort.horizon)
    blocks = at // hold
    first = np.flatnonzero(np.diff(blocks, prepend=-1))
    slope = np.add.reduceat(each, first, axis=1)
    sample = y[period, channel]
    slope *= (np.sign(sample) / objective.scale[channel])[:, None]
    # What hardly changes anything would be moved for nothing.
    some = np.flatnonzero(np.abs(slope).max(axis=0) > 1e-3 * np.abs(slope).max())
    here = blocks[first][some]
    reach = path.trust * (rollouts.high - rollouts.low)
    low = np.maximum(-reach, rollouts.low - block_commands[here])
    high = np.minimum(reach, rollouts.high - block_commands[here])
    change = np.zeros(len(block_commands))
    change[here] = _minimax(
        slope[:, some], np.abs(sample) / objective.scale[channel], objective.group[channel], objective.weights,
        low, high,
    )  # fmt: skip
    return change


def _minimax(slope: Array, size: Array, group: Whole, weights: Array, low: Array, high: Array) -> Array:
    """d (n,) between low and high that makes the weighted sum of the groups' largest size + slope d least."""
    m, n = slope.shape
    tops = np.zeros((m, len(weights)))
    tops[np.arange(m), group] = -1.0
    bounds = np.column_stack(
        [np.append(low, np.zeros(len(weights))), np.append(high, np.full(len(weights), np.inf))]
    )
    solved = linprog(
        np.append(np.zeros(n), weights), np.hstack([slope, tops]), -size, bounds=bounds, method="highs-ds"
    )
    return np.asarray(solved.x[:n]) if solved.x is not None else np.zeros(n)


def _spread(block_commands: Array, hold: int, periods: int) -> Array:
    """(..., periods) of commands (..., blocks) held over `hold` periods."""
    return np.repeat(block_commands, hold, axis=-1)[..., :periods]
