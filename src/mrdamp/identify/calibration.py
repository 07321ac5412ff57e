"""The embedded piezoelectric force sensor: charge-to-force sensitivity, phase and leakage, and its error per current.

After Chen, Ni and Or, "Characterization and modeling of a self-sensing MR damper under harmonic loading",
Eqs. (1) to (4): force-controlled sines on the sensor alone, then the whole damper with the machine's load cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import optimize, signal, stats

from mrdamp.errors import InputError
from mrdamp.files import files_in
from mrdamp.identify.norms import delta_1, delta_2
from mrdamp.model.core import Array
from mrdamp.records import Record, read_record
from mrdamp.records.checks import check_channels, clipped

COLUMNS = ("time_s", "reference_force_N", "charge_pC")
CUTOFF = 20.0  # Hz, the paper's elliptic low-pass
#: The paper's sensor: mean sensitivity (pC/N), its delta_1, and its delta_2 by current (A), Table 1.
PAPER_SENSITIVITY, PAPER_DELTA_1 = -158.248, 0.0235
PAPER_DELTA_2 = {0.0: 0.0389, 0.25: 0.0270, 0.5: 0.0230, 0.75: 0.0246, 1.0: 0.0239}
#: delta_1 from which a charge is none of the force's: its correlation with it is below .87.
_NO_SENSOR = 0.5
#: Share of the force (RMS) beside a sine and its harmonics from which on it is no sine: a sweep over 20 % has .37.
_NO_SINE = 0.3
#: Of a faster test, the cut-off over its frequency: the harmonics that make delta_1 pass.
_ABOVE = 4.0
_HARMONICS = 3
_ORDER, _RIPPLE, _STOP = 5, 0.01, 60.0  # dB; run forward and backward
_MIN_CYCLES = 2.0


@dataclass(frozen=True)
class SineResult:
    """One test: frequency (Hz), force amplitude (N), sensitivity by Eq. (1) (pC/N), delta_1 by Eq. (2).

    amplitude: mean over all periods but the first, less than the test's where the run-up is longer than a period.
    phase (degree): of the charge against the force, the sensitivity's sign taken off; positive leads. gain:
    complex charge over force at the frequency (pC/N).
    """

    name: str
    frequency: float
    amplitude: float
    sensitivity: float
    delta_1: float
    phase: float
    gain: complex


@dataclass(frozen=True)
class Calibration:
    """All tests: mean sensitivity (pC/N), pooled delta_1 with it, and the sensor's frequency response.

    leakage_tau (s) with its 95 % interval (upper end infinite where no leakage is shown), delay (s) of the charge
    against the force, loss_angle (degree) by which it lags at every frequency (hysteresis of the wafer), each
    with its interval; all None for tests at fewer than three frequencies. dynamic_sensitivity (pC/N): the gain
    far above the leakage, with its interval; unlike Eq. (1) it does not grow with the phase.
    """

    tests: tuple[SineResult, ...]
    sensitivity: float
    delta_1: float
    dynamic_sensitivity: tuple[float, float, float] | None
    leakage_tau: tuple[float, float, float] | None
    delay: tuple[float, float, float] | None
    loss_angle: tuple[float, float, float] | None


@dataclass(frozen=True)
class SensingRow:
    """delta_2 of Eq. (4) at one constant current (None: the command varies), pooled over so many records.

    filtered: the same after the calibration's low-pass at 20 Hz of both forces.
    """

    command: float | None
    delta_2: float
    filtered: float
    records: int


def read_tests(source: Path | str | Sequence[Path | str]) -> list[Record]:
    """Every test of a folder, a file or a list of files, each with the channels of COLUMNS. Raises InputError."""
    files = files_in(Path(source)) if isinstance(source, Path | str) else source
    return [read_record(path, COLUMNS) for path in files]


def embedded_tests() -> list[Record]:
    """The sixteen tests that come with the package, made by tools/make_calibration.py."""
    tests = read_tests(Path(__file__).parents[1] / "data" / "calibration")
    return [replace(test, path=None) for test in tests]


def calibrate(tests: Sequence[Record], cutoff: float | None = None) -> Calibration:
    """Sensitivity and frequency response of the sensor from sine tests, each with the channels of COLUMNS.

    cutoff (Hz): of the elliptic low-pass on both channels; 0: none; None: 20 Hz, or four times the frequency of a
    test where that is more. Raises InputError for a constant or clipped channel, a force that is no
    sine, fewer than three periods, a cut-off that the sampling rate does not allow or that is below a test's frequency,
    or no test at all.
    """
    if not tests:
        raise InputError("no calibration test; at least one is needed")
    measured = [_measure(test, cutoff) for test in tests]
    results = [result for result, _, _ in measured]
    mean = float(np.mean([r.sensitivity for r in results]))
    # Every test counts by its own deviation: each is relative to its force.
    pooled = float(np.sqrt(np.mean([delta_1(f, q / mean) ** 2 for _, f, q in measured])))
    if not pooled < _NO_SENSOR:
        raise InputError(
            f"{tests[0].label}: the charge does not follow the force: delta_1 is {100 * pooled:.0f} %, a sensor's is"
            " below 4 %; check that charge and force are of one test and on one clock"
        )
    response = _response(results)
    if response[1] is not None and np.isfinite(response[1][0]):  # again, beside what is left of the test's start
        response = _response([_measure(test, cutoff, response[1][0])[0] for test in tests])
    return Calibration(tuple(results), mean, pooled, *response)


def corrected(charge: Array, sample_time: float, sensitivity: float, leakage_tau: float = np.inf) -> Array:
    """Force (n,) N from charge (n,) pC: Eq. (3), with what has leaked away added again where tau (s) is finite.

    Q' = k F' - Q / tau turned round: k F = Q + 1/tau int Q dt. A constant error of the charge grows with time.
    """
    lost = np.concatenate([[0.0], np.cumsum((charge[1:] + charge[:-1]) / 2) * sample_time]) / leakage_tau
    return np.asarray((charge + lost) / sensitivity)


def with_force(record: Record, calibration: Calibration, put_back: bool = False) -> Record:
    """The record with `force_N` from its charge: Eq. (3) with the mean sensitivity.

    put_back: what has leaked away is added again, with the leakage and the sensitivity above it. Raises InputError
    without a charge, and where the calibration shows no leakage that could be put back.
    """
    charge = record.channel("charge_pC")
    if not put_back:
        force = corrected(charge, record.sample_time, calibration.sensitivity)
    elif calibration.leakage_tau and calibration.dynamic_sensitivity:
        force = corrected(
            charge, record.sample_time, calibration.dynamic_sensitivity[0], calibration.leakage_tau[0]
        )
    else:
        raise InputError("the calibration shows no leakage to put back: tests at three frequencies are needed")
    return record.with_channels({"force_N": force})


def sensing_by_command(records: Sequence[Record]) -> list[SensingRow]:
    """delta_2 between the damper's own force and the load cell, per constant command and over those that vary.

    The records need force_N and reference_force_N; those without are passed over. Raises InputError if none has.
    """
    both = [r for r in records if "reference_force_N" in r.channels and "force_N" in r.channels]
    if not both:
        raise InputError("no record has both force_N and reference_force_N; delta_2 compares these")
    groups: dict[float | None, list[Record]] = {}
    largest = max(float(np.abs(r.command).max()) for r in both)
    for record in both:
        varies = float(np.ptp(record.command)) > 0.02 * max(largest, 1e-12)
        groups.setdefault(None if varies else round(float(np.median(record.command)), 3), []).append(record)
    rows = []
    for command in sorted(groups, key=lambda c: (c is None, c or 0.0)):
        chosen = groups[command]
        names = ("reference_force_N", "force_N")
        reference, own = (np.concatenate([r.channel(n) for r in chosen]) for n in names)
        low = [np.concatenate([low_pass(r.channel(n), r.sample_time) for r in chosen]) for n in names]
        rows.append(SensingRow(command, delta_2(reference, own), delta_2(*low), len(chosen)))
    return rows


def low_pass(x: Array, sample_time: float, cutoff: float = CUTOFF) -> Array:
    """Elliptic low-pass run forward and backward, so that it adds no phase. Raises InputError."""
    if not 0 < cutoff < 0.45 / sample_time:
        raise InputError(
            f"cut-off {cutoff:g} Hz; allowed at this sampling rate: 0 to {0.45 / sample_time:g} Hz"
        )
    sos = signal.ellip(_ORDER, _RIPPLE, _STOP, cutoff, fs=1 / sample_time, output="sos")
    return np.asarray(signal.sosfiltfilt(sos, x, padlen=min(len(x) - 1, int(2 / (cutoff * sample_time)))))


def _measure(
    test: Record, cutoff: float | None, leakage_tau: float | None = None
) -> tuple[SineResult, Array, Array]:
    """The result, and the filtered force and charge over whole periods, their means and trends taken off.

    leakage_tau: s, of a charge whose start from rest fades meanwhile; a slower one is a trend.
    """
    check_channels([test], COLUMNS[1:])
    dt, force, charge = test.sample_time, *(test.channel(name) for name in COLUMNS[1:])
    for name, x in zip(COLUMNS[1:], (force, charge), strict=True):
        found = clipped(x)
        if found is not None:
            raise InputError(
                f"{test.label}: channel {name} is clipped at {found[0]:g} ({100 * found[1]:.1f} %)"
            )
    frequency = frequency_of(force, dt)
    if cutoff is None:
        cutoff = min(max(CUTOFF, _ABOVE * frequency), 0.4 / dt)
    if cutoff:
        if cutoff <= frequency:
            allowed = f"allowed: a cut-off above it, not {cutoff:g} Hz"
            raise InputError(f"{test.label}: a test at {frequency:.4g} Hz; {allowed}")
        force, charge = low_pass(force, dt, cutoff), low_pass(charge, dt, cutoff)
        frequency = frequency_of(force, dt)
    cycles = len(force) * dt * frequency
    if cycles < _MIN_CYCLES + 1:
        raise InputError(f"{test.label}: {cycles:.1f} periods; at least {_MIN_CYCLES + 1:g} are needed")
    # The first period is the run-up; whole periods, or the mean would depend on where the test ends.
    first = round(1 / (frequency * dt))
    count = round(int((len(force) - first) * dt * frequency) / (frequency * dt))
    part = slice(first, first + count)
    t = dt * np.arange(len(force))[part]
    gains, swings, rest = [], [], []
    for x in (force[part], charge[part]):
        # With harmonics, which a trend would else take a part of.
        angle = 2 * np.pi * frequency * np.outer(t, np.arange(1, 1 + _HARMONICS))
        columns = np.column_stack([np.ones_like(t), t, np.cos(angle), np.sin(angle)])
        if leakage_tau is not None and leakage_tau < t[-1]:
            columns = np.column_stack([columns, np.exp(-t / leakage_tau)])
        c = np.linalg.lstsq(columns, x, rcond=None)[0]
        gains.append(complex(c[2], -c[2 + _HARMONICS]))
        swings.append(x - columns[:, :2] @ c[:2])
        rest.append(float(np.std(x - columns @ c) / np.std(swings[-1])))
    if rest[0] > _NO_SINE:
        raise InputError(
            f"{test.label}: the force is no sine: {100 * rest[0]:.0f} % of it (RMS) is not at {frequency:.4g} Hz and"
            " its harmonics; give tests of one frequency each"
        )
    f, q = swings
    product = float(q @ f)
    if not abs(product) > 0:
        raise InputError(f"{test.label}: charge and force have nothing in common; check the channels")
    k = float(q @ q) / product
    gain = gains[1] / gains[0]
    phase = float(np.degrees(np.angle(gain * np.sign(k))))
    return (
        SineResult(test.name, frequency, abs(gains[0]), k, delta_1(f, q / k), phase, gain),
        f,
        q,
    )


def frequency_of(x: Array, dt: float) -> float:
    """Frequency (Hz) of a sine by its spectrum's peak, refined by least squares."""
    y = x - x.mean()
    n = 8 * len(y)
    guess = float(np.argmax(np.abs(np.fft.rfft(y * np.hanning(len(y)), n))[1:]) + 1) / (n * dt)
    # The first period is the run-up, whose amplitude is another.
    y = y[min(round(1 / (guess * dt)), len(y) // 2) :]
    t = dt * np.arange(len(y))

    def left(f: float) -> float:
        columns = np.column_stack([np.cos(2 * np.pi * f * t), np.sin(2 * np.pi * f * t), np.ones_like(t)])
        return float(np.sum((y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]) ** 2))

    width = 0.5 / (len(y) * dt)
    return float(
        optimize.minimize_scalar(left, bounds=(max(guess - width, 1e-9), guess + width), method="bounded").x
    )


_Estimate = tuple[float, float, float]


def _response(
    results: Sequence[SineResult],
) -> tuple[_Estimate | None, _Estimate | None, _Estimate | None, _Estimate | None]:
    """Gain, leakage, delay and loss angle: phase = atan(1 / (w tau)) - w d - theta by least squares."""
    w = np.array([2 * np.pi * r.frequency for r in results])
    ordered = np.sort(w)
    if len(w) < 4 or np.count_nonzero(np.diff(ordered) > 0.1 * ordered[1:]) < 2:
        return None, None, None, None
    phase = np.radians([r.phase for r in results])

    def residual(p: Array) -> Array:
        return np.asarray(np.arctan2(p[0], w) - w * p[1] - p[2] - phase)

    start = np.array([max(float(np.tan(phase[np.argmin(w)])) * float(w.min()), 1e-4), 0.0, 0.0])
    solution = optimize.least_squares(residual, start, x_scale=(1e-2, 1e-4, 1e-3))
    spread = 2 * solution.cost / max(len(w) - 3, 1)
    quantile = stats.t.ppf(0.975, len(w) - 3)
    wide = quantile * np.sqrt(np.diag(np.linalg.inv(solution.jac.T @ solution.jac)) * spread)
    rate, delay, loss = (float(v) for v in solution.x)
    low, high = float(rate - wide[0]), float(rate + wide[0])
    tau = tuple(1 / r if r > 0 else np.inf for r in (rate, high, low))
    sizes = [
        np.sign(r.sensitivity) * abs(r.gain) * np.hypot(1, max(rate, 0) / wi)
        for r, wi in zip(results, w, strict=True)
    ]
    mean, reach = np.mean(sizes), stats.t.ppf(0.975, len(w) - 1) * np.std(sizes, ddof=1) / np.sqrt(len(w))
    return (
        (float(mean), float(mean - reach), float(mean + reach)),
        (tau[0], tau[1], tau[2]),
        (delay, delay - float(wide[1]), delay + float(wide[1])),
        (float(np.degrees(loss)), float(np.degrees(loss - wide[2])), float(np.degrees(loss + wide[2]))),
    )
