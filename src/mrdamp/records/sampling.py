"""Sampled signals: zero-phase low-pass, derivatives, another sample time. Shapes (n,), times in s."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from mrdamp.errors import InputError

Array = NDArray[np.float64]

_ORDER = 2  # run forward and back: fourth order in all, no phase


def lowpass(x: Array, sample_time: float, cutoff_hz: float) -> Array:
    """Butterworth low-pass run forward and backward (no delay). Gain one half at ``cutoff_hz``. Raises InputError: the
    cut-off is not between 0 and half the sampling rate."""
    nyquist = 0.5 / sample_time
    if not 0.0 < cutoff_hz < nyquist:
        raise InputError(f"cutoff_hz is {cutoff_hz:g}: it must lie between 0 and {nyquist:g} (half the rate)")
    sos = signal.butter(_ORDER, cutoff_hz, fs=1.0 / sample_time, output="sos")
    pad = min(int(6.0 / (sample_time * cutoff_hz)) + 3, len(x) - 1)
    return np.asarray(signal.sosfiltfilt(sos, x, padlen=pad), dtype=np.float64)


def memory(x: Array, sample_time: float, tau: float) -> Array:
    """First-order low-pass of a signal (n,) with time constant `tau` (s), causal, from its first value."""
    decay = float(np.exp(-sample_time / tau))
    out, _ = signal.lfilter([1 - decay], [1, -decay], x, zi=[decay * x[0]])
    return np.asarray(out)


def derivative(x: Array, sample_time: float) -> Array:
    """First derivative by central differences, second order to the ends. Needs three samples."""
    return np.asarray(np.gradient(x, sample_time, edge_order=2), dtype=np.float64)


def second_derivative(x: Array, sample_time: float) -> Array:
    """Second derivative by the three-point difference; the end values repeat their neighbours."""
    out = np.empty_like(x)
    out[1:-1] = (x[2:] - 2.0 * x[1:-1] + x[:-2]) / sample_time**2
    out[0], out[-1] = out[1], out[-2]
    return out


def resampled(x: Array, sample_time: float, new_time: float, *, filtered: bool = True) -> Array:
    """The signal at another sample time, by linear interpolation, from the first sample on.

    Where the rate falls by more than a third, the signal is low-passed at 0.4 of the new rate first
    (``filtered``), so that nothing folds back.

    Raises InputError: the new sample time is not a positive number, leaves under three samples, or would make more than
    1e8 of them.
    """
    duration = (len(x) - 1) * sample_time
    if not 0.0 < new_time <= 0.5 * duration * (1.0 + 1e-9) or duration / new_time > 1e8:
        raise InputError(
            f"sample time {new_time:g} s: it must lie between {duration / 1e8:g} and {duration / 2:g} s"
            f" for {duration:g} s of signal"
        )
    if filtered and new_time > 1.5 * sample_time:
        x = lowpass(x, sample_time, 0.4 / new_time)
    count = int(duration / new_time * (1.0 + 1e-12) + 1e-9) + 1
    new, old = np.arange(count) * new_time, np.arange(len(x)) * sample_time
    return np.asarray(np.interp(new, old, x), dtype=np.float64)
