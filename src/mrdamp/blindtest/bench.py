"""The bench around the rig: command line, rod, sensors, and the logger that writes 500 samples a second."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import bessel, bilinear, butter, lfilter, resample_poly, sosfilt, sosfilt_zi

from mrdamp.blindtest import rig
from mrdamp.blindtest.excitation import Excitation
from mrdamp.blindtest.rig import INPUT_RATE_HZ, RATE_HZ, Array, Numbers

SAMPLE_RATE_HZ = 500.0


@dataclass(frozen=True)
class Truth:
    """A rig with its causes: numbers of `rig.c`, and those of the bench by `command.`, `rod.`, `sensor.`, `reading.`.

    filtered: the logger has an anti-alias filter (all channels the same), otherwise it takes samples as they are.
    storeys, between: of a frame.
    """

    numbers: Numbers
    outside: Numbers = field(default_factory=dict)
    filtered: bool = False
    storeys: Sequence[Numbers] = ()
    between: tuple[int, int] = (0, 1)

    def having(self, changes: Numbers) -> Truth:
        """The same rig with a cause switched on. `storey2.damping` is relative for mass, stiffness and damping."""
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
    """Channels of one test on the damper, free of noise, at 500 Hz; `rng` is for what differs from run to run."""
    motion = test.spline()
    x, u = motion(test.time), test.fine(test.command)
    out = rig.run_damper(truth.numbers, x, motion(test.time, 1), driven(truth, u, rng))
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
    """Force (N) at 500 Hz of a damper without causes for what the transducers read, as its simulator would say."""
    x = as_read(truth, test)
    out = rig.run_damper(nominal, x, np.gradient(x, 1 / INPUT_RATE_HZ), test.fine(test.command))
    return logged(truth, out["force"])


def as_read(truth: Truth, test: Excitation) -> Array:
    """Displacement (m) at half steps as the transducer gives it: late, early, filtered, or on a clock of its own."""
    motion = test.spline()
    if truth.get("reading.bessel") > 0:
        sos = bessel(
            2, 1 / (2 * np.pi * truth.get("reading.bessel")), fs=INPUT_RATE_HZ, norm="delay", output="sos"
        )
        x = motion(test.time)
        return np.asarray(sosfilt(sos, x, zi=sosfilt_zi(sos) * x[0])[0])
    if truth.get("reading.slack") > 0:
        return test.fine(_play(test.motion, truth.get("reading.slack") / 2))
    late = truth.get("reading.shift") + truth.get("reading.drift") * test.time
    return np.asarray(motion(np.clip(test.time - late, 0.0, test.duration)))


def driven(truth: Truth, u: Array, rng: np.random.Generator) -> Array:
    """The command (at half steps) as it comes out of the controller: held, late, coarse, or with drop-outs."""
    t = np.arange(len(u)) / INPUT_RATE_HZ
    late = np.full(len(u), truth.get("command.delay"))
    if truth.get("command.period") > 0:
        late = late + t % truth.get("command.period")
    out = np.interp(t - late, t, u)
    if truth.get("command.step") > 0:
        out = truth.get("command.step") * np.round(out / truth.get("command.step"))
    for _ in range(rng.poisson(t[-1] * truth.get("command.dropouts"))):
        start, length = rng.uniform(0, t[-1]), rng.uniform(0.1, 0.5)
        out[(t > start) & (t < start + length)] = 0.0
    return np.asarray(out)


def sensor(truth: Truth, name: str, force: Array, rng: np.random.Generator) -> Array:
    """A sensor's reading (at `RATE_HZ`): gain, range, leakage, low-pass, offset, hum, wander; `name` is its prefix."""

    def get(key: str) -> float:
        return truth.get(f"{name}.{key}")

    out = force * (1 + get("gain"))
    if get("bend"):
        out = out * (1 + get("bend") * np.abs(force) / get("scale"))
    if get("range") > 0:
        coarse = _held(np.flatnonzero(np.abs(out) > get("range")), len(out), get("range_hold"))
        out = np.where(coarse, (1 + get("range_gain")) * out, out)
    if get("leakage") > 0:
        slow = get("leakage_slow")
        out = (1 - slow) * _high_pass(out, get("leakage")) + slow * _high_pass(out, 10 * get("leakage"))
    if get("lag") > 0:
        out = _low_pass(out, get("lag"), round(get("lag_form")))
    out = out + get("offset") * (1 + get("offset_wander") * rng.normal())
    t = np.arange(len(force)) / RATE_HZ
    hum = np.sin(2 * np.pi * get("hum_hz") * t) + 0.4 * np.sin(6 * np.pi * get("hum_hz") * t + 1)
    return np.asarray(out + get("hum") * hum + get("wander") * _slow_noise(rng, len(out)))


