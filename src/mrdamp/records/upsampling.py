"""Motion and command between the samples of a damper's record: cubic splines of the motion, and a command that is
held, filtered or along lines (`mrdamp.records.log_filter`).

Central differences at the samples underrate a fast motion's velocity, by 0.3 % at 10 Hz sampled at 500 Hz, and more
in the law's stiff states; between samples of a spline that error is gone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from mrdamp.errors import InputError
from mrdamp.records.log_filter import between
from mrdamp.records.sampling import Array

#: Steps of a run, which take 2 GB.
_MOST = 30_000_000


@dataclass(frozen=True, eq=False)
class FineInputs:
    """A record's inputs on a finer clock: displacement (m), velocity (m/s), acceleration (m/s2), command, (n,) each.

    factor: samples of it in one of the record's; every so many belong to the record's own. filtered: the record went
    through the log's filter, and what is simulated has to. hold: the command is held between samples.
    """

    factor: int
    sample_time: float
    x: Array
    v: Array
    a: Array
    u: Array
    filtered: bool = False
    hold: bool = False


#: An end is an artefact if its last sample breaks off _BREAK times as sharply as the motion does before and _LAST
#: times as sharply as in the samples just before: a filter bends the last sample, a motion that turns several. Set on
#: the tests of 40 exact and 10 open cases. Where continuing an end changes the force by more than .02 of its RMS, it is
#: right at ratios from 6.4 on and wrong below 1.5, by up to 1.5 RMS; smaller bends of the filter have 2 and more. Three
#: random motions, wrong at 3.2 to 5.7, are left to the comparison with their past.
_BREAK, _LAST, _BEFORE = 4.0, 1.7, 60
#: Samples that are continued, those that determine the continuation, a polynomial of this order, and the continuations
#: before the end that show whether the motion can be continued.
_ENDS, _FROM, _ORDER, _EARLIER = 6, 24, 5, 4


def repaired_ends(x: Array) -> Array:
    """The displacement (n,) with ends that a converter's filter bent put where the motion comes from and goes.

    A decimating filter has nothing to average beyond the first and last sample and bends the ends towards rest; the
    velocity then seems to break off, and the force with it. A motion that turns at its end, or that its past does not
    predict as well, is left.
    """
    return _repaired_tail(_repaired_tail(x)[::-1])[::-1]


def _repaired_tail(x: Array) -> Array:
    third = np.abs(np.diff(x[-_BEFORE:], 3))
    if len(x) < _BEFORE or third[-1] <= max(_BREAK * third[:-_ENDS].max(), _LAST * third[-_ENDS:-1].max()):
        return x
    departure, *earlier = (_departure(x[: len(x) - k * _ENDS]) for k in range(_EARLIER + 1))
    if np.abs(departure).max() <= max(np.abs(d).max() for d in earlier):
        return x
    out = np.array(x)
    out[-_ENDS:] -= departure
    return out


def _departure(x: Array) -> Array:
    """(_ENDS,) m, of the last samples from the continuation of those before them."""
    known = np.arange(-_ENDS - _FROM, -_ENDS)
    curve = np.polynomial.Polynomial.fit(known, x[known], _ORDER)
    return np.asarray(x[-_ENDS:] - curve(np.arange(-_ENDS, 0)))


def upsampled(
    x: Array, u: Array, sample_time: float, factor: int, *, filtered: bool = False, hold: bool = False
) -> FineInputs:
    """The inputs (n,) at `factor` points for each sample; velocity and acceleration are those of the spline."""
    if len(x) * factor > _MOST:
        raise InputError(
            f"a record of {len(x) * sample_time:.3g} s takes {len(x) * factor:.2g} steps; allowed: {_MOST:.0e}"
            " (is its time in s?)"
        )
    spline, fine = CubicSpline(np.arange(len(x)), x), np.arange((len(x) - 1) * factor + 1) / factor
    own, v, a = (spline(fine, k) / sample_time**k for k in range(3))
    del spline, fine  # of a long record: as large as what is returned
    return FineInputs(factor, sample_time / factor, own, v, a, between(u, factor, filtered, hold), filtered, hold)
