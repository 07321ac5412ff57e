"""What part of a time series a picture shows, and in what unit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mrdamp.errors import InputError

Array = NDArray[np.float64]
BINS = 400  # of a line over time: two points each, about what a screen resolves


def finite(what: str, values: ArrayLike, shape: tuple[int, ...] | None = None) -> Array:
    """The values as float64; shape None: one-dimensional, at least two values. Raises InputError."""
    array = np.asarray(values, dtype=np.float64)
    if (array.ndim != 1 or len(array) < 2) if shape is None else array.shape != shape:
        raise InputError(f"picture: {what} has shape {array.shape}; allowed: {shape or '(n,), n >= 2'}")
    if not np.isfinite(array).all():
        at = np.argwhere(~np.isfinite(array))[0][0]
        raise InputError(f"picture: {what} has a value that is not finite at sample {at}")
    return array


def time_axis(what: str, values: ArrayLike) -> Array:
    """Stamps (n,) s. Raises InputError where they do not increase."""
    array = finite(what, values)
    if not (np.diff(array) > 0).all():
        raise InputError(f"picture: {what} does not increase")
    return array


def mean_period(time: Array, x: Array) -> float:
    """Mean time between upward crossings of the mean, s; the whole duration where x hardly moves.

    Crossings smaller than a fifth of the standard deviation are noise and do not count.
    """
    y = x - x.mean()
    side = np.sign(np.where(np.abs(y) > 0.2 * y.std(), y, 0.0))
    side = side[side != 0]
    crossings = np.count_nonzero(np.diff(side))
    duration = float(time[-1] - time[0])
    return min(duration, 2 * duration / crossings) if crossings else duration


def busiest(time: Array, x: Array, periods: float, energy: Array | None = None) -> slice:
    """The part of a record that is so many mean periods of x long and holds most of the energy.

    energy: (n,) whose square is summed up, None: x less its mean.
    """
    n = len(time)
    length = periods * mean_period(time, x)
    count = min(n, max(2, round(length * (n - 1) / float(time[-1] - time[0])) + 1))
    signal = x - x.mean() if energy is None else energy
    total = np.concatenate([[0.0], np.cumsum(signal**2)])
    inside = total[count:] - total[:-count]
    # The first window that is as good as any: steady tests are then not shown by a chance of noise.
    start = int(np.argmax(inside >= 0.999 * inside.max()))
    return slice(start, start + count)


def thinned(part: slice, most: int) -> slice:
    """The slice with a step that leaves at most so many samples."""
    count = part.stop - part.start
    return slice(part.start, part.stop, max(1, -(-count // most)))


def outline(time: Array, x: Array, bins: int) -> tuple[Array, Array]:
    """Time and values of a line that looks the same: the least and the largest x of each of so many bins."""
    size = -(-len(x) // bins)
    if size <= 2:
        return time, x
    rows = np.pad(x, (0, -len(x) % size), mode="edge").reshape(-1, size)
    start = size * np.arange(len(rows))
    keep = np.unique(np.concatenate([[0, len(x) - 1], start + rows.argmin(1), start + rows.argmax(1)]))
    keep = keep[keep < len(x)]
    return time[keep], x[keep]


def staircase(time: Array, x: Array) -> tuple[Array, Array]:
    """The samples at which a zero-order-held signal changes, and the last one."""
    keep = np.r_[True, np.diff(x) != 0]
    keep[-1] = True
    return time[keep], x[keep]


def force_unit(*values: Array) -> tuple[float, str]:
    """Factor from N and name of the unit for forces of this size."""
    return (1e-3, "kN") if peak(*values) >= 1e4 else (1.0, "N")


def velocity_unit(*values: Array) -> tuple[float, str]:
    """Factor from m/s and name of the unit for velocities of this size."""
    return (1.0, "m/s") if peak(*values) >= 1.0 else (1e3, "mm/s")


def length_unit(*values: Array) -> tuple[float, str]:
    """Factor from m and name of the unit for motions of this size."""
    return (1e2, "cm") if peak(*values) >= 0.1 else (1e3, "mm")


def peak(*values: Array) -> float:
    """Largest magnitude, 0 for none."""
    return max((float(np.abs(v).max()) for v in values if v.size), default=0.0)


def padded(low: float, high: float) -> tuple[float, float]:
    """Limits of an axis that holds the range with a margin; never empty."""
    margin = 0.06 * (high - low) or 0.06 * max(abs(low), abs(high)) or 1.0
    return low - margin, high + margin


def check_series(data: Any, *fields: str) -> None:
    """Makes arrays of a dataclass' `time` (n,) and of its fields (n,), checked; `name` begins the line of an error."""
    time = time_axis(f"{data.name}: time", data.time)
    object.__setattr__(data, "time", time)
    for field in fields:
        object.__setattr__(data, field, finite(f"{data.name}: {field}", getattr(data, field), time.shape))
