"""Make the records that come with the package: a self-sensing MR damper on a test machine, simulated.

The physics here is this file's own, in forms that the plugin does not have, so that a fit to these records
is no fit of a model to itself. All in SI units; extension positive::

    driver      i'  = (i1 - i) / TAU_2,  i1' = (u - i1) / TAU_1           two poles
    magnetics   b   = i (1 + I_S) / (|i| + I_S)                          Froehlich, b(1 A) = 1
    fluid       F_f = k(b) (x - y),  k = K_0 + K_1 b                     elastic, in series with
                y'  = F_f / c_pre + ((|F_f| - F_y)_+ / C)^(1/M) sign F_f Herschel-Bulkley, viscous below yield
                F_y = Y_0 + Y_1 b,  C = C_0 + C_1 b,  c_pre = P_0 + P_1 b
    seal        s'  = x' - |x'| s SIGMA / (F_C + F_B exp(-(x'/V_B)^2))   LuGre bristle
                F_s = SIGMA s + SIGMA_1 s' + SIGMA_2 x'
    gas         F_g = -F_0 (1 + x / L)^(-KAPPA)                          accumulator: pushes the rod out
    sum         F   = F_f + F_s + F_g

(e)_+ is a smooth ramp. The series element with a viscoplastic flow is Maxwell's of rheology; Herschel and
Bulkley 1926 (10.1007/BF01432034); LuGre: Canudas de Wit et al. 1995 (10.1109/9.376053). Sizes follow
the damper of Chen, Ni and Or (Smart Structures and Systems): stroke +-25 mm, 1 A continuous and 2 A
intermittent, records at 500 Hz; no measured data are used.

    python tools/make_embedded.py [FOLDER]

writes FOLDER/embedded/{train,validation}/*.csv.gz and FOLDER/motions/*.csv (default: src/mrdamp/data).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from mrdamp.motions import kanai_tajimi
from mrdamp.records import Record

Array = NDArray[np.float64]
Motion = Callable[[float], tuple[float, float]]  # t in s to x in m, x' in m/s
Command = Callable[[float], float]  # t in s to u in A

RATE = 500.0  # Hz, of the records
TAU_1, TAU_2 = 4.0e-3, 1.5e-3  # s, coil and amplifier
I_S = 1.6  # A, where the field has grown to half its limit
K_0, K_1 = 1.2e6, 1.0e6  # N/m, fluid and housing at b = 0, per b
Y_0, Y_1 = 45.0, 940.0  # N, yield force
C_0, C_1, M = 620.0, 420.0, 0.80  # N (s/m)^M, post-yield consistency and exponent
P_0, P_1 = 1.5e4, 2.0e5  # N s/m, pre-yield viscosity
SMOOTH_0, SMOOTH_1 = 6.0, 0.05  # N and share of F_y: width of the ramp at yield
SIGMA, SIGMA_1, SIGMA_2 = 3.0e5, 150.0, 40.0  # N/m, N s/m, N s/m, seal
F_C, F_B, V_B = 22.0, 9.0, 6.0e-3  # N, N, m/s, seal: Coulomb, extra at standstill, Stribeck velocity
F_0, L_GAS, KAPPA = 25.0, 0.045, 1.25  # N, m, 1: accumulator
NOISE_X, STEP_X = 3.0e-6, 0.5e-6  # m, displacement transducer
NOISE_SELF, STEP_SELF = 7.0, 0.5  # N, embedded sensor: 0.4 % of +-1.8 kN
NOISE_CELL, STEP_CELL = 5.5, 0.25  # N, load cell: 0.3 %
STEP_COMMAND = 1.0e-4  # A, digital-to-analogue converter


@dataclass(frozen=True)
class Trial:
    """One test: x(t) in m with x'(t) in m/s, and u(t) in A."""

    half: str  # train or validation
    name: str
    duration: float  # s
    motion: Motion
    command: Command
    seed: int  # of the noise


def soft_start(t: float, ramp: float = 0.4) -> tuple[float, float]:
    """Amplitude from 0 to 1 and its rate: a test machine does not jump to full speed."""
    if t >= ramp:
        return 1.0, 0.0
    return 0.5 - 0.5 * math.cos(math.pi * t / ramp), 0.5 * math.pi / ramp * math.sin(math.pi * t / ramp)


