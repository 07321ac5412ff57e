"""From records to what a network is trained on: channels at its sample time, parts, regressors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrdamp.errors import InputError
from mrdamp.model.core import Array
from mrdamp.narx.network import Input, check_inputs
from mrdamp.records import Record
from mrdamp.records.checks import check_channels, check_clipping
from mrdamp.records.motion import noise
from mrdamp.records.sampling import resampled

#: Samples for training, validation and test, at 500 Hz: Chen, Ni and Or (2015), Section 4.
PROTOCOL = (4000, 2000, 1500)
PROTOCOL_TIME = 2e-3  # s


@dataclass(frozen=True, eq=False)
class Series:
    """One part of one record at the network's sample time (s): x (m), v (m/s), i (command), F (N), (n,) each.

    noise: N, of the force as it was measured, before a change of rate; an upper bound, as corners count as noise.
    start: s, of the first sample on the record's clock.
    """

    name: str
    sample_time: float
    x: Array
    v: Array
    i: Array
    force: Array
    noise: float = float("nan")
    start: float = 0.0

    @property
    def n(self) -> int:
        return len(self.x)

    def part(self, start: int, stop: int, name: str | None = None) -> Series:
        cut = slice(start, stop)
        return replace(
            self, name=name or self.name, x=self.x[cut], v=self.v[cut], i=self.i[cut], force=self.force[cut],
            start=self.start + start * self.sample_time,
        )  # fmt: skip

    def regressors(self, inputs: Sequence[Input]) -> Array:
        """(n, inputs) in physical units: every input's channel, shifted by its lag.

        In front of the first sample: x and i as there, no v, no force, as the plugin starts.
        """
        columns = []
        for channel, lag in inputs:
            y = self.force if channel == "F" else getattr(self, channel)
            before = np.full(min(lag, self.n), y[0] if channel in "xi" else 0.0)
            columns.append(np.concatenate([before, y[: max(self.n - lag, 0)]]))
        return np.stack(columns, axis=1)


def lagged(channels: str = "viF", lags: int = 4) -> tuple[Input, ...]:
    """Inputs of a lag space: x, v, i at lags 0 to `lags`, F at 1 to `lags` + 1 (Eq. 11 of Chen, Ni and Or). Raises
    InputError."""
    inputs = tuple((channel, lag + (channel == "F")) for channel in channels for lag in range(lags + 1))
    check_inputs(inputs)
    return inputs


def series(record: Record, sample_time: float | None = None) -> Series:
    """A damper record's channels at the network's sample time (s); None: the record's own.

    The velocity is formed at the record's own rate, where differences are accurate, and resampled with the rest. Raises
    InputError: the force is missing, the displacement or the force is constant, or the force is clipped.
    """
    force = record.channel("force_N")
    check_channels([record], ("displacement_m", "force_N"))
    check_clipping([record])
    old, new = record.sample_time, sample_time or record.sample_time

    def at_new(values: Array, smooth: bool = True) -> Array:
        same = abs(new / old - 1.0) < 1e-6
        return values if same else resampled(values, old, new, filtered=smooth)

    x, v = at_new(record.displacement), at_new(record.velocity())
    command, begin = at_new(record.command, smooth=False), float(record.time[0])
    return Series(record.name, new, x, v, command, at_new(force), noise(force), begin)


def counted(record: Record, sample_time: float | None = None) -> Series:
    """`series` without the samples that lead into the record."""
    made = series(record, sample_time)
    return made.part(round(record.lead * record.sample_time / made.sample_time), made.n)


def protocol(
    record: Record, counts: tuple[int, int, int] = PROTOCOL, sample_time: float = PROTOCOL_TIME
) -> tuple[Series, Series, Series]:
    """Training, validation and test part of one record, in time order, without a common sample. Raises InputError for a
    record of fewer samples."""
    whole = series(record, sample_time)
    ends = np.cumsum((0, *counts))
    if whole.n < ends[-1]:
        raise InputError(f"{record.label}: {whole.n} samples at {sample_time:g} s; {ends[-1]} are needed")
    train, validation, test = (
        whole.part(int(ends[k]), int(ends[k + 1]), f"{whole.name}:{name}")
        for k, name in enumerate(("train", "validation", "test"))
    )
    return train, validation, test


def check(train: Sequence[Series], inputs: Sequence[Input], weights: int) -> None:
    """Raises InputError where these parts cannot train such a network: too few samples, a constant input."""
    if not train:
        raise InputError("no record to train on")
    samples = sum(s.n for s in train)
    lag = max(lag for _, lag in inputs)
    shortest = min(train, key=lambda s: s.n)
    if shortest.n < 10 * (lag + 1):
        raise InputError(
            f"{shortest.name}: {shortest.n} samples for lags up to {lag}; at least {10 * (lag + 1)} are needed"
        )
    if samples < 2 * weights:
        raise InputError(f"{samples} samples for {weights} weights; at least {2 * weights} are needed")
    for channel in {channel for channel, _ in inputs} - {"F"}:
        values = np.concatenate([getattr(s, channel) for s in train])
        if not np.ptp(values) > 0.0:
            what = "the command never varies" if channel == "i" else f"channel {channel} is constant"
            raise InputError(
                f"{train[0].name}: {what} in the training records; leave {channel} out of the inputs"
            )
    if len({round(s.sample_time, 9) for s in train}) > 1:
        raise InputError("the training records have different sample times; give one to resample to")


def scaling(train: Sequence[Series], inputs: Sequence[Input]) -> tuple[Array, Array, float, float]:
    """offset (inputs,), scale (inputs,), force offset and scale that take the training data to [-1, 1]."""
    spans: dict[str, tuple[float, float]] = {}
    for channel, name in (("x", "x"), ("v", "v"), ("i", "i"), ("F", "force")):
        low = min(float(getattr(s, name).min()) for s in train)
        high = max(float(getattr(s, name).max()) for s in train)
        spans[channel] = (0.5 * (low + high), 0.5 * (high - low) or 1.0)
    offset = np.array([spans[channel][0] for channel, _ in inputs])
    half = np.array([spans[channel][1] for channel, _ in inputs])
    return offset, 1.0 / half, *spans["F"]
