"""How far a record moves and when: where to cut it, and why a law cannot be found in it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mrdamp.records.sampling import Array, derivative

#: Motion within this share of the record's range does not count: noise at rest would add up to a long path.
DEAD_BAND = 0.02
#: Share of the path that a record which is alone is fitted to; the rest evaluates the fit.
FITTED_SHARE = 2.0 / 3.0
#: A turning point counts where the motion goes back by this share of the range. A loop has two.
_TURN = 0.1
#: Below this ratio of a channel's range to its noise, a loop of force over displacement is not resolved.
_RESOLVED = 20.0
#: s, ratio of RMS displacement to RMS velocity of a sine of .1 Hz.
_SLOW = 10.0 / (2.0 * np.pi)
#: Of force times velocity, both RMS: a power below its negative is that of a turned sign. In 1,201 records of measured
#: and simulated dampers the least is +.04.
_DRIVES = 0.1
#: Of the largest force: what is left below it is rounding.
_ROUNDED = 1e-9


def path(x: Array) -> Array:
    """(n,) distance travelled up to each sample of a displacement (n,), m, of motions beyond the dead band.

    A displacement that is led through a backlash of `DEAD_BAND` times its range: noise at rest gives none.
    """
    half = 0.5 * DEAD_BAND * float(np.ptp(x))
    follower, total = float(x[0]), 0.0
    out = np.empty(len(x))
    for k, value in enumerate(x.tolist()):
        gap = value - follower
        if abs(gap) > half:
            step = gap - half if gap > 0 else gap + half
            follower += step
            total += abs(step)
        out[k] = total
    return out


def slowness(motions: Iterable[tuple[Array, Array]]) -> float:
    """How many times slower the fastest motion is than a sine of .1 Hz; at least 1. A law needs steps by its travel.

    motions: displacement (n,) m and velocity (n,) m/s of each record.
    """
    times = [float(np.std(x)) / max(float(np.sqrt(np.mean(np.square(v)))), 1e-300) for x, v in motions]
    return max(min(times, default=0.0) / _SLOW, 1.0)


def stroke_since_reversal(x: Array, back: float) -> Array:
    """(n,) distance from the last turning point. A turn counts after a reversal by `back` (m)."""
    out = np.empty(len(x))
    turn = extreme = float(x[0])
    direction = 0.0
    for k, value in enumerate(x.tolist()):
        if direction == 0.0:
            if abs(value - turn) > back:
                direction, extreme = (1.0 if value > turn else -1.0), value
        elif (value - extreme) * direction >= 0:
            extreme = value
        elif (extreme - value) * direction > back:
            turn, extreme, direction = extreme, value, -direction
        out[k] = value - turn
    return out


def share_of_stroke(x: Array) -> Array:
    """(n,) distance from the last turning point over the largest one, 0 to 1. A turn counts from `DEAD_BAND` on."""
    stroke = np.abs(stroke_since_reversal(x, DEAD_BAND * float(np.ptp(x))))
    return np.asarray(stroke / max(float(stroke.max()), 1e-30))


def cut(x: Array) -> int:
    """Sample at which a displacement (n,) has covered `FITTED_SHARE` of its path; of its time, where it stands still.

    Both sides of the cut move, wherever in the record the motion is.
    """
    covered = path(x)
    if not covered[-1] > 0:
        return round(FITTED_SHARE * (len(x) - 1))
    return int(np.searchsorted(covered, FITTED_SHARE * covered[-1]))


def turns(x: Array) -> int:
    """How often a displacement (n,) turns back by more than a tenth of its range."""
    least, count, up = _TURN * float(np.ptp(x)), 0, 0
    low = high = float(x[0])
    for value in x.tolist():
        low, high = min(low, value), max(high, value)
        if up >= 0 and value < high - least:
            count, up, low = count + (up > 0), -1, value
        elif up <= 0 and value > low + least:
            count, up, high = count + (up < 0), 1, value
    return count


def noise(x: Array) -> float:
    """Standard deviation of white noise on a channel (n,), from its third differences, which smooth motion has not."""
    return float(np.std(np.diff(x, 3)) / np.sqrt(20.0)) if len(x) > 3 else 0.0


def rate_ratio(x: Array, v: Array, sample_time: float) -> float:
    """A measured velocity (n,) over the rate of a displacement (n,): 1 where they agree or nothing moves, 0 where they
    have nothing to do with each other.

    Way by way over spans in which the displacement changes most, so that its noise does not count.
    """
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]))]) * sample_time
    spans = [2**k for k in range(max(int(np.log2(len(x) / 8)), 0) + 1)]
    span = max(spans, key=lambda s: float(np.mean((x[s::s] - x[:-s:s]) ** 2)))
    own, given = (y[span::span] - y[:-span:span] for y in (x, travelled))
    return float(own @ given / (own @ own)) if own.any() else 1.0


def driven(x: Array, force: Array, sample_time: float) -> str:
    """What is wrong where a damper would drive its rig, from displacement (n,) m and force (n,) N; empty where not.

    What a straight line over the displacement leaves of the force counts: a preload over an open path does work.
    """
    terms = np.column_stack([np.ones(len(x)), x])
    left, v = force - terms @ np.linalg.lstsq(terms, force)[0], derivative(x, sample_time)
    size, power = float(np.std(left)), float(np.mean(left * v))
    if size <= _ROUNDED * float(np.abs(force).max()) or not power < -_DRIVES * size * float(np.sqrt(np.mean(v**2))):
        return ""
    return (
        f"the damper would drive the rig (mean of force times velocity {power:.3g} W, without preload and stiffness):"
        " one of the two counts the other way"
    )


def faults(x: Array, force: Array) -> list[str]:
    """Why no law can be found in a displacement (n,) m and a force (n,) N: a phrase for each reason."""
    found = []
    if (count := turns(x)) < 2:
        said = "turns back only once" if count else "never turns back"
        found.append(f"the loop never closes: the rod {said}, and a loop takes two turns")
    if float(np.ptp(x)) < _RESOLVED * (error := noise(x)):
        found.append(
            f"too little motion: {1e3 * np.ptp(x):.3g} mm from end to end, with noise of {1e3 * error:.2g} mm"
        )
    if float(np.std(force)) < 2.0 * (error := noise(force)):
        found.append(f"the force is constant but for its noise ({np.mean(force):.4g} N, noise {error:.2g} N)")
    return found
