"""Between the samples of a record: smooth motions, and a command that a converter holds or a log's filter rounds.

A filter without delay, such as a converter's decimating one, turns a jump into a wave that begins before it. Between
the samples of such a log the sampling theorem's curve is right (Shannon 1949, doi:10.1109/JRPROC.1949.232969), and
straight lines take 15 % of what there is at a fifth of the sampling rate; between the samples of an unfiltered one
that curve overshoots and lines are the better approximation. A command that a converter puts out stays at a sample
until the next one: read along lines it comes half a sample early. The log itself says which it is where its command
jumps; where it does not, a model or a case says whether it is held (`Model.hold`), or the responses do.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import resample_poly

from mrdamp.records.sampling import Array

#: Samples on the finer clock for each of the log's: with more of them a frame's runs came no nearer.
FACTOR = 2
#: Share of the command's span that is a jump, the samples it may take, and those before it in which its wave runs.
_JUMP, _RISE, _WAVE = 0.3, 3, 12
#: Shares of a jump: by how much a wave goes the other way first, and how flat the command is before that.
_BEFORE, _FLAT = 0.004, 0.001
#: A command is held before and after a jump where it stays within this share of the jump for so many samples at least.
_HELD, _LEAST = 0.08, 6

#: A jump that a converter holds takes one sample, with constant samples before and after it: shares of the span.
_STEP, _CONSTANT = 0.05, 1e-3

#: Entry of a model's file if the command was sent as logged, with the ringing of a filter.
LOG, AS_SENT = "command_log", "as sent"
#: Entry if all channels went through the log's filter, which a record without jumps of the command cannot show.
LOGGER, FILTERED = "logger", "filtered"


def jumps(command: Array) -> bool:
    """True where a command (n,) jumps from one of its samples to the next few."""
    return bool(np.any(np.abs(command[_RISE:] - command[:-_RISE]) > _JUMP * np.ptp(command)))


def rings_before_jumps(command: Array) -> bool:
    """True where most jumps of a command (n,), out of rest, are led by a wave the other way."""
    span = float(np.ptp(command)) if len(command) else 0.0
    if not span > 0:
        return False
    ringing = []
    risen = np.abs(command[_RISE:] - command[:-_RISE]) > _JUMP * span
    for k in np.flatnonzero(risen[1:] & ~risen[:-1]) + 1:  # the last sample before the jump, or one earlier
        before = command[max(0, k - 2 * _WAVE) : max(0, k - _WAVE)]
        jump = float(command[k + _RISE] - command[k])
        if len(before) < _WAVE or float(np.ptp(before)) > _FLAT * abs(jump):
            continue
        wave = (command[k - _WAVE : k + _RISE] - before.mean()) / jump
        ringing.append(float(wave.min()) < -_BEFORE)
    return 2 * sum(ringing) > len(ringing)


def held(command: Array) -> bool:
    """True where the jumps of a command (n,) show that it is held: most lead from a constant to a constant at once."""
    span = float(np.ptp(command)) if len(command) else 0.0
    change = np.abs(np.diff(command))
    at = np.flatnonzero(change[1:-1] > _STEP * span) + 1
    if not span > 0 or not len(at):
        return False
    return bool(np.mean(np.maximum(change[at - 1], change[at + 1]) < _CONSTANT * span) > 0.5)


def without_waves(command: Array, fine: Array) -> Array | None:
    """A filtered command (n,), as it is on a finer clock (m,), without its filter's waves before and after jumps; None
    where there are none.

    The ringing is in the log and never was in the coil: a stage with memory of the command's path, such as a magnetic
    circuit, must not follow it. Around a jump between two constant levels the command is at these levels or between
    them; other parts stay as logged.
    """
    if not rings_before_jumps(command):
        return None
    n, factor, span = len(command), (len(fine) - 1) // (len(command) - 1), float(np.ptp(command))
    out = np.array(fine)
    risen = np.abs(command[_RISE:] - command[:-_RISE]) > _JUMP * span
    begins = np.flatnonzero(risen & ~np.r_[False, risen[:-1]])
    ends = np.flatnonzero(risen & ~np.r_[risen[1:], False]) + _RISE
    for k, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        first = max(begin - _WAVE, (ends[k - 1] + begin) // 2 if k else 0)
        last = min(end + _WAVE, (end + begins[k + 1]) // 2 if k + 1 < len(begins) else n - 1)
        before, after = command[first : begin - 1], command[end + 2 : last + 1]
        if min(len(before), len(after)) < _LEAST:
            continue
        levels = float(np.median(before)), float(np.median(after))
        allowed = _HELD * abs(levels[1] - levels[0])
        if max(np.abs(before - levels[0]).max(), np.abs(after - levels[1]).max()) < allowed:
            part = np.clip(out[first * factor : last * factor + 1], min(levels), max(levels))
            for level in levels:
                part[np.abs(part - level) < allowed] = level
            out[first * factor : last * factor + 1] = part
    return out


def finer(ground: Array, command: Array, filtered: bool, hold: bool = False) -> tuple[Array, Array]:
    """A ground's acceleration and a command (n,) on a clock `FACTOR` times as fine, ((n - 1) FACTOR + 1,) each.

    filtered: the log went through a filter. Without one a ground, which is smooth, runs along a cubic spline (lines
    between samples at 500 Hz leave out .1 % of a frame's motion). The command as by `between`.
    """
    n = len(ground)
    fine = np.arange((n - 1) * FACTOR + 1) / FACTOR
    motion = unfolded(ground, FACTOR) if filtered else CubicSpline(np.arange(n), ground)(fine)
    return motion, between(command, FACTOR, filtered, hold)


def between(command: Array, factor: int, filtered: bool, hold: bool) -> Array:
    """A command (n,) on a clock so many times as fine, ((n - 1) factor + 1,).

    Of a filtered log by the sampling theorem; held at its samples; else along lines.
    """
    size = (len(command) - 1) * factor + 1
    if filtered:
        return unfolded(command, factor)
    if hold:
        return np.repeat(command, factor)[:size]
    return np.interp(np.arange(size) / factor, np.arange(len(command)), command)


def unfolded(channel: Array, factor: int) -> Array:
    """A filtered channel (n,) on a clock so many times as fine, ((n - 1) factor + 1,), by the sampling theorem."""
    return np.asarray(resample_poly(channel, factor, 1, padtype="line")[: (len(channel) - 1) * factor + 1])


def logged(values: Array, filtered: bool, factor: int = FACTOR) -> Array:
    """A simulated channel (..., m) on such a clock as the logger takes it, at every `factor`th sample. On the log's own
    clock nothing is left to filter."""
    if not filtered or factor == 1:
        return values[..., ::factor]
    return np.asarray(resample_poly(values, 1, factor, axis=-1, padtype="line"))
