"""Observations of a learned controller: measurements scaled, cut off, and stacked over the last control periods."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mrdamp.errors import InputError, refuse
from mrdamp.model.core import Array

Observation = NDArray[np.float32]


@dataclass(frozen=True)
class LinearFilter:
    """A discrete linear filter of an observer's s scaled signals o, of k states, from rest:

        x+ = step x + before o + now o+

    step (k, k), before and now (k, s), as nested sequences of numbers. Raises InputError.
    """

    step: tuple[tuple[float, ...], ...]
    before: tuple[tuple[float, ...], ...]
    now: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        for name in ("step", "before", "now"):
            try:
                rows = tuple(tuple(float(v) for v in row) for row in getattr(self, name))
            except (TypeError, ValueError):
                raise InputError(f"observer: filter: {name} is not rows of numbers") from None
            object.__setattr__(self, name, rows)
        step, before, now = self.matrices
        fits = step.shape == (len(step), len(step)) and before.shape == now.shape == (len(step), before.shape[-1])
        if not len(step) or not fits or not all(np.isfinite(m).all() for m in (step, before, now)):
            raise InputError(
                f"observer: filter: {step.shape}, {before.shape}, {now.shape} do not fit together"
            )

    @cached_property
    def matrices(self) -> tuple[Array, Array, Array]:
        try:
            return np.array(self.step), np.array(self.before), np.array(self.now)
        except ValueError:
            raise InputError("observer: filter: rows are of different lengths") from None

    @property
    def size(self) -> int:
        """States."""
        return len(self.step)

    def __call__(self, states: Array, before: Array, now: Array) -> Array:
        """(..., k) from states (..., k) and signals (..., s). `einsum` sums one by one: a row depends on no other."""
        values = np.concatenate([states, before, now], axis=-1)
        return np.asarray(np.einsum("ij,...j->...i", self._whole, values))

    @cached_property
    def _whole(self) -> Array:
        return np.ascontiguousarray(np.hstack(self.matrices))

    def to_dict(self) -> dict[str, Any]:
        return {name: [list(row) for row in getattr(self, name)] for name in ("step", "before", "now")}


@dataclass(frozen=True)
class Observer:
    """Measurements -> observation; the same object serves an environment and an exported policy.

    signals: names of measurements (see `mrdamp.control.base`), s of them. scales: (s,) the size of each in its own
    unit; an observation is the value over it. history: how many control periods are stacked, the newest first.
    action_in_observation: each of them also holds the command that was held when it was measured. memory: time
    constants, in control periods, of leaky averages of every signal that follow it in each of them: a longer past in
    few numbers.
    peaks: signals by name and, in control periods, the time constant of a leaky peak of its size that follows those.
    filter: states that follow at the end, as those of a Kalman filter.
    command_max: A or V, what that command is divided by, one number for each damper. limit: what a scaled value is
    cut off at, as a real sensor has a range; the default cuts no reading of the environments: what is cut off near a
    damper that sticks would be in a filter's states for long.

    Before the first call (`reset`) the past is taken to be like the first measurement. Raises InputError.
    """

    signals: tuple[str, ...]
    scales: tuple[float, ...]
    history: int = 1
    action_in_observation: bool = True
    command_max: tuple[float, ...] = (1.0,)
    limit: float = 1000.0
    memory: tuple[float, ...] = ()
    peaks: Mapping[str, float] = field(default_factory=dict)
    filter: LinearFilter | None = None
    _past: list[Array] = field(default_factory=list, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("scales", "command_max", "memory"):
            object.__setattr__(self, name, tuple(float(v) for v in np.atleast_1d(getattr(self, name))))
        object.__setattr__(self, "signals", tuple(self.signals))
        object.__setattr__(self, "peaks", {name: float(v) for name, v in dict(self.peaks).items()})
        refuse(
            "observer",
            (not self.signals or len(set(self.signals)) != len(self.signals),
             f"signals is {self.signals}; allowed: at least one name, each once"),
            (len(self.scales) != len(self.signals), f"{len(self.scales)} scales for {len(self.signals)} signals"),
            *((not all(0 < v < math.inf for v in values), f"{name} is {values}; allowed: numbers > 0")
              for name in ("scales", "command_max", "memory") for values in (getattr(self, name),)),
            (not all(name in self.signals and 0 < periods < math.inf for name, periods in self.peaks.items()),
             f"peaks is {self.peaks}; allowed: signals, and numbers > 0"),
            (self.filter is not None and self.filter.matrices[1].shape[1] != len(self.signals),
             f"the filter is not of {len(self.signals)} signals"),
            (type(self.history) is not int or not 1 <= self.history <= 1000,
             f"history is {self.history!r}; allowed: 1 to 1000 control periods"),
            (not 0 < self.limit < math.inf, f"limit is {self.limit}; allowed: a number > 0"),
        )  # fmt: skip

    @property
    def width(self) -> int:
        """Numbers of one control period."""
        commands = len(self.command_max) * self.action_in_observation
        return len(self.signals) * (1 + len(self.memory)) + commands + len(self.peaks) + self._states

    @property
    def _states(self) -> int:
        return self.filter.size if self.filter else 0

    @property
    def _peaks_at(self) -> int:
        """Column of the first peak."""
        return self.width - self._states - len(self.peaks)

    @property
    def size(self) -> int:
        """Numbers of an observation."""
        return self.width * self.history

    @property
    def names(self) -> tuple[str, ...]:
        """(size,) what each number of an observation is; `[-1]` is one control period ago."""
        one = list(self.signals)
        if self.action_in_observation:
            many = len(self.command_max) > 1
            one += [f"command_{k + 1}" if many else "command" for k in range(len(self.command_max))]
        one += [f"{name}~{periods:g}" for periods in self.memory for name in self.signals]
        one += [f"{name}^{periods:g}" for name, periods in self.peaks.items()]
        one += [f"state_{k + 1}" for k in range(self._states)]
        return tuple(f"{name}[{-k}]" if k else name for k in range(self.history) for name in one)

    @property
    def without_peaks(self) -> tuple[int, ...]:
        """Columns of an observation that are no leaky peaks: those with a sign."""
        first = self._peaks_at
        kept = [j for j in range(self.width) if not 0 <= j - first < len(self.peaks)]
        return tuple(k * self.width + j for k in range(self.history) for j in kept)

    def peak(self, observations: NDArray[np.float32], signal: str) -> Array:
        """(n,) the signal's leaky peak, in its unit, as observations (n, size) hold it."""
        column = self._peaks_at + list(self.peaks).index(signal)
        return np.asarray(
            self.scales[self.signals.index(signal)] * observations[:, column].astype(np.float64)
        )

    def measured(self, observations: NDArray[np.float32], signal: str) -> Array:
        """(n,) the newest value of a signal, in its unit, as observations (n, size) hold it; zero where they do not."""
        if signal not in self.signals:
            return np.zeros(len(observations))
        column = self.signals.index(signal)
        return np.asarray(self.scales[column] * observations[:, column].astype(np.float64))

    def scaled(self, values: Array, last_command: Array, before: Array | None = None) -> Array:
        """One control period: values (..., s) and last_command (..., dampers) -> (..., width).

        before: (..., width) of the period before, None where there is none.
        """
        scales, command_max, keep, fall, columns = self._numbers
        now = values / scales
        if self.action_in_observation:
            now = np.concatenate([now, last_command / command_max], axis=-1)
        now = np.minimum(np.maximum(now, -self.limit), self.limit)
        parts, at = [now], now.shape[-1]
        if self.memory:
            signals = now[..., None, : len(self.signals)]
            end = at + len(keep) * len(self.signals)
            if before is None:
                averages = np.repeat(signals, len(keep), axis=-2)
            else:
                averages = before[..., at:end].reshape(*now.shape[:-1], len(keep), -1)
                averages = signals + keep[:, None] * (averages - signals)
            parts.append(averages.reshape(*now.shape[:-1], -1))
        if self.peaks:
            size = np.abs(now[..., columns])
            first = self._peaks_at
            held = size if before is None else before[..., first : first + len(fall)]
            parts.append(np.maximum(size, fall * held))
        if self.filter is not None:
            s = len(self.signals)
            if before is None:
                parts.append(np.zeros((*now.shape[:-1], self.filter.size)))
            else:
                parts.append(self.filter(before[..., -self.filter.size :], before[..., :s], now[..., :s]))
        return np.concatenate(parts, axis=-1) if len(parts) > 1 else now

    @cached_property
    def _numbers(self) -> tuple[Array, Array, Array, Array, NDArray[np.intp]]:
        keep, fall = (
            np.exp(-1 / np.array(list(t), dtype=np.float64)) for t in (self.memory, self.peaks.values())
        )
        columns = np.array([self.signals.index(name) for name in self.peaks], dtype=np.intp)
        return np.array(self.scales), np.array(self.command_max), keep, fall, columns

    def reset(self) -> None:
        self._past.clear()

    def __call__(self, y: Mapping[str, float], last_command: ArrayLike) -> Observation:
        """(size,) from the measurements y and the command(s) of the period that ended; from those of many runs
        (rows, size), with commands (rows,) or (rows, dampers). Raises InputError."""
        try:
            values = np.array([y[name] for name in self.signals], dtype=np.float64).T
        except KeyError as error:
            raise InputError(f"observer: no measurement {error}; there are: {', '.join(y)}") from None
        last = np.asarray(last_command, dtype=np.float64)
        if last.ndim and last.shape == values.shape[:-1]:  # of one damper each
            last = last[:, None]
        last = np.broadcast_to(last, (*values.shape[:-1], len(self.command_max)))
        now = self.scaled(values, last, self._past[0] if self._past else None)
        self._past[:] = [now, *self._past[: self.history - 1]] if self._past else [now] * self.history
        return np.concatenate(self._past, axis=-1).astype(np.float32)

    def to_dict(self) -> dict[str, Any]:
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.init}
        plain = {name: list(value) if isinstance(value, tuple) else value for name, value in own.items()}
        return plain | {"peaks": dict(self.peaks), "filter": self.filter.to_dict() if self.filter else None}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Observer:
        """From `to_dict`. Raises InputError where an entry is missing or unknown."""
        try:
            for needed in ("signals", "scales"):
                if needed not in data:
                    raise InputError(f"observer: it has no {needed}; allowed: what Observer.to_dict() gives")
            own = {"signals": tuple(data["signals"]), "scales": tuple(data["scales"])}
            held = data.get("filter")
            return cls(**{**data, **own, "filter": LinearFilter(**held) if held is not None else None})
        except TypeError as error:
            raise InputError(f"observer: {error}") from None


