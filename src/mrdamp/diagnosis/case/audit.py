"""Audit of the records before any simulation; one line for each finding."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from scipy.signal import welch

from mrdamp.diagnosis.case.folder import Case
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.checks import clipped
from mrdamp.records.sampling import derivative

#: Shares of samples above which repeated samples and coarse quantisation are reported.
_HELD, _COARSE = 0.05, 0.02
#: Longest window of a moving average (samples; below 5 it has one zero), depth (dB) of all its zeros; fall of the
#: spectrum of the differences (dB) towards the Nyquist frequency from .65 of it, and within a tenth of it. Averages of
#: 5 and 12 samples have 39 and 36 dB; a low-pass filter at .24 of that frequency falls by 17 and 44 dB. The channels of
#: three measured rigs, logged as they are, have up to 16, 9 and 11 dB.
_LONGEST, _ZEROS, _FALL, _EDGE = 40, 20.0, 12.0, 25.0
#: s, start of a frame's record, and speed of a floor in it, over its standard deviation, from which it moves. Hz, band
#: in which displacement and acceleration are compared, and how many times as well they belong together without the
#: ground's motion where one of them is not as it should be. RMS over the floors of an acceleration in two samples, over
#: its standard deviation, from which it moves. Of 18 frames of other makers none is told of; the last has .02 there.
_START, _MOVING, _BAND, _OTHER, _SHAKEN = 0.05, 0.2, (0.5, 15.0), 10.0, 0.1


def audit(case: Case) -> Iterator[str]:
    """Findings: clipping, repeated samples, coarse quantisation, processing, repeats without an original. A finding
    that many records share is reported once."""
    repeated: dict[str, dict[str, float]] = {}
    processed: dict[str, list[str]] = {}
    for record in case.records:
        for name, values in record.channels.items():
            if name in ("time_s", "command") or not float(np.ptp(values)) > 0:
                continue
            cut, repeats = clipped(values), repeated_share(values)
            if cut is not None:
                yield f"{record.name}: {name} is clipped at {cut[0]:g} for {100 * cut[1]:.1f} % of the samples"
            elif repeats > _HELD:
                repeated.setdefault(name, {})[record.name] = 100 * repeats
            # Of a frame its own motion falls towards high frequencies.
            how = processing(values, fall=not name.startswith("floor"))
            if how is not None:
                processed.setdefault(f"{name} {how}", []).append(record.name)
            step = quantum(values)
            if step > _COARSE * float(np.std(values)):
                yield f"{record.name}: {name} comes in steps of {step:g}"
    yield from of_frame(case.records)
    for name, shares in repeated.items():
        low, high = min(shares.values()), max(shares.values())
        of = next(iter(shares)) if len(shares) == 1 else f"{len(shares)} records"
        much = f"{high:.0f} %" if len(shares) == 1 else f"{low:.0f} to {high:.0f} %"
        yield f"{of}: {name} repeats its last value in {much} of the samples"
    for how, names in processed.items():
        of = names[0] if len(names) == 1 else f"{len(names)} records"
        yield f"{of}: {how}: lags and noise are not the sensor's; take the raw channel if there is one"
    for repeat, original in case.repeats:
        if original is None:
            yield f"{repeat.name}: no record has the same input; it is left aside"


def repeated_share(values: Array) -> float:
    """Share of the samples that repeat the one before, without the rest at both ends of a record."""
    moving = np.flatnonzero(np.diff(values))
    return float(np.mean(np.diff(values[moving[0] : moving[-1] + 2]) == 0))


def of_frame(records: Sequence[Record]) -> Iterator[str]:
    """Of a frame: records that begin in motion, and floors whose displacement and acceleration do not belong together,
    as the one is relative to the table and the other absolute."""
    moving, apart = [], dict[str, list[str]]()
    for r in records:
        floors = [name.removesuffix("_displacement_m") for name in r.channels if name.endswith("_displacement_m")]
        shaken = [x for name, x in r.channels.items() if name.startswith("floor") and name.endswith("_m_s2")]
        if _shaken(shaken) or any(_moves(r.channel(f"{floor}_displacement_m"), r.sample_time) for floor in floors):
            moving.append(r.name)
        for floor in floors:
            if f"{floor}_acceleration_m_s2" in r.channels and not _relative(r, floor):
                apart.setdefault(floor, []).append(r.name)
    if moving:
        yield (
            f"{', '.join(moving)}: begins in motion; a frame is simulated from rest, and the motion that it begins with"
            " is told as a gap"
        )
    for floor, names in apart.items():
        yield (
            f"{', '.join(names)}: {floor}: displacement and acceleration do not belong together: give the displacement"
            " relative to the table, and the absolute acceleration"
        )


def _shaken(accelerations: Sequence[Array]) -> bool:
    """True if the floors' absolute accelerations (n,) are not those of a frame at rest in their first two samples."""
    if not accelerations:
        return False
    shares = [float(np.mean((a[:2] - a.mean()) ** 2) / max(np.var(a), 1e-300)) for a in accelerations]
    return float(np.mean(shares)) > _SHAKEN**2


