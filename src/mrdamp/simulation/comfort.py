"""Ride comfort: the frequency weighting Wk of ISO 2631-1 for vertical vibration."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from mrdamp.errors import InputError
from mrdamp.model.core import Array

#: ISO 2631-1:1997, table A.1, Wk: corner frequencies (Hz) and quality factors. 1, 2: limits of the band (Butterworth);
#: 3, 4: from acceleration to velocity; 5, 6: the upward step.
_F1, _F2, _F3, _F4, _F5, _F6 = 0.4, 100.0, 12.5, 12.5, 2.37, 3.35
_Q4, _Q5, _Q6 = 0.63, 0.91, 0.91
#: Sections of the digital filter, and its states.
SECTIONS, STATES = 4, 8


def wk(frequency: ArrayLike) -> NDArray[np.complex128]:
    """(...) the weighting Wk at frequencies (...) Hz: equations A.1 to A.4 of ISO 2631-1:1997."""
    p = 2j * np.pi * np.asarray(frequency, dtype=np.float64)
    found = np.ones(p.shape, dtype=np.complex128)
    for numerator, denominator in _sections():
        found *= np.polyval(numerator, p) / np.polyval(denominator, p)
    return found


def wk_sections(sample_time: float) -> Array:
    """(4, 6) second-order sections b0 b1 b2 1 a1 a2 of the same filter by the bilinear transform, for sample_time, s.

    At 1 ms its gain is within 2 % of `wk` up to 40 Hz and within 6 % up to 80 Hz. Raises InputError for steps too long
    for the band: above 2 ms.
    """
    if not 0 < sample_time <= 2e-3:
        raise InputError(
            f"weighted acceleration: a sample time of {sample_time} s; allowed: above 0 to 0.002 s"
        )
    return np.array([np.concatenate(signal.bilinear(b, a, 1 / sample_time)) for b, a in _sections()])


class BlockFilter:
    """The weighting of `steps` samples at once: y = of_state x + of_input u, x+ = state x + drive u.

    Attributes: of_state (steps, 8), of_input (steps, steps), state (8, 8), drive (8, steps). Rows are
    independent of each other.
    """

    def __init__(self, sample_time: float, steps: int) -> None:
        sections = wk_sections(sample_time)

        def answers(inputs: Array, starts: Array) -> tuple[Array, Array]:
            """Outputs (steps, k) and last states (8, k) of inputs (k, steps) from starts (k, 8)."""
            zi = starts.reshape(-1, SECTIONS, 2).swapaxes(0, 1)
            y, end = signal.sosfilt(sections, inputs, zi=zi)
            return y.T, end.swapaxes(0, 1).reshape(-1, STATES).T

        self.of_state, self.state = answers(np.zeros((STATES, steps)), np.eye(STATES))
        self.of_input, self.drive = answers(np.eye(steps), np.zeros((steps, STATES)))

    def __call__(self, x: Array, u: Array) -> tuple[Array, Array]:
        """Mean squares (n,) of the weighted samples, and the next states (n, 8), from states (n, 8) and samples
        (n, steps)."""
        y = (x[:, None, :] * self.of_state).sum(axis=-1) + (u[:, None, :] * self.of_input).sum(axis=-1)
        after = (x[:, None, :] * self.state).sum(axis=-1) + (u[:, None, :] * self.drive).sum(axis=-1)
        return (y * y).sum(axis=-1) / u.shape[1], after


def _sections() -> list[tuple[list[float], list[float]]]:
    """Numerator and denominator of each factor, highest power first."""
    w1, w2, w3, w4, w5, w6 = (2 * math.pi * f for f in (_F1, _F2, _F3, _F4, _F5, _F6))
    root = math.sqrt(2)
    return [
        ([1.0, 0.0, 0.0], [1.0, root * w1, w1 * w1]),
        ([w2 * w2], [1.0, root * w2, w2 * w2]),
        ([w4 * w4 / w3, w4 * w4], [1.0, w4 / _Q4, w4 * w4]),
        ([1.0, w5 / _Q5, w5 * w5], [1.0, w6 / _Q6, w6 * w6]),
    ]
