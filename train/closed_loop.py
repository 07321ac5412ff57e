"""A closed loop of a frame on the chain, run with its slopes, and the adjoint of the linearised run.

Next to every row stand rows with one state, or the command, changed a little: their differences after a control
period linearise the chain there. One sweep backwards through the slopes of plant, Kalman filter, leaky peak and policy
says what a unit of each command adds to a value of the whole run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.compare.rollouts import Slopes, matter
from mrdamp.envs.frame_task import FrameTask
from mrdamp.errors import InputError
from mrdamp.train.worlds import FrameWorld

Array = NDArray[np.float64]
Act = Callable[[NDArray[np.float32]], Array]

_STEP = 1e-3  # s, of the chain: peaks are within .3 % of those of a quarter of it
_NUDGE = 1e-6  # of a state or command over its size, as in mrdamp.compare.rollouts
_HEADER = 4  # doubles of a row's state before its coordinates
_PROBED = 64  # periods at which it is looked up which states matter


@dataclass(frozen=True)
class Trajectory:
    """T control periods of n rows. observations (T, n, size); commands (T, n); channels (T + 1, n, c), those of the
    observer first; a, b, c, d as of `mrdamp.compare.rollouts.Slopes`, (T, n, ...); lasts: (n,) periods."""

    observations: NDArray[np.float32]
    commands: Array
    channels: Array
    slopes: Slopes
    lasts: NDArray[np.int64]

    @property
    def periods(self) -> int:
        """Of all rows."""
        return int(self.commands.size)


class ClosedLoop:
    """n rows of a world's frame. Raises InputError for an observer that the sweep does not know."""

    def __init__(self, world: FrameWorld, n: int) -> None:
        given = {**world.arguments, "timestep": _STEP, "reward": None, "engine": "chain"}
        self.world, self.n, self._given = world, n, given
        self.task = FrameTask(n, **given)
        o = self.task.observer
        if o.history != 1 or o.memory or len(o.peaks) > 1:
            raise InputError(
                "adjoint: the observer has a history, a memory or several peaks; allowed: none of them"
            )
        names, storeys = self.task.rows.names, range(1, self.task.structure.storeys + 1)
        self.signals = [names.index(name) for name in o.signals]
        watched = [names.index(f"{what}_{j}") for what in ("drift", "acceleration") for j in storeys]
        self.columns = [*self.signals, *watched]
        #: Of the channels: those of drifts and of accelerations.
        first, many = len(self.signals), len(storeys)
        self.groups = slice(first, first + many), slice(first + many, first + 2 * many)
        self._rows: Any = None
        self._moving, self._scale = np.zeros(0, dtype=np.intp), np.zeros(0)

    @property
    def rows_each(self) -> int:
        """Rows that a row's slopes are taken with, itself included."""
        return len(self._moving) + 2

    def references(self) -> Array:
        """(n, 2) peak drift and acceleration of the frame alone under the loads of the last run."""
        return np.asarray(self.task.frame_score.values[: self.n, :2], dtype=np.float64)

    def run(self, loads: Sequence[Any], act: Act, noise: float, rng: np.random.Generator) -> Trajectory:
        """Under n loads; act: commands (n,) from observations; noise: on the signals, over the observer's units."""
        if self._rows is None:
            self._find_states(loads, act)
        return self._run(loads, act, noise, rng, self._moving, self._scale)

    def _find_states(self, loads: Sequence[Any], act: Act) -> None:
        """States that change in a run and that a channel depends on, and their sizes."""
        rng = np.random.default_rng(0)
        size = self.task.rows.plants.state.shape[1]
        largest, first, changing = np.zeros(size), None, np.zeros(size, dtype=np.bool_)
        states: list[Array] = []
        self._run(loads, act, 0.0, rng, np.zeros(0, dtype=np.intp), np.zeros(0), states)
        for now in states:
            first = now if first is None else first
            largest, changing = (
                np.maximum(largest, np.abs(now).max(axis=0)),
                changing | (now != first).any(axis=0),
            )
        moving = np.flatnonzero(changing & np.isfinite(largest))
        moving = moving[moving >= _HEADER]
        scale = np.maximum(largest[moving], np.finfo(np.float64).tiny)
        s = self._run(loads, act, 0.0, rng, moving, scale).slopes
        some = np.linspace(0, len(s.a) - 1, _PROBED).astype(np.intp)
        flat = (part[some].reshape(-1, *part.shape[2:]) for part in (s.a, s.b, s.c, s.d))
        kept = matter(Slopes(*flat))
        self._moving, self._scale, self._rows = moving[kept], scale[kept], None

    def _run(
        self,
        loads: Sequence[Any],
        act: Act,
        noise: float,
        rng: np.random.Generator,
        moving: NDArray[np.intp],
        scale: Array,
        states: list[Array] | None = None,
    ) -> Trajectory:
        n, many, o = self.n, len(moving), self.task.observer
        each = many + 2 if many else 1
        self._start(loads, each)
        plants, base = self._rows.plants, self.task.rows.plants
        x, measured = base.state.copy(), base.measured.copy()
        lasts = self.task.rows.steps[:n].copy()
        t, width, largest = int(lasts.max()), len(self.columns), float(self.task.command_max[0])
        seen = np.zeros((t, n, o.size), np.float32)
        commands, channels = np.zeros((t, n)), np.zeros((t + 1, n, width))
        a, b = np.zeros((t, n, many, many), np.float32), np.zeros((t, n, many), np.float32)
        c, d = np.zeros((t, n, width, many), np.float32), np.zeros((t, n, width), np.float32)
        channels[0], before, units = measured[:, self.columns], None, np.array(o.scales)
        u = np.zeros(n)
        for k in range(t):
            values = measured[:, self.signals]
            if noise:
                values = values + noise * units * rng.standard_normal(values.shape)
            before = o.scaled(values, u[:, None], before)
            seen[k] = before
            commands[k] = u = act(seen[k])
            if states is not None:
                states.append(x)
            changed = np.repeat(x[:, None], each, axis=1)
            given = np.repeat(u[:, None], each, axis=1)
            # Away from the limit that is nearer: at a limit the chain cuts commands off.
            du = np.where(u > largest / 2, -1.0, 1.0) * _NUDGE * largest
            if many:
                changed[:, np.arange(many), moving] += _NUDGE * scale
                given[:, many] += du
            plants.state[:] = changed.reshape(n * each, -1)
            rows = plants.advance(given.reshape(-1, 1))[1].reshape(n, each, -1)
            after = plants.state.reshape(n, each, -1)
            x, measured = after[:, -1].copy(), rows[:, -1].copy()
            channels[k + 1] = measured[:, self.columns]
            if many:
                dx = (after[:, :-1, moving] - x[:, None, moving]) / scale
                dy = rows[:, :-1, self.columns] - channels[k + 1][:, None]
                a[k], b[k] = dx[:, :many].transpose(0, 2, 1) / _NUDGE, dx[:, many] / du[:, None]
                c[k], d[k] = dy[:, :many].transpose(0, 2, 1) / _NUDGE, dy[:, many] / du[:, None]
        return Trajectory(seen, commands, channels, Slopes(a, b, c, d), lasts)

    def _start(self, loads: Sequence[Any], each: int) -> None:
        rngs = [np.random.default_rng(k) for k in range(self.n)]
        for k, load in enumerate(loads):
            self.task.reset([k], rngs, {self.world.option: load})
        if self._rows is None or self._rows.plants.n != self.n * each:
            self._rows = FrameTask(self.n * each, **self._given).rows
        for k in range(self.n):
            moment = self.task.rows.plants.save(k)
            for row in range(k * each, (k + 1) * each):
                self._rows.plants.restore(row, moment)

    def adjoint(self, run: Trajectory, by_channel: Array, by_observation: Array, price: float = 0.0) -> Array:
        """(T, n): what a unit of each command adds to a value, all that comes of it later included.

        by_channel: (T + 1, n, c) slopes of the value; by_observation: (T, n, size) slopes of the commands;
        price: what a unit of each command adds by itself.
        """
        o, s, ns = self.task.observer, run.slopes, len(self.signals)
        units, n = np.array(o.scales), self.n
        states = o.filter.size if o.filter else 0
        step, before, now = (
            o.filter.matrices if o.filter else (np.zeros((0, 0)), np.zeros((0, ns)), np.zeros((0, ns)))
        )
        signal = o.signals.index(next(iter(o.peaks))) if o.peaks else 0
        fall = np.exp(-1 / next(iter(o.peaks.values()))) if o.peaks else 0.0
        last = ns if o.action_in_observation else None
        at = ns + o.action_in_observation if o.peaks else None
        by_x, by_y = np.zeros((n, s.a.shape[-1])), by_channel[-1].copy()
        by_filter, by_peak = np.zeros((n, states)), np.zeros(n)
        found, by_command = np.zeros(run.commands.shape), np.full(n, price)
        for k in range(len(found) - 1, -1, -1):
            found[k] = (by_x * s.b[k]).sum(axis=-1) + (by_y * s.d[k]).sum(axis=-1) + by_command
            by_x = (by_x[:, None] @ s.a[k] + by_y[:, None] @ s.c[k])[:, 0]
            through = by_observation[k] * found[k][:, None]
            later = by_filter
            by_filter = later @ step + through[:, o.size - states :]
            by_signal = through[:, :ns] + by_filter @ now + later @ before
            if last is not None:
                by_command = price + through[:, last] / float(o.command_max[0])
            if at is not None:
                value, total = run.observations[k, :, signal], by_peak + through[:, at]
                fresh = np.abs(value) >= run.observations[k, :, at]
                by_signal[:, signal] += np.where(fresh, np.sign(value) * total, 0.0)
                by_peak = np.where(fresh, 0.0, fall * total)
            by_y = by_channel[k].copy()
            by_y[:, :ns] += by_signal / units
        return found