class Stack:
    """The stacked observations of n plants at once, row by row as `Observer` makes them.

    past: (n, history, width), the newest first.
    """

    def __init__(self, observer: Observer, n: int) -> None:
        self.observer = observer
        self.past: Array = np.zeros((n, observer.history, observer.width))

    def push(self, values: Array, last_command: Array) -> Observation:
        """(n, size) after a control period: values (n, signals), last_command (n, dampers)."""
        now = self.observer.scaled(values, last_command, self.past[:, 0])
        self.past[:, 1:] = self.past[:, :-1]
        self.past[:, 0] = now
        return self.past.reshape(len(values), -1).astype(np.float32)

    def push_one(self, values: Sequence[float], last_command: Sequence[float]) -> Observation:
        """`push` of a single plant in plain numbers: (size,) from values (signals,), last_command (dampers,)."""
        o = self.observer
        if o.memory or o.peaks or o.filter is not None:
            stacked: Observation = self.push(np.array([values]), np.array([last_command]))[0]
            return stacked
        now = [value / scale for value, scale in zip(values, o.scales, strict=True)]
        if o.action_in_observation:
            now += [command / largest for command, largest in zip(last_command, o.command_max, strict=True)]
        most = o.limit
        past = self.past[0]
        if o.history > 1:
            past[1:] = past[:-1]
        past[0] = [v if -most <= v <= most else most if v > most else -most if v < -most else v for v in now]
        stacked = past.reshape(-1).astype(np.float32)
        return stacked

    def restart(self, rows: Sequence[int], values: Array, last_command: Array) -> Observation:
        """(rows, size): these rows have no past but this; values (rows, signals)."""
        chosen = list(rows)
        self.past[chosen] = self.observer.scaled(values, last_command)[:, None, :]
        return self.past[chosen].reshape(len(chosen), -1).astype(np.float32)