def harmonics(amplitudes: Array, frequencies: Array, phases: Array) -> Motion:
    """Sum of a sin(2 pi f t + p) over the arrays (k,), after a soft start, with its derivative."""
    omega = 2.0 * np.pi * frequencies

    def motion(t: float) -> tuple[float, float]:
        angle = omega * t + phases
        gain, rate = soft_start(t)
        x = float(amplitudes @ np.sin(angle))
        return gain * x, gain * float((amplitudes * omega) @ np.cos(angle)) + rate * x

    return motion


def sine(frequency: float, amplitude: float) -> Motion:
    """Frequency in Hz, amplitude in m."""
    return harmonics(np.array([amplitude]), np.array([frequency]), np.zeros(1))


def triangle(frequency: float, amplitude: float) -> Motion:
    """Triangle of 8 harmonics with Lanczos factors: a machine rounds the corners."""
    order = np.arange(1.0, 17.0, 2.0, dtype=np.float64)
    series = 8.0 / np.pi**2 * (-1.0) ** np.arange(8) / order**2 * np.sinc(order / 17.0)
    peak = abs(float(series @ np.sin(0.5 * np.pi * order)))
    return harmonics(amplitude / peak * series, frequency * order, np.zeros(8))


def random_motion(seed: int, rms: float, low: float, high: float) -> Motion:
    """Random displacement of 60 lines from low to high (Hz) that fall with the frequency; rms in m."""
    rng = np.random.default_rng(seed)
    edges = np.linspace(low, high, 61)
    frequencies = edges[:-1] + rng.random(60) * (high - low) / 60.0
    amplitudes = 1.0 / (1.0 + (frequencies / 2.2) ** 2)
    amplitudes *= rms * math.sqrt(2.0) / float(np.linalg.norm(amplitudes))
    return harmonics(amplitudes, frequencies, rng.random(60) * 2.0 * np.pi)


def random_command(seed: int, high: float) -> Command:
    """Band-limited white noise from 0 to ``high`` Hz about 1 A, cut off at 0 and 2 A."""
    rng = np.random.default_rng(seed)
    omega = 2.0 * np.pi * high * (np.arange(60) + rng.random(60)) / 60.0
    phases = rng.random(60) * 2.0 * np.pi
    scale = 0.6 / math.sqrt(30.0)

    def command(t: float) -> float:
        return min(max(1.0 + scale * float(np.sin(omega * t + phases).sum()), 0.0), 2.0)

    return command


def constant(current: float) -> Command:
    """A command in A that stays."""
    return lambda t: current


def elements(x: float, v: float, state: Array) -> tuple[float, float, float]:
    """Rates of y and s, and the force in N, for x, x' and the state (i1, i, y, s)."""
    _, i, y, s = state
    b = i * (1.0 + I_S) / (abs(i) + I_S)
    fluid = (K_0 + K_1 * b) * (x - y)
    yield_force = Y_0 + Y_1 * b
    width = SMOOTH_0 + SMOOTH_1 * yield_force
    over = (abs(fluid) - yield_force) / width
    excess = width * (over + math.log1p(math.exp(-over)) if over > 0.0 else math.log1p(math.exp(over)))
    flow = fluid / (P_0 + P_1 * b) + math.copysign((excess / (C_0 + C_1 * b)) ** (1.0 / M), fluid)
    bristle = v - abs(v) * s * SIGMA / (F_C + F_B * math.exp(-((v / V_B) ** 2)))
    seal = SIGMA * s + SIGMA_1 * bristle + SIGMA_2 * v
    gas = -F_0 * (1.0 + x / L_GAS) ** -KAPPA
    return flow, bristle, fluid + seal + gas


def simulate(trial: Trial, rate: float = RATE) -> tuple[Array, Array, Array, Array]:
    """Time, displacement, command and force (n,) at a rate (Hz), free of noise.

    LSODA is within 0.003 N of a Runge-Kutta run at 50 kHz. SciPy's Radau and BDF are not: their
    finite-difference Jacobian is poor where states are near zero (several newton of error at the same
    tolerance).
    """
    time = np.arange(round(trial.duration * rate)) / rate
    command = np.array([trial.command(t) for t in time])

    def rates(t: float, state: Array) -> list[float]:
        x, v = trial.motion(t)
        flow, bristle, _ = elements(x, v, state)
        i1, i = float(state[0]), float(state[1])
        return [(trial.command(t) - i1) / TAU_1, (i1 - i) / TAU_2, flow, bristle]

    start = [command[0], command[0], trial.motion(0.0)[0], 0.0]
    solution = solve_ivp(
        rates,
        (0.0, time[-1]),
        start,
        method="LSODA",
        t_eval=time,
        rtol=1e-7,
        atol=[1e-8, 1e-8, 1e-11, 1e-11],
        max_step=2e-3,
    )
    if not solution.success:
        raise RuntimeError(f"{trial.name}: {solution.message}")
    motion = [trial.motion(t) for t in time]
    force = [elements(x, v, solution.y[:, k])[2] for k, (x, v) in enumerate(motion)]
    return time, np.array([x for x, _ in motion]), command, np.array(force)


