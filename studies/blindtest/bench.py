"""The test bench: command line, rod, sensors, and a logger with 500 samples per second."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import bessel, bilinear, butter, lfilter, resample_poly, sosfilt, sosfilt_zi

from studies.blindtest import rig
from studies.blindtest.excitation import Excitation
from studies.blindtest.rig import INPUT_RATE_HZ, RATE_HZ, Array, Numbers

SAMPLE_RATE_HZ = 500.0


@dataclass(frozen=True)
class Truth:
    """A rig with its causes: parameters of `rig.c`, and those of the bench by `command.`, `rod.`, `sensor.`,
    `reading.`.

    filtered: the logger has an anti-alias filter on all channels; otherwise it samples without one. storeys,
    between: of a frame (parameters of its storeys; floors between which the damper acts).
    """

    numbers: Numbers
    outside: Numbers = field(default_factory=dict)
    filtered: bool = False
    storeys: Sequence[Numbers] = ()
    damper_floors: tuple[int, int] = (0, 1)

    def having(self, changes: Numbers) -> Truth:
        """The same rig with a cause added. `storey2.damping` is relative for mass, stiffness and damping."""
        storeys = [dict(s) for s in self.storeys]
        inner, outside = dict(self.numbers), dict(self.outside)
        for name, value in changes.items():
            part, _, rest = name.partition(".")
            if part.startswith("storey"):
                floor = storeys[int(part[-1]) - 1]
                relative = rest in ("mass", "stiffness", "damping")
                floor[rest] = floor[rest] * (1 + value) if relative else value
            elif rest:
                outside[name] = value
            else:
                inner[name] = value
        return replace(self, numbers=inner, outside=outside, storeys=tuple(storeys))

    def get(self, name: str) -> float:
        return self.outside.get(name, 0.0)


def damper_channels(truth: Truth, test: Excitation, rng: np.random.Generator) -> dict[str, Array]:
    """Channels of one test on the damper, without noise, at 500 Hz. rng: for differences between runs."""
    motion = test.spline()
    x, v, u = motion(test.time), motion(test.time, 1), test.fine(test.command)
    current = _interrupted(truth, driven(truth, u, rng), v, rng)
    out = rig.run_damper(truth.numbers, x, v, current)
    force = out["force"] + _moving_mass(truth, motion(test.time[::2], 2))
    force = force + out["fluid"] * truth.get("rod.unsteady") * _slow_noise(rng, len(force))
    if truth.get("rod.leaks") > 0:
        force = force - out["fluid"] * truth.get("rod.leaks") * _now_and_then(rng, len(force))
    channels = {
        "displacement_m": as_read(truth, test)[::2],
        "command": u[::2],
        "force_N": sensor(truth, "sensor", force, rng) + truth.get("sensor.talk") * out["current"],
        "reference_force_N": force,
        "current_A": out["current"],
        "temperature_C": 22.0 + out["heat"],
    }
    return {name: logged(truth, values) for name, values in channels.items()}


def nominal_damper(nominal: Numbers, truth: Truth, test: Excitation) -> Array:
    """Force (N) at 500 Hz of a damper without causes for the measured inputs, as its simulator would give it.
    """
    x = as_read(truth, test)
    out = rig.run_damper(nominal, x, np.gradient(x, 1 / INPUT_RATE_HZ), test.fine(test.command))
    return logged(truth, out["force"])


def as_read(truth: Truth, test: Excitation) -> Array:
    """Displacement (m) at half steps as the transducer measures it: with delay, lead, averaging, or a clock
    error."""
    motion = test.spline()
    if truth.get("reading.average") > 0:
        return _average(motion(test.time), round(2 * truth.get("reading.average") * INPUT_RATE_HZ))
    if truth.get("reading.slack") > 0:
        return test.fine(_play(test.motion, truth.get("reading.slack") / 2))
    late = truth.get("reading.shift") + truth.get("reading.drift") * test.time
    return np.asarray(motion(np.clip(test.time - late, 0.0, test.duration)))


def driven(truth: Truth, u: Array, rng: np.random.Generator) -> Array:
    """The command (at half steps) that reaches the coil: with delay, quantisation, drop-outs, or another
    gain."""
    t = np.arange(len(u)) / INPUT_RATE_HZ
    out = np.interp(_sent(truth, t, rng), t, u)
    if truth.get("command.step") > 0:
        out = truth.get("command.step") * np.round(out / truth.get("command.step"))
    for start, end in _spells(rng, t[-1], 0.5, truth.get("command.dropouts"), (0.1, 0.5)):
        out[(t > start) & (t < end)] = 0.0
    if truth.get("command.drift") > 0:
        out = out * (1 + truth.get("command.drift") * rng.uniform(-1, 1))
    return np.asarray(out)


def _sent(truth: Truth, t: Array, rng: np.random.Generator) -> Array:
    """Time (s) at which the value arriving at t was sent: each `command.beat` has its own delay, in order."""
    delay, beat = truth.get("command.delay"), truth.get("command.beat")
    if not beat:
        return t - delay
    spread = rng.uniform(-1, 1, int(t[-1] / beat) + 1)[(t / beat).astype(int)]
    return np.asarray(np.maximum.accumulate(t - delay * (1 + truth.get("command.jitter") * spread)))


def _interrupted(truth: Truth, u: Array, v: Array, rng: np.random.Generator) -> Array:
    """The current with a loose contact that opens in bursts while the rod moves fast."""
    share = truth.get("command.contact")
    if not share:
        return u
    t, out = np.arange(len(u)) / INPUT_RATE_HZ, u.copy()
    shakes = np.abs(v) > 0.6 * np.sqrt(np.mean(v**2))
    for start, end in _spells(rng, t[-1], 15.0, share, (0.005, 0.04)):
        out[(t > start) & (t < end) & shakes] = 0.0
    return out


def _spells(
    rng: np.random.Generator, end: float, rate: float, share: float, length: tuple[float, float]
) -> list[tuple[float, float]]:
    """Start and end (s) of a share of the intervals that occur at a rate (1/s); those of a smaller share are
    a subset."""
    if not share:
        return []
    number = rng.poisson(end * rate)
    starts, lengths, lots = rng.uniform(0, end, number), rng.uniform(*length, number), rng.random(number)
    return [(float(a), float(a + b)) for a, b, lot in zip(starts, lengths, lots, strict=True) if lot < share]


def sensor(truth: Truth, name: str, force: Array, rng: np.random.Generator) -> Array:
    """A sensor's reading (at `RATE_HZ`): gain, range, leakage, low-pass, offset, hum, drifts. name: prefix of
    its parameters."""

    def get(key: str) -> float:
        return truth.get(f"{name}.{key}")

    t = np.arange(len(force)) / RATE_HZ
    warm = 1 - get("settle") * np.exp(-t / get("settle_time")) if get("settle") else np.ones(len(t))
    out = force * (1 + get("gain") * warm)
    if get("hysteresis") > 0:
        out = out - get("hysteresis") * (out - _coarse_play(out, get("hysteresis_width")))
    if get("clip") > 0:
        out = np.clip(out, -get("clip"), get("clip"))
    if get("range") > 0:
        coarse = _within_hold(np.flatnonzero(np.abs(out) > get("range")), len(out), get("range_hold"))
        out = np.where(coarse, (1 + get("range_gain")) * out, out)
    if get("leakage") > 0:
        out = _high_pass(out, get("leakage"))
        if get("leakage_again") > 0:
            out = _high_pass(out, get("leakage_again") * get("leakage"))
    if get("lag") > 0:
        out = _low_pass(out, get("lag"), round(get("lag_form")))
    out = out + get("offset") * warm
    if get("zero") > 0:
        out = out + get("zero") * rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.5) * (1 - np.exp(-t / 6.0))
    for start, end in _spells(rng, t[-1], 1.5, get("hang"), (0.03, 0.15)):
        hung = (t > start) & (t < end)
        out = np.where(hung, out[np.argmax(hung)], out)
    hum = np.sin(2 * np.pi * get("hum_hz") * t) + 0.4 * np.sin(6 * np.pi * get("hum_hz") * t + 1)
    return np.asarray(out + get("hum") * hum + get("wander") * _slow_noise(rng, len(out)))


def logged(truth: Truth, values: Array) -> Array:
    """A channel at 500 Hz from one at `RATE_HZ`."""
    every = round(RATE_HZ / SAMPLE_RATE_HZ)
    if truth.filtered:
        return np.asarray(resample_poly(values, 1, every, padtype="line")[: (len(values) - 1) // every])
    return np.asarray(values[:-1:every])


def _moving_mass(truth: Truth, acceleration: Array) -> Array | float:
    """N; attached rigidly, by one or two lightly damped springs, or viscously."""
    mass, hz, second = truth.get("rod.mass"), truth.get("rod.mass_hz"), truth.get("rod.mass_hz2")
    if not mass:
        return 0.0
    if truth.get("rod.mass_time") > 0:
        return mass * _one_pole(acceleration, truth.get("rod.mass_time"))
    if not hz:
        return mass * acceleration
    share = truth.get("rod.mass_share2") if second else 0.0
    other = _sprung(acceleration, second) if second else 0.0
    return mass * ((1 - share) * _sprung(acceleration, hz) + share * other)


def _sprung(acceleration: Array, hz: float) -> Array:
    """Acceleration of a mass on a spring."""
    w = 2 * np.pi * hz / RATE_HZ
    a = [1 + 0.1 * w + w**2, -2 - 0.1 * w, 1.0]  # backward differences of y'' + 2 0.05 w y' + w^2 y = w^2 a
    return np.asarray(lfilter([w**2], a, acceleration))


def _now_and_then(rng: np.random.Generator, n: int) -> Array:
    """1 for 0.3 to 1 s about every two seconds, 0 in between, with smooth edges of 10 ms."""
    times = n // RATE_HZ + 2
    off, on = 0.05 + rng.exponential(1.2, times), rng.uniform(0.3, 1.0, times)
    ends = np.cumsum(np.column_stack([off, on]).ravel())
    edges = np.column_stack([ends - 0.005, ends + 0.005]).ravel()
    return np.asarray(np.interp(np.arange(n) / RATE_HZ, edges, np.tile([0.0, 1.0, 1.0, 0.0], times)))


def _within_hold(set_at: NDArray[np.intp], n: int, hold: float) -> NDArray[np.bool_]:
    """Mask of the samples (n,) no later than `hold` (s) after one of `set_at`."""
    last = np.full(n, -n)
    last[set_at] = set_at
    return np.asarray(np.arange(n) - np.maximum.accumulate(last) <= hold * RATE_HZ)


def _play(x: Array, half: float) -> Array:
    """Play operator on x with a play of twice `half`."""
    out, at = np.empty_like(x), float(x[0])
    for k, here in enumerate(x.tolist()):
        at = min(max(at, here - half), here + half)
        out[k] = at
    return out


def _coarse_play(values: Array, half: float) -> Array:
    """Play operator on a channel at `RATE_HZ`, computed at a tenth of that rate."""
    at = np.arange(len(values))
    lag = values[::10] - _play(values[::10], half)
    return np.asarray(values - np.interp(at, at[::10], lag))


def _average(values: Array, width: int) -> Array:
    """Moving average over the last samples."""
    width = max(1, width)
    total = np.cumsum(np.concatenate([np.full(width, values[0]), values]))
    return np.asarray((total[width:] - total[:-width]) / width)


def _one_pole(values: Array, tau: float) -> Array:
    k = 1 / (1 + tau * RATE_HZ)
    return np.asarray(lfilter([k], [1, k - 1], values, zi=[values[0] * (1 - k)])[0])


def _high_pass(values: Array, tau: float) -> Array:
    """High-pass of a charge amplifier with time constant tau (s), from a charge equal to the first value."""
    k = 1 / (1 + 1 / (tau * RATE_HZ))
    return np.asarray(lfilter([k, -k], [1, -k], values, zi=[values[0] * (1 - k)])[0])


def _low_pass(values: Array, tau: float, form: int) -> Array:
    """1: Butterworth of two poles; 2: moving average; 3: Bessel of four poles; each with a delay of about tau
    (s)."""
    if form == 2:
        return _average(values, round(2 * tau * RATE_HZ))
    if form == 3:
        sos = bessel(4, min(1 / (2 * np.pi * tau), 0.2 * RATE_HZ), fs=RATE_HZ, norm="delay", output="sos")
    else:
        sos = butter(2, np.sqrt(2) / (2 * np.pi * tau), fs=RATE_HZ, output="sos")
    return np.asarray(sosfilt(sos, values, zi=sosfilt_zi(sos) * values[0])[0])


def _slow_noise(rng: np.random.Generator, n: int) -> Array:
    """Noise below about 1 Hz with unit standard deviation over long times."""
    knots = rng.standard_normal(int(n / RATE_HZ * 2) + 4)
    return np.asarray(CubicSpline(np.arange(len(knots)) / 2, knots)(np.arange(n) / RATE_HZ))


def felt_ground(truth: Truth, test: Excitation) -> Array:
    """Ground acceleration (m/s2) at half steps from a misaligned accelerometer.

    It also measures the table's transverse motion, a mode with 5 % damping that the drive excites.
    """
    ground, angle = test.fine(test.motion), truth.get("ground.angle")
    if not angle:
        return ground
    w = 2 * np.pi * truth.get("ground.hz")
    b, a = bilinear([w**2], [1.0, 0.1 * w, w**2], fs=INPUT_RATE_HZ)
    return np.asarray(np.cos(angle) * ground + np.sin(angle) * lfilter(b, a, ground))


def frame_channels(
    truth: Truth, test: Excitation, rng: np.random.Generator, ground: Array | None = None
) -> dict[str, Array]:
    """Channels of one test of the frame, without noise, at 500 Hz.

    ground: actual ground acceleration (m/s2) at half steps, if it differs from the test's.
    """
    ground, u = test.fine(test.motion) if ground is None else ground, test.fine(test.command)
    out = rig.run_frame(truth.numbers, truth.storeys, truth.damper_floors, ground, driven(truth, u, rng))
    channels = {"ground_acceleration_m_s2": felt_ground(truth, test)[::2], "command": u[::2]}
    for floor in (1, 2, 3):
        other = out[f"acceleration{floor - 1 or 3}"]
        felt = out[f"acceleration{floor}"] + truth.get(f"floor{floor}.cross") * other
        channels[f"floor{floor}_acceleration_m_s2"] = sensor(truth, f"floor{floor}", felt, rng)
    for floor in (1, 2, 3):
        channels[f"floor{floor}_displacement_m"] = out[f"displacement{floor}"]
    channels["force_N"] = sensor(truth, "sensor", out["force"], rng)
    return {name: logged(truth, values) for name, values in channels.items()}