def _moves(x: Array, dt: float) -> bool:
    """True if a displacement (n,) m moves at its start; a line through it, as noise has a derivative of its own."""
    count = max(round(_START / dt), 4)
    speed = np.polyfit(dt * np.arange(count), x[:count], 1)[0]
    return bool(abs(speed) > _MOVING * float(np.std(derivative(x, dt))))


def _relative(record: Record, floor: str) -> bool:
    """False where a floor's acceleration is the second derivative of its displacement without the ground's."""
    names = f"{floor}_displacement_m", f"{floor}_acceleration_m_s2", "ground_acceleration_m_s2"
    window = np.hanning(record.n)
    x, a, ground = (np.fft.rfft(window * (v - np.mean(v))) for v in (record.channel(name) for name in names))
    w = 2 * np.pi * np.fft.rfftfreq(record.n, record.sample_time)
    band = (w > 2 * np.pi * _BAND[0]) & (w < 2 * np.pi * _BAND[1])
    own, without = (float(np.sum(np.abs(-(w**2) * x - of)[band] ** 2)) for of in (a - ground, a))
    return own < _OTHER * without


def quantum(values: Array) -> float:
    """Quantisation step of a signal (n,): the smallest difference of values if there are few different
    values; else 0."""
    levels = np.unique(values)
    if len(levels) < 2 or len(levels) > 0.2 * len(values):
        return 0.0
    return float(np.min(np.diff(levels)))


def processing(values: Array, *, fall: bool = True) -> str | None:
    """What the spectrum of a signal (n,) shows of a filter: the zeros of a moving average, or a fall towards the
    Nyquist frequency, where noise of a sensor or of quantisation is white. None if it shows neither, or if there are
    too few samples. fall: whether the second is a sign."""
    n = min(len(values), 2048)
    if n < 256:
        return None
    level = 10 * np.log10(welch(np.diff(values), window="blackmanharris", nperseg=n - 1)[1][1:] + 1e-300)
    for window in range(_LONGEST, 4, -1):
        zeros = [round(k * n / window) - 1 for k in range(1, window) if 0.08 < k / window < 0.49]
        if len(zeros) > 1 and min(_depth(level, k, n // window) for k in zeros) > _ZEROS:
            return f"is a moving average over {window} samples"
    edges = np.round(n * np.arange(0.1, 0.5, 0.025)).astype(int)
    bands = np.array([np.median(level[a:b]) for a, b in pairwise(edges)])
    fallen = bands[-7] - bands[-2:].min() > _FALL or np.max(bands[:-4] - bands[4:]) > _EDGE
    return "is low-pass filtered or resampled" if fallen and fall else None


def _depth(level: Array, at: int, width: int) -> float:
    """dB, of a spectrum's level at an index below the levels to both sides, a quarter to a half of `width` away."""
    low, high = max(width // 4, 2), max(width // 2, 4)
    beside = np.concatenate([level[max(at - high, 0) : max(at - low, 1)], level[at + low : at + high]])
    return float(np.median(beside) - np.min(level[max(at - 1, 0) : at + 2]))
