"""How well a controller did: what the structure, the damper and the command went through, and the people in a car.

The ratios are those of the benchmark for seismically excited buildings: Ohtori, Christenson,
Spencer and Dyke, J. Eng. Mech. 130 (2004) 366-385, doi 10.1061/(ASCE)0733-9399(2004)130:4(366).
Here drifts are not divided by storey heights (equal heights leave the ratios as they are), and J12 is
the stroke over the uncontrolled motion between the damper's own two floors.

Ride comfort: the frequency weighting Wk of ISO 2631-1 for vertical vibration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from mrdamp.errors import InputError
from mrdamp.model.core import Array
from mrdamp.structures import FloatArray, ShearFrame


@dataclass(frozen=True, eq=False)
class Criteria:
    """Of one run of an N-storey frame, SI. RMS values are norms over the run's duration."""

    duration: float  # s
    peak_drift: FloatArray  # (N,) m, per storey
    rms_drift: FloatArray  # (N,) m
    peak_displacement: FloatArray  # (N,) m, per floor, to the ground
    peak_acceleration: FloatArray  # (N,) m/s2, absolute, per floor
    rms_acceleration: FloatArray  # (N,) m/s2
    peak_base_shear: float  # N, all that the ground carries, the damper's share included
    rms_base_shear: float  # N
    peak_force: float  # N
    rms_force: float  # N
    peak_stroke: float  # m
    dissipated_energy: float  # J, what the damper took in
    mean_command: float  # A or V, of its magnitude
    rms_command: float  # A or V
    switching_rate: float  # 1/s, full swings of the command a second
    weight: float  # N, of the structure

    def relative_to(self, uncontrolled: Criteria) -> dict[str, float]:
        """The benchmark's ratios over a run of the same frame and ground motion without the damper, the largest over
        storeys or floors: J1 peak drift, J2 peak absolute acceleration, J3 peak base shear, J4 to J6 their norms, J11
        peak force of the damper over the weight of the structure, J12 peak stroke.

        Raises InputError where the uncontrolled frame did not move.
        """
        u = uncontrolled
        for what, value in (
            ("drift", u.peak_drift.max()),
            ("acceleration", u.peak_acceleration.max()),
            ("stroke", u.peak_stroke),
        ):
            if not value > 0:
                raise InputError(
                    f"criteria: peak {what} of the uncontrolled run is {value:g}; it must be > 0"
                )
        return {
            "J1": float(self.peak_drift.max() / u.peak_drift.max()),
            "J2": float(self.peak_acceleration.max() / u.peak_acceleration.max()),
            "J3": self.peak_base_shear / u.peak_base_shear,
            "J4": float(self.rms_drift.max() / u.rms_drift.max()),
            "J5": float(self.rms_acceleration.max() / u.rms_acceleration.max()),
            "J6": self.rms_base_shear / u.rms_base_shear,
            "J11": self.peak_force / self.weight,
            "J12": self.peak_stroke / u.peak_stroke,
        }


def evaluate(
    frame: ShearFrame, time: ArrayLike, drift: ArrayLike, acceleration: ArrayLike, force: ArrayLike | None = None,
    stroke: ArrayLike | None = None, command: ArrayLike | None = None, command_max: float | None = None,
) -> Criteria:  # fmt: skip
    """Criteria of one run.

    time (n,) s, increasing; drift (n, N) m; acceleration (n, N) m/s2, absolute; force (n,) N,
    positive when the damper is being extended, None: no damper; stroke (n,) m, None: from the
    drifts; command (n,) A or V, held between samples, None: zero. Of m dampers, the frame's, these
    are (n, m): peaks are of the worst, commands means over them, energies sums. command_max: the swing the
    switching rate counts in, None: the largest |command|. Raises InputError on shapes that do
    not fit, on NaN and on a time that does not increase.
    """
    t = _array("time", time, None)
    n = len(t)
    if n < 2 or not (np.diff(t) > 0).all():
        raise InputError(f"criteria: time has {n} samples or does not increase; at least 2, increasing")
    d = _array("drift", drift, (n, frame.storeys))
    a = _array("acceleration", acceleration, (n, frame.storeys))
    x = frame.displacement(d)
    many = (n, len(frame.places)) if frame.others else (n,)
    f, s, u = (
        _array(name, default if values is None else values, many).reshape(n, -1)
        for name, values, default in (
            ("force", force, np.zeros(many)),
            ("stroke", stroke, frame.stroke(x)),
            ("command", command, np.zeros(many)),
        )
    )
    # Newton for the whole structure: what the ground carries is the sum of mass times acceleration.
    shear = a @ frame.mass
    swing = float(np.abs(u).max()) if command_max is None else command_max
    duration = float(t[-1] - t[0])
    held = np.diff(t) / duration
    return Criteria(
        duration=duration,
        peak_drift=np.abs(d).max(axis=0),
        rms_drift=_norm(t, d),
        peak_displacement=np.abs(x).max(axis=0),
        peak_acceleration=np.abs(a).max(axis=0),
        rms_acceleration=_norm(t, a),
        peak_base_shear=float(np.abs(shear).max()),
        rms_base_shear=float(_norm(t, shear)),
        peak_force=float(np.abs(f).max()),
        rms_force=float(_norm(t, f).max()),
        peak_stroke=float(np.abs(s).max()),
        dissipated_energy=float(np.sum((f[1:] + f[:-1]) / 2 * np.diff(s, axis=0))),
        mean_command=float(np.abs(u[:-1]).mean(axis=1) @ held),
        rms_command=float(np.sqrt((u[:-1] ** 2).mean(axis=1) @ held)),
        switching_rate=float(np.abs(np.diff(u, axis=0)).sum() / u.shape[1] / swing / duration) if swing > 0 else 0.0,
        weight=frame.weight,
    )


def _norm(t: FloatArray, values: FloatArray) -> FloatArray:
    """sqrt(1/T integral of values^2 dt), over the first axis, by the trapezoidal rule."""
    return np.asarray(np.sqrt(np.trapezoid(values**2, t, axis=0) / (t[-1] - t[0])))


def _array(name: str, values: ArrayLike, shape: tuple[int, ...] | None) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 if shape is None else array.shape != shape:
        raise InputError(f"criteria: {name} has shape {array.shape}; allowed: {shape or '(n,)'}")
    if not np.isfinite(array).all():
        first = np.argwhere(~np.isfinite(array))[0][0]
        raise InputError(f"criteria: {name} has a value that is not finite at sample {first}")
    return array


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
