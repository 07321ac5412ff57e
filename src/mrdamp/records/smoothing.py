"""Smoothing of a measured displacement: local polynomials whose window adapts to the motion at each sample.

The window is the longest one whose fit agrees with those of all shorter windows within the noise
(intersection of confidence intervals: Goldenshluger, Nemirovski 1997). The corner of a triangle stays a
corner, and a sine is averaged over many samples. Smoothing is needed because the force depends on the
velocity: noise of 1 um at 500 Hz is 0.35 mm/s.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import minimum_filter1d, uniform_filter1d
from scipy.signal import savgol_coeffs, savgol_filter

from mrdamp.model.core import Array

_WINDOWS = (5, 7, 11, 15, 21, 31, 45)
_ORDER = 3
#: Width of the confidence intervals, in standard deviations.
_WIDTH = 3.0


def noise_level(x: Array) -> float:
    """Standard deviation of white noise on a smooth signal (n,), from its fifth differences.

    The median over the record excludes parts with corners or fast motion.
    """
    if len(x) < 20:
        return 0.0
    fifth = np.diff(x, 5)
    return float(np.median(np.abs(fifth)) / 0.6745 / np.sqrt(252.0))  # 252: sum of squares of binomials of 5


def smoothed(x: Array, sigma: float | None = None) -> Array:
    """Displacement (n,) without white noise of standard deviation sigma (None: estimated); no delay."""
    sigma = noise_level(x) if sigma is None else sigma
    if not sigma > 0 or len(x) < 3 * _WINDOWS[-1]:
        return np.asarray(x)
    fits = [np.asarray(x)]
    widths = [1.0]
    for window in _WINDOWS:
        fits.append(savgol_filter(x, window, _ORDER, mode="interp"))
        widths.append(float(np.sqrt(np.sum(savgol_coeffs(window, _ORDER) ** 2))))
    low = fits[0] - _WIDTH * sigma * widths[0]
    high = fits[0] + _WIDTH * sigma * widths[0]
    going = np.ones(len(x), dtype=bool)
    level = np.zeros(len(x))
    for k in range(1, len(fits)):
        low = np.maximum(low, fits[k] - _WIDTH * sigma * widths[k])
        high = np.minimum(high, fits[k] + _WIDTH * sigma * widths[k])
        going &= low <= high
        level[going] = k
    # Near a corner, too long a window is detected at some samples only; the choice is therefore smoothed.
    level = uniform_filter1d(minimum_filter1d(level, 15), 15)
    below = np.floor(level).astype(int)
    share = level - below
    table = np.vstack(fits)
    index = np.arange(len(x))
    above = np.minimum(below + 1, len(fits) - 1)
    return np.asarray((1 - share) * table[below, index] + share * table[above, index])
