"""Sensors between the structure and a controller: the floors' accelerometers and white noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter

from mrdamp.errors import InputError, require_positive
from mrdamp.model.core import FrameInput
from mrdamp.simulation.stepping import second_order_step

Array = NDArray[np.float64]


class OnePole:
    """A first-order low-pass, or the complementary high-pass, on (n, channels) sampled at the control period.

    tau: (channels,) s, 0 where there is none. Exact for signals that are linear between samples; starts at rest
    with the first one.
    """

    def __init__(self, tau: Array, period: float, n: int, *, high: bool) -> None:
        self.on = tau > 0
        self.high, self.period = high, period
        self.tau = np.where(self.on, tau, 1.0)
        self.decay = np.exp(-period / self.tau)
        self.past = np.zeros((n, 2, len(tau)))  # last input, last output

    def __call__(self, signal: Array, fresh: Sequence[int] | None) -> Array:
        """(n, channels) out for (n, channels) in, one period later; or of `fresh` rows, which rest with this one."""
        rows: slice | list[int] = slice(None)
        if fresh is not None:
            rows = list(fresh)
            self.past[rows] = signal[:, None, :]
        past = self.past[rows]
        last, out = past[:, 0], past[:, 1]
        slope = (signal - last) / self.period
        gain = self.tau * (1 - self.decay)
        if self.high:
            new = out * self.decay + slope * gain
        else:
            new = signal - slope * self.tau + (out - last + slope * self.tau) * self.decay
        new = np.where(self.on, new, signal)
        self.past[rows] = np.stack([signal, new], axis=1)
        return new


class TwoPoles:
    """A second-order low-pass of damping ratio (channels,), 0 where there is none, late by tau (s); else as OnePole."""

    def __init__(self, tau: Array, ratio: Array, period: float, n: int) -> None:
        self.on = ratio > 0
        steps = [
            second_order_step(period, t, r) if r > 0 else (np.zeros(2), np.zeros(2), np.zeros((2, 2)))
            for t, r in zip(tau, ratio, strict=True)
        ]
        self.first, self.second, self.state = (np.array(each) for each in zip(*steps, strict=True))
        self.past = np.zeros((n, 3, len(tau)))  # last input, last output and its rate

    def __call__(self, signal: Array, fresh: Sequence[int] | None) -> Array:
        """(n, channels) out for (n, channels) in, one period later; or of `fresh` rows, which rest with this one."""
        if fresh is not None:
            self.past[list(fresh)] = np.stack([signal, signal, np.zeros_like(signal)], axis=1)
            return signal
        last, inner = self.past[:, 0], self.past[:, 1:]
        new = np.einsum("cij,njc->nic", self.state, inner)
        new += self.first.T * last[:, None] + self.second.T * signal[:, None]
        self.past = np.concatenate([signal[:, None], new], axis=1)
        return np.where(self.on, new[:, 0], signal)


class Settling:
    """An offset (channels,) that decays from the start with a time constant (channels,), s; else as OnePole."""

    def __init__(self, offset: Array, tau: Array, period: float, n: int) -> None:
        self.offset, self.decay = offset, np.exp(-period / np.where(tau > 0, tau, 1.0))
        self.past = np.ones((n, len(tau)))  # remaining share of the offset

    def __call__(self, signal: Array, fresh: Sequence[int] | None) -> Array:
        """(n, channels) out for (n, channels) in, one period later; or of `fresh` rows, which start with this one."""
        if fresh is not None:
            self.past[list(fresh)] = 1.0
            return signal + self.offset
        self.past *= self.decay
        return signal + self.offset * self.past


class FloorSensors:
    """Accelerometers of n frames: gain, leakage, lag and offset as in the C entry, at the control period."""

    def __init__(self, frame: FrameInput, period: float, n: int) -> None:
        storeys = len(frame.mass)

        def given(values: Array | None, neutral: float) -> Array:
            return np.full(storeys, neutral) if values is None else np.asarray(values, dtype=np.float64)

        self.gain, self.offset = given(frame.acc_gain, 1.0), given(frame.acc_offset, 0.0)
        share, ratio = given(frame.acc_leakage_share, 0.0), given(frame.acc_ratio, 0.0)
        lag, lag2 = given(frame.acc_lag, 0.0), given(frame.acc_lag2, 0.0)
        ratio = np.where(lag > 0, ratio, 0.0)
        leaks = [given(frame.acc_leakage, 0.0)]
        if share.any():
            leaks.append(given(frame.acc_leakage2, 0.0))
        self.share = share
        self.leaks = [OnePole(tau, period, n, high=True) for tau in leaks if len(leaks) > 1 or tau.any()]
        self.lags: list[OnePole | TwoPoles | Settling] = (
            [TwoPoles(lag, ratio, period, n)] if ratio.any() else []
        )
        poles = (np.where(ratio > 0, 0.0, lag), lag2)
        self.lags += [OnePole(tau, period, n, high=False) for tau in poles if tau.any()]
        settle = given(frame.acc_settle, 0.0)
        if settle.any():
            self.lags.append(Settling(settle, given(frame.acc_settle_time, 0.0), period, n))
        self.ideal = not (self.filters or self.offset.any() or (self.gain != 1.0).any())

    @property
    def filters(self) -> list[OnePole | TwoPoles | Settling]:
        """All sensors with a state."""
        return [*self.leaks, *self.lags]

    def read(self, acceleration: Array, fresh: Sequence[int] | None) -> Array:
        """(n, storeys) as read; or (rows, storeys) of rows that have just started."""
        if self.ideal:
            return acceleration
        signal = acceleration * self.gain
        if self.leaks:
            charges = [each(signal, fresh) for each in self.leaks]
            signal = charges[0] if len(charges) == 1 else charges[0] + self.share * (charges[1] - charges[0])
        for each in self.lags:
            signal = each(signal, fresh)
        return signal + self.offset

    def save(self, row: int) -> list[Array]:
        return [each.past[row].copy() for each in self.filters]

    def restore(self, row: int, past: Sequence[Array]) -> None:
        for each, values in zip(self.filters, past, strict=True):
            each.past[row] = values


def stem(name: str) -> str:
    """A measurement's name without its number."""
    return name.rstrip("0123456789").rstrip("_")


