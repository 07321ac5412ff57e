"""What makes records unfit for an identification, reported in a line each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrdamp.errors import InputError
from mrdamp.records import Record
from mrdamp.records.motion import driven, faults
from mrdamp.records.sampling import Array

#: Samples that a fit needs for each free number.
SAMPLES_PER_COORDINATE = 20
#: A force is called clipped where its extreme value holds in runs of so many samples, ...
_RUN = 4
#: ... for more than this share of the record, and so many times as often as the next value to it.
_SHARE, _OVER_NEXT = 0.01, 4.0
#: A constant force has the error 1. A law that leaves this much of the force's standard deviation explains less than a
#: fifth of its variance; the worst fit of a law to measured records here, Bingham's to the embedded set, leaves .55.
NO_BETTER, _WORSE = 0.9, 1.1
#: What dampers and their rigs have, as the least and the largest, and what is said of it: range of the displacement
#: (m), size of force (N) and command (A or V), sampling rate (Hz), charge over force (pC/N; quartz 2, ceramics to 700 a
#: wafer). A channel beyond it is likely in mm, kN, mA, ms or nC.
_USUAL = {
    "displacement_m": (1e-4, 3.0, "displacement_m spans {:.3g} m"),
    "force_N": (2.0, 1e7, "force_N is up to {:.3g} N"),
    "reference_force_N": (2.0, 1e7, "reference_force_N is up to {:.3g} N"),
    "command": (0.0, 50.0, "command is up to {:.3g}"),
    "rate": (20.0, 1e5, "the clock runs at {:.3g} Hz, and every 0.5 ms is computed"),
    "sensitivity": (1.0, 1e4, "charge_pC is {:.3g} pC for each N of reference_force_N"),
}
_UNITS = "channels are in m, N, s, pC, and A or V"
#: A record of a set has another unit where a channel is so many times the set's median, or that part of it.
_SPREAD = 100.0


def check_channels(records: Sequence[Record], need: Sequence[str] = ("displacement_m", "force_N")) -> None:
    """Raises InputError where a record lacks one of the channels or holds a constant one."""
    for record in records:
        for name in need:
            values = record.channels.get(name)
            if values is None:
                raise InputError(f"{record.label}: no channel {name}; a fit needs it")
            if not float(np.ptp(values)) > 0:
                raise InputError(
                    f"{record.label}: channel {name} is constant ({values[0]:g}); nothing can be identified from it"
                )
        if set(need) >= {"displacement_m", "force_N"}:
            check_sign(record)


def check_sign(record: Record) -> None:
    """Raises InputError where the damper would drive its rig (`motion.driven`)."""
    if said := _sign(record):
        raise InputError(said)


def _sign(record: Record) -> str:
    if not {"displacement_m", "force_N"} <= set(record.channels):
        return ""
    said = driven(record.displacement, record.channel("force_N"), record.sample_time)
    return said and f"{record.label}: force_N: {said}; turn its sign"


def stroke_of(record: Record, floors: tuple[int, int]) -> Array | None:
    """Stroke (n,) m of a frame's damper between two floors, 0 the ground; None where their motion was not measured."""
    names = [f"floor{j}_displacement_m" for j in floors]
    if any(j and name not in record.channels for j, name in zip(floors, names, strict=True)):
        return None
    low, high = (record.channels[name] if j else np.zeros(record.n) for j, name in zip(floors, names, strict=True))
    return np.asarray(high - low)


def check_frame_sign(record: Record, floors: tuple[int, int]) -> None:
    """Raises InputError where the damper between two floors would drive its frame."""
    stroke = stroke_of(record, floors)
    if stroke is None or "force_N" not in record.channels:
        return
    if said := driven(stroke, record.channel("force_N"), record.sample_time):
        raise InputError(f"{record.label}: force_N: {said}; turn its sign")


