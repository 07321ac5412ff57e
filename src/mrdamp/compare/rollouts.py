"""Command sequences through rows of closed loops, and what a change of each command does to what is measured later."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.errors import InputError
from mrdamp.model.core import Array
from mrdamp.simulation.rows import HEADER

Whole = NDArray[np.intp]

#: Perturbation of a state or command, over its size in the run. From 1e-7 to 1e-5 the slopes agree within 1e-4.
_NUDGE = 1e-6
#: Rows that slopes are taken with at once: larger ones are no faster.
_ROWS = 1024
#: Periods at which it is looked up which states matter, and effect below which one does not (differences of numbers
#: near one over _NUDGE are good to 1e-9).
_PROBED, _NOTHING = 64, 1e-8
#: Periods that a step of the command is given to reach the driver's states.
_REACHED = 4


@dataclass(frozen=True)
class Slopes:
    """x' = A dx + B du and y' = C dx + D du over one period at some periods (p,) in states (s,) and channels (c,).

    a (p, s, s), b (p, s), c (p, c, s), d (p, c): per unit of the scaled states and of the command.
    """

    a: NDArray[np.floating[Any]]
    b: NDArray[np.floating[Any]]
    c: NDArray[np.floating[Any]]
    d: NDArray[np.floating[Any]]


class Rollouts:
    """One damper's command sequences under one load.

    make: rows on the chain from their number; load: what they start under; columns: of the measurements that are
    watched, the channels; low, high: of commands. Attributes: periods, how many control periods are run: those of the
    load.
    """

    def __init__(
        self,
        make: Callable[[int], Any],
        load: Any,
        columns: Sequence[int],
        low: float,
        high: float,
    ) -> None:
        if not low < high:
            raise InputError(f"clairvoyant: commands from {low:g} to {high:g}; allowed: a range")
        self.make, self.load, self.columns = make, load, list(columns)
        self.low, self.high = low, high
        self._rows: dict[int, Any] = {}
        rows = self.rows(1)
        self._state, self._measured = rows.plants.state[0].copy(), rows.plants.measured[0].copy()
        self.periods = int(rows.steps[0])

    def run(self, commands: Array, states: bool = False) -> tuple[Array, Array]:
        """Channels (n, periods, channels) of commands (n, periods), as `compare.frame.run_rows` samples them: first
        those at the start, then those after each command but the last; states (n, periods, size) besides, or none."""
        n, plants = len(commands), self.rows(len(commands)).plants
        plants.state[:] = self._state
        y = np.empty((n, self.periods, len(self.columns)))
        y[:, 0] = self._measured[self.columns]
        kept = np.empty((n, self.periods, len(self._state)) if states else (0, 0, 0))
        for k in range(self.periods):
            if states:
                kept[:, k] = plants.state
            if k + 1 < self.periods:
                y[:, k + 1] = plants.advance(commands[:, k : k + 1])[1][:, self.columns]
        return y, kept

    def slopes(self, states: Array, commands: Array, at: Whole) -> Slopes:
        """At the periods `at` (p,), all before the last one, of one run, by forward differences of the chain itself.

        states, commands: of that run. States that change neither in it nor by a command, or that nothing depends on,
        are left out.
        """
        some = at[np.linspace(0, len(at) - 1, min(len(at), _PROBED)).astype(np.intp)]
        stepped = self._commanded(states, commands, some)
        scale = np.maximum(np.abs(states).max(axis=0), stepped)
        changing = (states != states[0]).any(axis=0) | (stepped > 0)
        moving = np.flatnonzero(changing & np.isfinite(scale))
        moving = moving[moving >= HEADER]
        moving = moving[matter(self._differences(states, commands, some, moving, scale[moving]))]
        return self._differences(states, commands, at, moving, scale[moving])

    def _differences(self, states: Array, commands: Array, at: Whole, moving: Whole, scale: Array) -> Slopes:
        plants, limits = self.rows(_ROWS).plants, (self.low, self.high)
        return differences(plants, states, commands, at, self.columns, moving, scale, limits)

    def _commanded(self, states: Array, commands: Array, at: Whole) -> Array:
        """(size,) how far a step of the command by half of its range moves each state within a few periods.

        Under a constant command the driver's states do not change; what a command does goes through them all the same.
        """
        plants = self.rows(_ROWS).plants
        given, half = np.zeros((_ROWS, 1)), (self.high - self.low) / 2
        m = len(at)
        step = np.where(commands[at] > (self.low + self.high) / 2, -half, half)
        plants.state[:m] = plants.state[m : 2 * m] = states[at]
        given[:m, 0], given[m : 2 * m, 0] = commands[at], commands[at] + step
        for _ in range(_REACHED):
            plants.advance(given)
        return np.asarray(np.abs(plants.state[m : 2 * m] - plants.state[:m]).max(axis=0))

    def rows(self, n: int) -> Any:
        """n rows under the load, made once; every run starts them again."""
        if n not in self._rows:
            rows = self.make(n)
            for row in range(n):
                rows.start(row, self.load)
            self._rows[n] = rows
        return self._rows[n]


def differences(
    plants: Any,
    states: Array,
    commands: Array,
    at: Whole,
    columns: Sequence[int],
    moving: Whole,
    scale: Array,
    limits: tuple[float, float],
    *,
    kind: type[np.floating[Any]] = np.float64,
    placed: Callable[[Whole], None] = lambda at: None,
) -> Slopes:
    """Forward differences of the chain over a period, between rows with one state or the command changed and one as is.

    plants: rows to use; states (k, size) and commands (k,) of runs, of which those `at` (p,) are taken; columns: of the
    measurements that are the channels; moving, scale: states that are changed, and their sizes; limits: of commands;
    kind: of the result's numbers; placed: called with the place `at` of each row, where rows differ by that.
    """
    (low, high), many, rows = limits, len(moving), plants.n
    each = many + 2
    a, b = np.empty((len(at), many, many), kind), np.empty((len(at), many), kind)
    c, d = np.empty((len(at), len(columns), many), kind), np.empty((len(at), len(columns)), kind)
    given, chunk = np.zeros((rows, 1)), rows // each
    for begin in range(0, len(at), chunk):
        here = slice(begin, begin + chunk)
        now = at[here]
        m = len(now)
        x = np.repeat(states[now][:, None], each, axis=1)
        x[:, np.arange(many), moving] += _NUDGE * scale
        u = np.repeat(commands[now][:, None], each, axis=1)
        # Away from the limit that is nearer: at a limit the chain cuts commands off.
        du = np.where(commands[now] > (low + high) / 2, -1.0, 1.0) * _NUDGE * (high - low)
        u[:, many] += du
        placed(np.repeat(now, each))
        plants.state[: m * each], given[: m * each, 0] = x.reshape(m * each, -1), u.ravel()
        y = plants.advance(given)[1][: m * each, columns].reshape(m, each, -1)
        after = plants.state[: m * each, moving].reshape(m, each, -1)
        dx, dy = (after[:, :-1] - after[:, -1:]) / scale, y[:, :-1] - y[:, -1:]
        a[here], b[here] = dx[:, :many].transpose(0, 2, 1) / _NUDGE, dx[:, many] / du[:, None]
        c[here], d[here] = dy[:, :many].transpose(0, 2, 1) / _NUDGE, dy[:, many] / du[:, None]
    return Slopes(a, b, c, d)


def matter(slopes: Slopes) -> Whole:
    """Which states have an effect on a channel, by themselves or through others."""
    on_states, on_channels = (np.abs(part).max(axis=0) > _NOTHING for part in (slopes.a, slopes.c))
    seen = on_channels.any(axis=0)
    for _ in seen:
        seen = seen | on_states[seen].any(axis=0)
    return np.flatnonzero(seen)


def sensitivity(slopes: Slopes, at: Whole, period: Whole, channel: Whole, horizon: int) -> Array:
    """(m, p): what a unit of the command at each of the periods `at` (p,) adds to a channel (m,) at a period (m,),
    for those commands that come at most `horizon` periods before it.

    Adjoint of the linearised run: one sweep backwards for all. period must not decrease; `at` increases and holds, with
    every period before a watched one, those of the horizon.
    """
    m = len(period)
    g, adjoint = np.zeros((m, len(at))), np.zeros((m, slopes.b.shape[1]))
    first = last = m  # those under way: period[first:last]
    for q in range(len(at) - 1, -1, -1):
        k = at[q]
        while last > first and period[last - 1] - k > horizon:
            last -= 1
        if first < last:
            g[first:last, q] = adjoint[first:last] @ slopes.b[q]
            adjoint[first:last] = adjoint[first:last] @ slopes.a[q]
        while first > 0 and period[first - 1] == k + 1:
            first -= 1
            g[first, q] = slopes.d[q, channel[first]]
            adjoint[first] = slopes.c[q, channel[first]]
        last = max(last, first)
    return g