def logged(truth: Truth, values: Array) -> Array:
    """A channel at 500 Hz out of one at `RATE_HZ`."""
    every = round(RATE_HZ / SAMPLE_RATE_HZ)
    if truth.filtered:
        return np.asarray(resample_poly(values, 1, every, padtype="line")[: (len(values) - 1) // every])
    return np.asarray(values[:-1:every])


def _moving_mass(truth: Truth, acceleration: Array) -> Array | float:
    """N; held rigidly, by a spring with little damping, by a rubber bush, or in two parts."""
    mass, hz, rigid = truth.get("rod.mass"), truth.get("rod.mass_hz"), truth.get("rod.mass_rigid")
    if not hz or not mass:
        return mass * acceleration
    if truth.get("rod.mass_loss") > 0:
        return mass * _bush(acceleration, hz, truth.get("rod.mass_loss"), truth.get("rod.mass_time"))
    w = 2 * np.pi * hz / RATE_HZ
    a = [1 + 0.1 * w + w**2, -2 - 0.1 * w, 1.0]  # backward differences of y'' + 2 0.05 w y' + w^2 y = w^2 a
    return mass * (rigid * acceleration + (1 - rigid) * np.asarray(lfilter([w**2], a, acceleration)))


def _bush(acceleration: Array, hz: float, loss: float, time: float) -> Array:
    """Acceleration of a mass on a spring (of `hz` when slow) beside one `loss` times as stiff behind a dashpot."""
    k, soft = (2 * np.pi * hz) ** 2, time * (1 + loss)
    b, a = bilinear([k * soft, k], [time, 1.0, k * soft, k], fs=RATE_HZ)
    return np.asarray(lfilter(b, a, acceleration))


def _now_and_then(rng: np.random.Generator, n: int) -> Array:
    """1 for 0.3 to 1 s about every two seconds, 0 in between, with soft edges of 10 ms."""
    times = n // RATE_HZ + 2
    off, on = 0.05 + rng.exponential(1.2, times), rng.uniform(0.3, 1.0, times)
    ends = np.cumsum(np.column_stack([off, on]).ravel())
    edges = np.column_stack([ends - 0.005, ends + 0.005]).ravel()
    return np.asarray(np.interp(np.arange(n) / RATE_HZ, edges, np.tile([0.0, 1.0, 1.0, 0.0], times)))


def _held(set_at: NDArray[np.intp], n: int, hold: float) -> NDArray[np.bool_]:
    """Of n samples those no later than `hold` (s) after one of `set_at`."""
    last = np.full(n, -n)
    last[set_at] = set_at
    return np.asarray(np.arange(n) - np.maximum.accumulate(last) <= hold * RATE_HZ)


def _play(x: Array, half: float) -> Array:
    """What is carried along by x with a play of twice `half`."""
    out, at = np.empty_like(x), float(x[0])
    for k, here in enumerate(x.tolist()):
        at = min(max(at, here - half), here + half)
        out[k] = at
    return out


def _high_pass(values: Array, tau: float) -> Array:
    """Charge that leaks away with tau (s), from a charge that equals the first value."""
    k = 1 / (1 + 1 / (tau * RATE_HZ))
    return np.asarray(lfilter([k, -k], [1, -k], values, zi=[values[0] * (1 - k)])[0])


def _low_pass(values: Array, tau: float, form: int) -> Array:
    """1: Butterworth of two poles; 2: moving average; 3: one pole; each late by about tau (s)."""
    if form == 2:
        width = max(1, round(2 * tau * RATE_HZ))
        total = np.cumsum(np.concatenate([np.full(width, values[0]), values]))
        return np.asarray((total[width:] - total[:-width]) / width)
    if form == 3:
        k = 1 / (1 + tau * RATE_HZ)
        return np.asarray(lfilter([k], [1, k - 1], values, zi=[values[0] * (1 - k)])[0])
    sos = butter(2, np.sqrt(2) / (2 * np.pi * tau), fs=RATE_HZ, output="sos")
    return np.asarray(sosfilt(sos, values, zi=sosfilt_zi(sos) * values[0])[0])


def _slow_noise(rng: np.random.Generator, n: int) -> Array:
    """Noise below about 1 Hz with unit standard deviation over long times."""
    knots = rng.standard_normal(int(n / RATE_HZ * 2) + 4)
    return np.asarray(CubicSpline(np.arange(len(knots)) / 2, knots)(np.arange(n) / RATE_HZ))


def felt_ground(truth: Truth, test: Excitation) -> Array:
    """Ground acceleration (m/s2) at half steps as its accelerometer gives it: askew, it feels the table's sway across,
    a mode of 5 % damping that the drive excites."""
    ground, angle = test.fine(test.motion), truth.get("ground.angle")
    if not angle:
        return ground
    w = 2 * np.pi * truth.get("ground.hz")
    b, a = bilinear([w**2], [1.0, 0.1 * w, w**2], fs=INPUT_RATE_HZ)
    return np.asarray(np.cos(angle) * ground + np.sin(angle) * lfilter(b, a, ground))


def frame_channels(
    truth: Truth, test: Excitation, rng: np.random.Generator, ground: Array | None = None
) -> dict[str, Array]:
    """Channels of one test of the frame, free of noise, at 500 Hz.

    ground: acceleration (m/s2) at half steps that shakes it, where that is not the test's.
    """
    ground, u = test.fine(test.motion) if ground is None else ground, test.fine(test.command)
    out = rig.run_frame(truth.numbers, truth.storeys, truth.between, ground, driven(truth, u, rng))
    channels = {"ground_acceleration_m_s2": felt_ground(truth, test)[::2], "command": u[::2]}
    for floor in (1, 2, 3):
        other = out[f"acceleration{floor - 1 or 3}"]
        felt = out[f"acceleration{floor}"] + truth.get(f"floor{floor}.cross") * other
        channels[f"floor{floor}_acceleration_m_s2"] = sensor(truth, f"floor{floor}", felt, rng)
    for floor in (1, 2, 3):
        channels[f"floor{floor}_displacement_m"] = out[f"displacement{floor}"]
    channels["force_N"] = sensor(truth, "sensor", out["force"], rng)
    return {name: logged(truth, values) for name, values in channels.items()}