def check_size(records: Sequence[Record], coordinates: int) -> None:
    """Raises InputError where the records are too short for so many free numbers."""
    total, need = sum(record.n for record in records), SAMPLES_PER_COORDINATE * coordinates
    if total < need:
        raise InputError(
            f"{records[0].label}: {total} samples to fit {coordinates} free numbers to; at least {need} are needed"
        )


def warnings_of(records: Sequence[Record]) -> list[str]:
    """What is likely a mistake of the records though a fit is possible: a line each."""
    sizes = [_sizes(record) for record in records]
    found: list[str] = []
    for record, own in zip(records, sizes, strict=True):
        found += [said] if (said := _sign(record)) else []
        for name, size in own.items():
            low, high, said = _USUAL[name]
            usual = float(np.median([other[name] for other in sizes if name in other]))
            if not low <= size <= high:
                found.append(f"{record.label}: {said.format(size)}; usual are {low:g} to {high:g}: {_UNITS}")
            elif size > 0 and usual > 0 and not 1 / _SPREAD < size / usual < _SPREAD:
                found.append(f"{record.label}: {said.format(size)}, the other records {usual:.3g}: {_UNITS}")
    return list(dict.fromkeys(found))  # both parts of one record say the same


def _sizes(record: Record) -> dict[str, float]:
    """What is compared with `_USUAL`, of the channels that there are."""
    found = {name: float(np.abs(x).max()) for name, x in record.channels.items() if name in _USUAL}
    if "displacement_m" in found:
        found["displacement_m"] = float(np.ptp(record.displacement))
    if {"charge_pC", "reference_force_N"} <= set(record.channels) and np.ptp(record.channel("reference_force_N")) > 0:
        charge, force = (float(np.ptp(record.channel(name))) for name in ("charge_pC", "reference_force_N"))
        found["sensitivity"] = charge / force
    return found | {"rate": 1.0 / record.sample_time}


def unexplained(records: Sequence[Record], nrmse: float) -> str:
    """Why a law with this error (over the force's standard deviation) explains no record; empty where it does."""
    if not nrmse >= NO_BETTER:
        return ""
    why = {
        record.label: "; ".join(found)
        for record in records
        if (found := faults(record.displacement, record.channel("force_N")))
    }
    name, said = next(iter(why.items()), (records[0].label, ""))
    said = said or "check the units, the sign of force_N, and that all channels share one clock"
    than = "no better than" if nrmse < _WORSE else "worse than"
    return f"{name}: the law explains this force {than} a constant ({nrmse:.3g} of its deviation): {said}"


def check_explained(records: Sequence[Record], nrmse: float) -> None:
    """Raises InputError where a fit with this error explains nothing of the records that it was made on."""
    if said := unexplained(records, nrmse):
        raise InputError(said)


def check_clipping(records: Sequence[Record]) -> None:
    """Raises InputError where a force stands at the end of its sensor's range."""
    for record in records:
        found = clipped(record.channel("force_N"))
        if found is not None:
            level, share = found
            raise InputError(
                f"{record.label}: channel force_N is clipped: {100 * share:.1f} % of the samples stand at {level:g} N;"
                " repeat the test with a wider range, or leave the record out"
            )


def clipped(force: Array) -> tuple[float, float] | None:
    """The level (N) that a force (n,) is cut off at and the share of the samples there; None where it is not. A pause
    at the beginning or the end of a record does not count."""
    for level, beyond in ((float(force.max()), 1.0), (float(force.min()), -1.0)):
        at = force == level
        edges = np.flatnonzero(np.diff(np.concatenate([[0], at.astype(int), [0]])))
        runs = [(low, high) for low, high in zip(edges[::2], edges[1::2], strict=True) if low > 0 and high < len(at)]
        share = float(at.mean())
        if share <= _SHARE or max((high - low for low, high in runs), default=0) < _RUN:
            continue
        # A coarse converter also dwells at a peak, but nearly as long at the step below it.
        rest = force[~at]
        next_level = rest.max() if beyond > 0 else rest.min()
        if at.sum() > _OVER_NEXT * (rest == next_level).sum():
            return level, share
    return None