def record(trial: Trial) -> Record:
    """The test as its sensors see it: noise and steps of the converters."""
    _, x, command, force = simulate(trial)
    rng = np.random.default_rng(trial.seed)

    def measured(values: Array, noise: float, step: float) -> Array:
        return np.round((values + noise * rng.standard_normal(len(values))) / step) * step

    channels = {
        "displacement_m": measured(x, NOISE_X, STEP_X),
        "command": np.round(command / STEP_COMMAND) * STEP_COMMAND,
        "force_N": measured(force, NOISE_SELF, STEP_SELF),
        "reference_force_N": measured(force, NOISE_CELL, STEP_CELL),
    }
    return Record(trial.name, None, 1.0 / RATE, channels)


def trials() -> list[Trial]:
    """All tests of the set."""
    out: list[Trial] = []

    def add(
        half: str,
        name: str,
        duration: float,
        motion: Motion,
        command: Command,
    ) -> None:
        out.append(Trial(half, name, duration, motion, command, seed=100 + len(out)))

    def steady(half: str, shape: str, frequency: float, mm: float, current: float, duration: float) -> None:
        make = sine if shape == "sine" else triangle
        name = f"{shape}_{frequency:.1f}Hz_{mm:.1f}mm_{current:.2f}A"
        add(half, name, duration, make(frequency, 1e-3 * mm), constant(current))

    def write_steady(half: str, *tests: tuple[str, float, float, float, float]) -> None:
        for test in tests:
            steady(half, *test)

    def random(half: str, number: int) -> None:
        wander = random_motion(10 + number, 3.5e-3, 0.2, 8.0)
        add(half, f"random_random_current_{number}", 15.0, wander, random_command(19 + 2 * number, 10.0))

    # Shape, Hz, mm, A, s.
    write_steady(
        "train",
        ("sine", 1.0, 5.0, 0.25, 5.0), ("sine", 1.0, 1.0, 1.00, 5.0), ("sine", 2.5, 5.0, 0.00, 3.0),
        ("sine", 2.5, 2.5, 1.00, 3.0), ("sine", 5.0, 5.0, 0.50, 3.0), ("sine", 5.0, 2.5, 0.00, 3.0),
        ("triangle", 1.0, 5.0, 0.50, 5.0),
    )  # fmt: skip
    random("train", 1)
    add("train", "sine_5.0Hz_2.5mm_random_current", 15.0, sine(5.0, 2.5e-3), random_command(22, 10.0))
    write_steady(
        "validation",
        ("sine", 1.0, 10.0, 0.75, 4.0), ("sine", 2.5, 1.0, 0.50, 3.0), ("sine", 5.0, 5.0, 0.00, 3.0),
        ("sine", 5.0, 5.0, 1.00, 3.0), ("triangle", 2.5, 5.0, 0.50, 3.0),
    )  # fmt: skip
    random("validation", 2)
    slow, corner = sine(1.0, 2.5e-3), triangle(2.5, 2.5e-3)
    add("validation", "sine_1.0Hz_2.5mm_random_current", 10.0, slow, random_command(24, 10.0))
    add("validation", "triangle_2.5Hz_2.5mm_random_current", 10.0, corner, random_command(25, 10.0))
    return out


def main(folder: Path) -> None:
    """Write every record and the ground motion under the folder."""
    for trial in trials():
        target = folder / "embedded" / trial.half
        target.mkdir(parents=True, exist_ok=True)
        made = record(trial)
        made.save(target / f"{trial.name}.csv.gz", digits=7)
        force = made.channel("reference_force_N")
        print(f"{trial.half:10} {trial.name:38} {made.n:5} samples, peak {np.abs(force).max():5.0f} N")
    motions = folder / "motions"
    motions.mkdir(parents=True, exist_ok=True)
    kanai_tajimi(1940).save(motions / "synthetic_firm_soil.csv", digits=5)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Make the records that come with the package.")
    data = Path(__file__).parents[1] / "src" / "mrdamp" / "data"
    parser.add_argument("folder", type=Path, nargs="?", default=data, help="(default: %(default)s)")
    main(parser.parse_args().folder)
