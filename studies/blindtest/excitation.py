"""Excitation of the rig: random motions, ground motions and commands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, chirp, sosfiltfilt

from studies.blindtest.rig import INPUT_RATE_HZ, Array

#: s, sample time of the grid on which motions and commands are drawn.
GRID_HZ = 2_000
_UPDATE = 4  # grid points from one command of the controller to the next


@dataclass(frozen=True, eq=False)
class Excitation:
    """One test's inputs on the grid. motion: the rod's displacement (m) or the ground's acceleration (m/s2).

    seed: for differences between runs.
    """

    kind: str
    motion: Array
    command: Array
    seed: int = 0

    @property
    def rng(self) -> np.random.Generator:
        """A generator with the test's seed, always in the same state."""
        return np.random.default_rng(self.seed)

    @property
    def duration(self) -> float:
        """s."""
        return (len(self.motion) - 1) / GRID_HZ

    @cached_property
    def time(self) -> Array:
        """Half steps of the rig, s."""
        return np.arange(round(self.duration * INPUT_RATE_HZ) + 1) / INPUT_RATE_HZ

    def fine(self, channel: Array) -> Array:
        """A channel of the grid at the rig's half steps, by linear interpolation."""
        return np.interp(self.time, np.arange(len(channel)) / GRID_HZ, channel)

    def spline(self) -> CubicSpline:
        """The motion as a smooth function of time, for velocity and acceleration."""
        return CubicSpline(np.arange(len(self.motion)) / GRID_HZ, self.motion)


@dataclass(frozen=True)
class Machine:
    """Limits of a damper's testing machine: stroke (m), velocity (m/s), and the damper's largest command."""

    stroke: float
    velocity: float
    command: float


def damper_tests(rng: np.random.Generator, machine: Machine, *, long: bool) -> list[Excitation]:
    """The tests of one damper case, without the repeat."""
    kinds = ["sine", "sine", "triangle", "steps", "sweep", "random", "sine_random"]
    if rng.random() < 0.15:
        kinds.remove(str(rng.choice(["triangle", "sweep", "sine"])))
    return [_seeded(rng, _damper_test(rng, machine, kind)) for kind in (*kinds, *(["long"] if long else []))]


def held_out_damper_tests(
    rng: np.random.Generator, machine: Machine, *, long: bool
) -> dict[str, Excitation]:
    """Tests outside all cases. long: includes a long test, for slow causes."""
    kinds = ("random", "sine_random", "steps", *(["long"] if long else []))
    return {f"h{k}_{kind}": _seeded(rng, _damper_test(rng, machine, kind)) for k, kind in enumerate(kinds, 1)}


def frame_tests(rng: np.random.Generator, command: float) -> list[Excitation]:
    """The tests of one frame case, without the repeat."""
    kinds = ("sweep_off", "quake_off", "quake_on", "quake_random", "quake_bang", "quake_random")
    return [_seeded(rng, _frame_test(rng, command, kind)) for kind in kinds]


def held_out_frame_tests(rng: np.random.Generator, command: float) -> dict[str, Excitation]:
    """Ground motions outside all cases."""
    return {
        "h1_random": _seeded(rng, _frame_test(rng, command, "quake_random")),
        "h2_bang": _seeded(rng, _frame_test(rng, command, "quake_bang")),
    }


def _damper_test(rng: np.random.Generator, machine: Machine, kind: str) -> Excitation:
    duration = {"sine": 5.0, "triangle": 5.0, "sweep": 10.0, "random": 10.0, "long": 24.0}.get(kind, 8.0)
    t = _grid(duration)
    constant = np.full(len(t), machine.command * rng.choice([0.0, 0.25, 0.5, 0.75, 1.0]))
    if kind == "random":
        return Excitation(kind, _random_motion(rng, machine, t), _random_command(rng, machine.command, t))
    if kind == "sweep":
        return Excitation(kind, _sweep(rng, machine, t), constant)
    low, high = {"long": (1.2, 2.5), "sine_random": (1.0, 3.0)}.get(kind, (0.4, 2.5))
    frequency = float(rng.uniform(low, high))
    amplitude = min(
        machine.stroke * rng.uniform(0.35, 0.9),
        machine.velocity * rng.uniform(0.6, 1) / (2 * np.pi * frequency),
    )
    motion = amplitude * np.sin(2 * np.pi * frequency * t)
    if kind in ("triangle", "steps"):
        motion = _rounded(
            lambda s: amplitude * 2 / np.pi * np.arcsin(np.sin(2 * np.pi * 0.6 * frequency * s)), t
        )
    if kind == "steps":
        return Excitation(kind, motion, _steps(rng, machine.command, t))
    if kind == "sine_random":
        return Excitation(kind, motion, _random_command(rng, machine.command, t))
    if kind == "long":
        constant = np.full(len(t), machine.command * rng.choice([0.5, 0.75]))
    return Excitation(kind, motion, constant)


