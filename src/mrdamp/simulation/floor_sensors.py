"""A frame's accelerometers sample by sample, as the C entry has them for whole records."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from mrdamp.model.core import Array, FrameInput


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


def second_order_step(dt: float, tau: float, ratio: float) -> tuple[Array, Array, Array]:
    """What the samples at both ends add to output and rate, (2,) each, and what becomes of those, (2, 2).

    y'' + 2 ratio w y' + w^2 y = w^2 x with w = 2 ratio / tau; exact for an x that is linear over dt.
    """
    w = 2 * ratio / tau
    system = np.zeros((4, 4))  # output, rate, input, its slope
    system[0, 1] = 1
    system[1] = -(w**2), -2 * ratio * w, w**2, 0
    system[2, 3] = 1
    moved = expm(system * dt)
    slope = moved[:2, 3] / dt
    return moved[:2, 2] - slope, slope, moved[:2, :2]
