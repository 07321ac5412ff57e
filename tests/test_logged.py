"""What lies between the samples of a frame's records: filtered and unfiltered logs of a command that jumps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, firwin, lsim, lti, sosfilt

from mrdamp.model.core import Array
from mrdamp.records.log_filter import FACTOR, finer, jumps, logged, rings_before_jumps

RATE, EVERY = 500.0, 40
DT = 1 / RATE


def fine_steps(seconds: float = 4.0) -> Array:
    """A command that jumps at times off the log's grid, at EVERY times its rate."""
    t = np.arange(int(seconds * RATE) * EVERY) / (RATE * EVERY)
    return np.where((t * 1.37 + 0.2) % 1.0 < 0.5, 1.2, 0.0)


def decimated(x: Array) -> Array:
    """A converter's log: a linear-phase filter whose delay it takes off, then every sample of the slow clock."""
    taps = firwin(20 * EVERY + 1, 0.92 / EVERY, window=("kaiser", 6.0))
    padded = np.concatenate([np.full(10 * EVERY, x[0]), x, np.full(10 * EVERY, x[-1])])
    return np.convolve(padded, taps, mode="valid")[::EVERY]


def oscillator(force: Array, dt: float) -> Array:
    """Acceleration of 1 kg on a spring of 110 Hz with 3 % of critical damping; the force runs along lines."""
    w = 2 * np.pi * 110.0
    return np.asarray(lsim(lti([1, 0, 0], [1, 0.06 * w, w**2]), force, dt * np.arange(len(force)))[1])


def test_only_a_filter_without_delay_rings_before_a_jump() -> None:
    fine = fine_steps()
    assert rings_before_jumps(decimated(fine))
    assert not rings_before_jumps(fine[::EVERY])
    late = sosfilt(butter(4, 200.0, fs=RATE * EVERY, output="sos"), fine)[::EVERY]
    assert not rings_before_jumps(late)  # it rings after the jump alone
    t = DT * np.arange(2000)
    assert not rings_before_jumps(0.5 + 0.4 * np.sin(2 * np.pi * 3 * t))
    assert not rings_before_jumps(np.full(500, 0.7))
    assert not rings_before_jumps(np.array([0.0, 1.0]))
    noisy = decimated(fine) + 0.01 * np.random.default_rng(1).standard_normal(len(t))
    assert not rings_before_jumps(noisy)  # where noise hides it, lines stay


def test_jumps_are_told_from_what_only_moves_fast() -> None:
    fine = fine_steps()
    assert jumps(fine[::EVERY])
    assert jumps(decimated(fine))
    t = DT * np.arange(2000)
    assert not jumps(np.sin(2 * np.pi * 5 * t))
    assert not jumps(np.zeros(100))


def test_a_filtered_jump_sets_off_what_the_real_one_did() -> None:
    """Against the oscillator under the real jumps, at 20 kHz, its acceleration through the same converter."""
    real = fine_steps()
    want = decimated(oscillator(real, 1 / (RATE * EVERY)))
    log = decimated(real)

    def error(got: Array) -> float:
        keep = slice(50, len(want) - 50)
        return float(np.sqrt(np.mean((got - want)[keep] ** 2) / np.mean(want[keep] ** 2)))

    _, command = finer(np.zeros(len(log)), log, True)
    assert len(command) == (len(log) - 1) * FACTOR + 1
    lines = error(oscillator(log, DT))
    curve = error(logged(oscillator(command, DT / FACTOR), True))
    assert curve < 0.3 * lines
    assert curve < 0.06


def test_an_unfiltered_log_keeps_its_lines_and_its_ground_runs_smoothly() -> None:
    t, jump = DT * np.arange(400), fine_steps(0.8)[::EVERY]
    fine_t = DT / FACTOR * np.arange(2 * 400 - 1)
    tone = np.sin(2 * np.pi * 12 * t)
    ground, command = finer(tone, jump, False)
    np.testing.assert_array_equal(command, np.interp(fine_t, t, jump))
    smooth, straight = (
        np.abs(g - np.sin(2 * np.pi * 12 * fine_t)).max() for g in (ground, np.interp(fine_t, t, tone))
    )
    assert smooth < 0.1 * straight
    np.testing.assert_array_equal(logged(np.vstack([ground, command]), False), np.vstack([tone, jump]))


def test_what_the_log_can_hold_passes_a_filtered_clock_and_back() -> None:
    t = DT * np.arange(600)
    tone = np.sin(2 * np.pi * 90 * t + 0.3)
    ground, _ = finer(tone, tone, True)
    keep = slice(30, -30)
    assert logged(ground, True)[keep] == pytest.approx(tone[keep], abs=5e-3)