def _seeded(rng: np.random.Generator, test: Excitation) -> Excitation:
    return replace(test, seed=int(rng.integers(2**32)))


def again(test: Excitation) -> Excitation:
    """The same test with another seed for the run."""
    return replace(test, seed=test.seed + 1)


def _updated(command: Array) -> Array:
    """A command as a 500 Hz controller outputs it, linear between its updates."""
    at = np.arange(len(command))
    return np.interp(at, at[::_UPDATE], command[::_UPDATE])


def _frame_test(rng: np.random.Generator, command: float, kind: str) -> Excitation:
    t = _grid(8.0)
    motion, _, drive = kind.partition("_")
    if motion == "sweep":
        low, high = rng.uniform(0.8, 1.2), rng.uniform(15, 22)
        ground = rng.uniform(0.8, 1.5) * chirp(t, low, t[-1], high, phi=-90) * np.clip(t / 0.1, 0, 1)
    else:
        ground = quake(rng, t)
    if drive == "random":
        u = _random_command(rng, command, t)
    elif drive == "bang":
        half = rng.uniform(0.25, 0.5)
        u = _updated(np.where((t / half).astype(int) % 2, 0.0, command))
    else:
        u = np.full(len(t), command if drive == "on" else 0.0)
    return Excitation(kind, ground, u)


def quake(rng: np.random.Generator, t: Array) -> Array:
    """Ground acceleration (m/s2): white noise filtered by the Kanai-Tajimi soil model, with an envelope.

    Kanai 1957, Tajimi 1960; soil frequency and damping are drawn around those of firm ground. Envelope t
    exp(-t) (Shinozuka, Sato 1967).
    """
    frequency, ratio = rng.uniform(2.0, 5.0), rng.uniform(0.3, 0.7)
    f = np.fft.rfftfreq(len(t), t[1])
    r = 1j * f / frequency
    soil = (1 + 2 * ratio * r) / (1 + 2 * ratio * r + r**2)
    shaped = np.fft.irfft(np.fft.rfft(rng.standard_normal(len(t))) * soil * (f > 0.3) * (f < 30), len(t))
    peak = rng.uniform(1.5, 3.0)
    shaped *= (t / peak) * np.exp(1 - t / peak)
    return np.asarray(shaped * rng.uniform(1.8, 3.8) / np.abs(shaped).max())


def _grid(duration: float) -> Array:
    return np.arange(round(duration * GRID_HZ) + 1) / GRID_HZ


def _rounded(path: Callable[[Array], Array], t: Array) -> Array:
    """A path with its corners smoothed over 3 ms, as by a testing machine."""
    margin = 60
    wide = np.arange(-margin, len(t) + margin) / GRID_HZ
    return np.asarray(gaussian_filter1d(path(wide), 6.0)[margin:-margin])


def _noise(rng: np.random.Generator, t: Array, low: float, high: float) -> Array:
    """Band-limited noise (Hz) with unit standard deviation."""
    margin = 2 * GRID_HZ
    sos = butter(2, [low, high], "bandpass", fs=GRID_HZ, output="sos")
    out = sosfiltfilt(sos, rng.standard_normal(len(t) + 2 * margin))[margin:-margin]
    return np.asarray(out / out.std())


def _random_motion(rng: np.random.Generator, machine: Machine, t: Array) -> Array:
    x = _noise(rng, t, 0.25, rng.uniform(2.0, 5.0))
    scale = min(machine.stroke / np.abs(x).max(), machine.velocity / np.abs(np.gradient(x, t)).max())
    return np.asarray(x * scale * rng.uniform(0.7, 1.0))


def _random_command(rng: np.random.Generator, command: float, t: Array) -> Array:
    wave = _noise(rng, t, 0.1, rng.uniform(1.5, 5.0))
    return _updated(np.clip(command * (0.5 + rng.uniform(0.35, 0.55) * wave), 0.0, command))


def _sweep(rng: np.random.Generator, machine: Machine, t: Array) -> Array:
    low, high = rng.uniform(0.3, 0.7), rng.uniform(6.0, 12.0)
    rate = np.log(high / low) / t[-1]
    frequency = low * np.exp(rate * t)
    amplitude = np.minimum(0.6 * machine.stroke, 0.7 * machine.velocity / (2 * np.pi * frequency))
    return np.asarray(amplitude * np.sin(2 * np.pi * (frequency - low) / rate))


def _steps(rng: np.random.Generator, command: float, t: Array) -> Array:
    """A new level about every half second."""
    ends = np.cumsum(rng.uniform(0.3, 0.8, size=40))
    levels = command * rng.choice([0.0, 0.25, 0.5, 0.75, 1.0], size=41)
    return _updated(levels[np.searchsorted(ends, t)])
