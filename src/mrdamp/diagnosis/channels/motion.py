"""The displacement in time, by the accelerometer; no law is needed.

The transfer function from a displacement that is late by d to the acceleration is -w^2 exp(i w d): its phase is a line
through the origin, besides that of the accelerometer's high pass, which falls with 1 / w.
Source: Bendat & Piersol (2010), Random Data, chapters 6 and 9 (delay, variance of a phase).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import signal

from mrdamp.diagnosis.channels.comparison import Compared, best_cause
from mrdamp.diagnosis.hypotheses.terms import Settings, Term
from mrdamp.model.core import Array
from mrdamp.records import Record

CHANNELS = ("displacement_m", "acceleration_m_s2")
#: Lines of the spectrum are compared from this coherence on, if the acceleration is that of the motion within a factor
#: of this (hum in both channels is not); Welch segments are a quarter of a record.
_COHERENT, _ALIKE, _SEGMENTS = 0.9, 1.5, 4
#: Least number of lines, and least ratio of their frequencies: in a sine any phase is some delay.
_LINES, _RANGE = 5, 2.0
#: rad; smallest error of the phase that is reported (one per cent of the acceleration).
_RESOLUTION = 0.01


def motion(records: Sequence[Record], terms: Sequence[Term], base: Settings) -> list[Compared]:
    """The comparison of the displacement with the acceleration; empty if no accelerometer sees enough frequencies.

    Errors are phases (rad), which are errors relative to the acceleration. base: settings of the nominal simulator.
    """
    if not all(set(CHANNELS) <= set(r.channels) for r in records):
        return []
    lines = [_phases(r) for r in records]
    w, phase, variance = (np.concatenate(part) for part in zip(*lines, strict=True))
    if len(w) < _LINES or w.max() < _RANGE * w.min():
        return []
    own = base.get("channel_shift_d", 0.0)
    noise = float(1 / np.sqrt(np.mean(1 / variance)))
    weight = noise / np.sqrt(variance)  # RMS 1
    coupled = weight / w

    def residual(settings: Settings) -> Array:
        error = weight * np.angle(np.exp(1j * (phase - w * settings.get("channel_shift_d", own))))
        return np.asarray(error - coupled * (coupled @ error) / (coupled @ coupled))

    late = [t for t in terms if t.effect == "channel_shift"]
    return [best_cause(CHANNELS, late, residual, noise, level=noise, resolution=_RESOLUTION)]


def _phases(record: Record) -> tuple[Array, Array, Array]:
    """Angular frequencies (rad/s), phases (rad) and their variances (lines,) where the two channels are coherent."""
    x, a = (np.asarray(record.channel(name)) for name in CHANNELS)
    how = {"fs": 1 / record.sample_time, "nperseg": record.n // _SEGMENTS}
    f, across = signal.csd(x, a, **how)
    w, own = 2 * np.pi * f, signal.welch(x, **how)[1]
    coherence = signal.coherence(x, a, **how)[1]
    alike = np.abs(np.log(np.maximum(np.abs(across), 1e-300) / np.maximum(w**2 * own, 1e-300))) < np.log(_ALIKE)
    kept = (coherence > _COHERENT) & alike
    c = coherence[kept]
    return w[kept], np.angle(-across[kept]), (1 - c) / (2 * c * _SEGMENTS)