class Noise:
    """White noise on measurements; deviation: name, or the name without its number -> standard deviation, SI.

    Attributes: where, of the names there is any; all (names,), its standard deviation on each.
    """

    def __init__(self, deviation: Mapping[str, float], names: Sequence[str]) -> None:
        self.where: list[int] = []
        found: list[float] = []
        stems = {name: stem(name) for name in names}
        for key, value in deviation.items():
            if key not in stems and key not in stems.values():
                raise InputError(f"noise on {key!r}: no such measurement; there are: {', '.join(names)}")
            if not 0 <= value < math.inf:
                raise InputError(f"noise on {key!r} is {value}; allowed: >= 0")
        for k, name in enumerate(names):
            value = deviation.get(name, deviation.get(stems[name], 0.0))
            if value > 0:
                self.where.append(k)
                found.append(value)
        self.deviation = np.array(found)
        self.all = np.zeros(len(names))
        self.all[self.where] = self.deviation

    def add(self, values: Array, row: int, rng: np.random.Generator) -> None:
        """Onto row of values (n, names), in place."""
        if self.where:
            values[row, self.where] += self.deviation * rng.standard_normal(len(self.where))


class Accelerometers:
    """Accelerometers of n rows at p places with a bandwidth: the mean acceleration of every control period, from the
    velocities at its ends, through a Butterworth low-pass of the second order at the control period.

    bandwidth: Hz, below half of the control rate. Attributes: state (n, 3, p), all that the next reading depends on:
    the last velocities and the filter's. Raises InputError.
    """

    def __init__(self, bandwidth: float, period: float, n: int, places: int) -> None:
        require_positive("accelerometers", bandwidth=bandwidth)
        if bandwidth >= 0.5 / period:
            raise InputError(f"bandwidth is {bandwidth} Hz; allowed: below {0.5 / period:g}, half of the control rate")
        self._b, self._a = (part.tolist() for part in butter(2, bandwidth, fs=1 / period))
        self._period = period
        self.state = np.zeros((n, 3, places))

    def read(self, velocity: Array, fresh: Sequence[int] | None = None) -> Array:
        """(rows, p) m/s2 from velocities (rows, p) m/s; fresh: rows that have just started, None: all, a period on."""
        if fresh is not None:
            self.state[list(fresh)] = 0.0
            self.state[list(fresh), 0] = velocity
            return np.zeros_like(velocity)
        last, first, second = self.state[:, 0], self.state[:, 1], self.state[:, 2]
        mean = (velocity - last) / self._period
        found = self._b[0] * mean + first
        self.state[:, 0] = velocity
        self.state[:, 1] = self._b[1] * mean - self._a[1] * found + second
        self.state[:, 2] = self._b[2] * mean - self._a[2] * found
        return np.asarray(found)
