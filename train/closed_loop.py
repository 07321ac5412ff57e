"""A closed loop of a frame on the chain, and the adjoint of the linearised run.

In the periods before the near-peaks, which alone the value depends on, rows with one state, or the command, changed a
little stand next to every row: their differences after a control period linearise the chain there. One sweep backwards
through the slopes of plant, Kalman filter, leaky peaks and policy says what a unit of each command adds to a value of
the whole run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.compare.rollouts import Slopes, differences, matter
from mrdamp.envs.frame import FrameTask
from mrdamp.envs.task import begun
from mrdamp.errors import InputError
from mrdamp.model.core import Array
from mrdamp.simulation.rows import HEADER
from mrdamp.train.worlds import Act, World

_STEP = 1e-3  # s, of the chain: peaks are within .3 % of those of a quarter of it
_PROBED = 64  # periods at which it is looked up which states matter
_ROWS = 1008  # rows that slopes are taken with at once
#: Periods before a near-peak that slopes are taken in, .3 s of a frame whose first period is .18 s; and what counts as
#: a near-peak, of the largest slope of the value: .7 of the peak with a norm of exponent 20.
_HORIZON, _SMALL = 150, 1e-3


@dataclass(frozen=True)
class Trajectory:
    """T control periods of n rows. observations (T, n, size); commands (T, n); channels (T + 1, n, c), those of the
    observer first; states: (T, n, doubles) of the rows before each period; lasts: (n,) periods."""

    observations: NDArray[np.float32]
    commands: Array
    channels: Array
    states: Array
    lasts: NDArray[np.int64]

    @property
    def periods(self) -> int:
        """Of all rows."""
        return int(self.commands.size)


class ClosedLoop:
    """n rows of a world's frame. Raises InputError for an observer that the sweep does not know.

    like: another of the same frame but for its parameters, whose states are these too.
    """

    def __init__(self, world: World, n: int, like: ClosedLoop | None = None) -> None:
        own = {name: value for name, value in world.arguments.items() if name != "randomise"}
        given = {**own, "timestep": _STEP, "reward": None, "engine": "chain"}
        self.world, self.n, self._given = world, n, given
        self.task = FrameTask(n, **given)
        o = self.task.observer
        if o.history != 1 or o.memory:
            raise InputError("adjoint: the observer has a history or a memory; allowed: none of them")
        names, storeys = self.task.rows.names, range(1, self.task.structure.frame.storeys + 1)
        self.signals = [names.index(name) for name in o.signals]
        watched = [names.index(f"{what}_{j}") for what in ("drift", "acceleration") for j in storeys]
        self.columns = [*self.signals, *watched]
        #: Of the channels: those of drifts and of accelerations.
        first, many = len(self.signals), len(storeys)
        self.groups = slice(first, first + many), slice(first + many, first + 2 * many)
        self._rows: Any = None
        #: States that a channel depends on, and their sizes: found in the first run, and kept.
        self.moving: NDArray[np.intp] = np.zeros(0, dtype=np.intp) if like is None else like.moving
        self.scale: Array = np.zeros(0) if like is None else like.scale
        self.periods = 0  #: Simulated so far, of all rows, those of slopes included.

    def references(self) -> Array:
        """(n, 2) peak drift and acceleration of the frame alone under the loads of the last run."""
        return np.asarray(self.task.score.values[: self.n, :2], dtype=np.float64)

    def run(self, loads: Sequence[Any], act: Act, noise: float, rng: np.random.Generator) -> Trajectory:
        """Under n loads; act: commands (n,) from observations; noise: on the signals, over the observer's units."""
        begun(self.task, loads)
        rows, plants, o = self.task.rows, self.task.rows.plants, self.task.observer
        lasts = rows.steps[: self.n].copy()
        t, units = int(lasts.max()), np.array(o.scales)
        seen = np.concatenate([np.zeros((t, self.n, o.size), np.float32), self.besides(loads, t)], axis=-1)
        states = np.zeros((t, *plants.state.shape))
        commands, channels = np.zeros((t, self.n)), np.zeros((t + 1, self.n, len(self.columns)))
        measured, before, u = plants.measured, None, np.zeros(self.n)
        channels[0] = measured[:, self.columns]
        for k in range(t):
            values = measured[:, self.signals]
            if noise:
                values = values + noise * units * rng.standard_normal(values.shape)
            before = o.scaled(values, u[:, None], before)
            seen[k, :, : o.size], states[k] = before, plants.state
            commands[k] = u = act(seen[k])
            measured = plants.advance(u[:, None])[1]
            channels[k + 1] = measured[:, self.columns]
        self.periods += t * self.n
        return Trajectory(seen, commands, channels, states, lasts)

    def besides(self, loads: Sequence[Any], t: int) -> NDArray[np.float32]:
        """(t, n, ...) what follows the observations of t periods: nothing; for studies."""
        return np.zeros((t, self.n, 0), np.float32)

    def _find_states(self, run: Trajectory) -> None:
        """States that change in a run and that a channel depends on, and their sizes."""
        largest = np.abs(run.states).max(axis=(0, 1))
        changing = (run.states != run.states[0]).any(axis=(0, 1))
        moving = np.flatnonzero(changing & np.isfinite(largest))
        moving = moving[moving >= HEADER]
        self.moving, self.scale = moving, np.maximum(largest[moving], np.finfo(np.float64).tiny)
        k = np.linspace(0, len(run.commands) - 1, _PROBED).astype(np.intp)
        at = np.repeat(k, self.n), np.tile(np.arange(self.n), len(k))
        counted = self.periods
        kept = matter(self.slopes(run, *at))
        self.periods = counted
        self.moving, self.scale = moving[kept], self.scale[kept]

    def slopes(self, run: Trajectory, periods: NDArray[np.intp], rows: NDArray[np.intp]) -> Slopes:
        """At (p,) pairs of a control period and a row of the last run."""
        if not len(self.moving):
            self._find_states(run)
        own = np.zeros(_ROWS, dtype=np.intp)

        def placed(at: NDArray[np.intp]) -> None:
            own[: len(at)] = at % self.n
            plants.share(self.task.rows.plants, own)

        self.periods += len(periods) * (len(self.moving) + 2)
        if self._rows is None:
            self._rows = FrameTask(_ROWS, **self._given).rows
        plants, limits = self._rows.plants, (0.0, float(self.task.command_max[0]))
        states, commands = run.states.reshape(-1, run.states.shape[-1]), run.commands.ravel()
        at = periods * self.n + rows
        return differences(
            plants, states, commands, at, self.columns, self.moving, self.scale, limits, kind=np.float32, placed=placed
        )

    def needed(self, by_channel: Array) -> NDArray[np.bool_]:
        """(T, n) periods from which a change reaches a period that a value depends on, within the horizon."""
        size = np.abs(by_channel).max(axis=2)
        at = size > _SMALL * size.max(axis=0)
        found = np.zeros(at.shape, dtype=np.bool_)
        left = np.zeros(at.shape[1], dtype=np.intp)
        for k in range(len(at) - 1, -1, -1):
            left = np.where(at[k], _HORIZON + 1, np.maximum(left - 1, 0))
            found[k] = left > 0
        return found[1:]

    def adjoint(self, run: Trajectory, by_channel: Array, by_observation: Array, price: float = 0.0) -> Array:
        """(T, n): what a unit of each command adds to a value, all that comes of it later included.

        by_channel: (T + 1, n, c) slopes of the value; by_observation: (T, n, size) slopes of the commands, those by
        what is known ahead do not count; price: what a unit of each command adds by itself.
        """
        o, ns, (t, _) = self.task.observer, len(self.signals), run.commands.shape
        at = np.nonzero(self.needed(by_channel))
        s, places = self.slopes(run, *at), np.searchsorted(at[0], np.arange(t + 1))
        units, n = np.array(o.scales), self.n
        states = o.filter.size if o.filter else 0
        step, before, now = (
            o.filter.matrices if o.filter else (np.zeros((0, 0)), np.zeros((0, ns)), np.zeros((0, ns)))
        )
        peaked = [o.signals.index(name) for name in o.peaks]
        fall = np.exp(-1 / np.array(list(o.peaks.values())))
        last = ns if o.action_in_observation else None
        tops = ns + o.action_in_observation + np.arange(len(peaked))
        by_x, by_y = np.zeros((n, len(self.moving))), by_channel[-1].copy()
        by_filter, by_peak = np.zeros((n, states)), np.zeros((n, len(peaked)))
        found, by_command = np.zeros(run.commands.shape), np.full(n, price)
        for k in range(len(found) - 1, -1, -1):
            here = slice(places[k], places[k + 1])
            rows, found[k] = at[1][here], by_command
            x, y = by_x[rows], by_y[rows]
            found[k, rows] += (x * s.b[here]).sum(axis=-1) + (y * s.d[here]).sum(axis=-1)
            by_x[:] = 0.0
            by_x[rows] = (x[:, None] @ s.a[here] + y[:, None] @ s.c[here])[:, 0]
            through = by_observation[k, :, : o.size] * found[k][:, None]
            later = by_filter
            by_filter = later @ step + through[:, o.size - states :]
            by_signal = through[:, :ns] + by_filter @ now + later @ before
            if last is not None:
                by_command = price + through[:, last] / float(o.command_max[0])
            if peaked:
                value, total = run.observations[k][:, peaked], by_peak + through[:, tops]
                fresh = np.abs(value) >= run.observations[k][:, tops]
                by_signal[:, peaked] += np.where(fresh, np.sign(value) * total, 0.0)
                by_peak = np.where(fresh, 0.0, fall * total)
            by_y = by_channel[k].copy()
            by_y[:, :ns] += by_signal / units
        return found
