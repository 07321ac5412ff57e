"""What a laboratory should know of a fit besides its error: ranges reached, commands left, causes not fitted along."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mrdamp.identify.excerpts import is_led, skipped
from mrdamp.identify.fit import Fit, simulate
from mrdamp.model import Effect, Model
from mrdamp.records import Record
from mrdamp.simulation.predict import BEYOND, carried_noise, clamped, free_run

#: Share of its range next to an end within which a coordinate has reached it.
_AT_LIMIT = 1e-3
#: Shares of the remaining error that are told: what a lag of the driver would take off, what parting a fitted lag into
#: lag and delay would, what noise of the displacement makes. Below, intervals of exact laws held the truth.
_WORTH, _WORTH_PARTING, _WORTH_NOISE = 0.3, 0.15, 0.15
#: What a fit searches in place of Bouc-Wen's A, gamma and beta, whose z ends at 1.
_COORDINATES = {"beta_share": ", beta / (beta + gamma),", "yield_displacement": ", 1 / A in m,"}
#: A held-out record is an extrapolation if it is faster by this factor than all that was fitted.
_FASTER = 1.25
#: s, lags that are tried; shares of a fitted lag that are tried as a delay.
_LAGS = 0.003, 0.01, 0.03, 0.1
_SPLITS = 0.2, 0.35, 0.5, 0.7
#: Share of half the sampling rate from which a low-pass takes off little.
_BELOW_NYQUIST = 0.8


def findings(fit: Fit, train: Sequence[Record], held_out: Sequence[Record]) -> list[str]:
    """A line for each; empty where there is nothing to say."""
    lines = [*_limits(fit), *_one_command(fit.model, train)]
    lines += [f"{record.label}: {said}" for record in held_out if (said := clamped(fit.model, record))]
    left = _left(fit.model, train, fit.started)
    return [*lines, *_faster(train, held_out), *_starts(fit, train), *_lag(fit, train), *_motion(fit, train, left)]


def _left(model: Model, records: Sequence[Record], started: Mapping[str, float]) -> float:
    """RMS error, N. started: as in `Fit`."""
    residuals = [
        (simulate(model, r, started.get(r.name, 0.0)) - r.channel("force_N"))[skipped(r) :] for r in records
    ]
    return float(np.sqrt(np.mean(np.concatenate(residuals) ** 2)))


def _limits(fit: Fit) -> list[str]:
    if fit.space is None:
        return []
    lines = []
    for c, p in zip(fit.space.coordinates, fit.point, strict=True):
        if c.low < c.unpack(p) < c.high and _AT_LIMIT < p < 1 - _AT_LIMIT:
            continue
        if c.low == 0 and p < 0.5 and not c.log:
            continue  # a part that is not needed
        name = f"{c.name}{_COORDINATES.get(c.name, '')}"
        lines.append(f"{name} is at the end of its range, {c.unpack(p):.4g} of {c.low:.3g} to {c.high:.3g}")
    return lines


def _one_command(model: Model, train: Sequence[Record]) -> list[str]:
    low, high = model.parameters.get("command_min"), model.parameters.get("command_max")
    if low is None or low != high:
        return []
    return [
        f"{train[0].label}: one command, {low:g}: how the law follows it is unknown; the model holds for it alone"
    ]


def _faster(train: Sequence[Record], held_out: Sequence[Record]) -> list[str]:
    """Held-out records that are faster than every fitted one."""
    fitted = max(_speed(record) for record in train)
    return [
        f"{record.label}: held out with speeds up to {speed:.3g} m/s, fitted up to {fitted:.3g}: its error is that of"
        " an extrapolation"
        for record in held_out
        if (speed := _speed(record)) > _FASTER * fitted
    ]


def _speed(record: Record) -> float:
    """m/s, that a record exceeds in a hundredth of its samples."""
    return float(np.quantile(np.abs(record.velocity()), 0.99))


def _starts(fit: Fit, train: Sequence[Record]) -> list[str]:
    """Records that begin in motion, and what the slow state at their start is worth."""
    moving = sum(is_led(record) for record in train)
    led = [record for record in train if fit.started.get(record.name)]
    if not led:
        return [
            f"{moving} of {len(train)} records begin in motion: their state at the start is estimated, and parameters"
            " may be off by more than their intervals; begin the recording before the motion"
        ] * (moving > 0)
    both = [_left(fit.model, led, started) for started in ({}, fit.started)]
    return [
        f"{len(led)} records begin in motion, with a slow state (x - y) that is not measured: {both[0]:.3g} N"
        f" without it, {both[1]:.3g} N with it as fitted; a prediction cannot know it"
    ]


def _lag(fit: Fit, train: Sequence[Record]) -> list[str]:
    """A lag of the driver or a delay of the command that was not fitted along, by trying it on the law as it is."""
    moved = [
        r for r in train if float(np.ptp(r.command)) > BEYOND * max(float(np.abs(r.command).max()), 1e-12)
    ]
    effects = {e.name: e for e in fit.model.effects}
    if not moved or "command_delay" in effects:
        return []
    fitted = effects.pop("driver_lag", None)
    tried = [(tau, 0.0) for tau in _LAGS]
    if fitted is not None:
        tried = [
            ((1 - share) * fitted.parameters["tau"], share * fitted.parameters["tau"]) for share in _SPLITS
        ]
    own, best = _left(fit.model, moved, {}), (np.inf, 0.0, 0.0)
    for tau, d in tried:
        more = [Effect("driver_lag", {"tau": tau}), *([Effect("command_delay", {"d": d})] if d else [])]
        best = min(best, (_left(fit.model.with_effects((*effects.values(), *more)), moved, {}), tau, d))
    left, tau, d = best
    if left > (1 - (_WORTH if fitted is None else _WORTH_PARTING)) * own:
        return []
    what = f"a lag of the driver of about {1e3 * tau:.3g} ms"
    if d:
        what = f"a delay of the command of about {1e3 * d:.2g} ms before {what}"
    extras = "driver_lag command_delay" if d else "driver_lag"
    return [
        f"{what} would take the error under a changing command from {own:.3g} to {left:.3g} N: fit again with"
        f" --extras offset {extras}"
    ]


def _motion(fit: Fit, train: Sequence[Record], left: float) -> list[str]:
    """Noise or steps of the displacement, as far as the law turns them into force."""
    found = [carried_noise(fit.model, r, free_run(fit.model, r)["force_N"]) for r in train]
    level, carried = np.median(found, axis=0)  # noise may change how a record is led into
    if not level > 0 or carried < _WORTH_NOISE * left:
        return []
    cutoff = _cutoff(train)
    nyquist = min(0.5 / record.sample_time for record in train)
    advice = f"; compare with --cutoff {cutoff:.2g}" if cutoff < _BELOW_NYQUIST * nyquist else ""
    return [
        f"noise or steps of the displacement, {1e6 * level:.2g} um, are {carried:.3g} N of the simulated force (error"
        f" {left:.3g} N): parameters may be biased by it{advice}"
    ]


def _cutoff(train: Sequence[Record]) -> float:
    """Hz, ten times the frequency below which the motion lies: a loop needs its harmonics."""
    bands = []
    for record in train:
        power = np.abs(np.fft.rfft(record.displacement - np.mean(record.displacement))) ** 2
        bands.append(np.searchsorted(np.cumsum(power), 0.99 * power.sum()) / record.duration)
    return 10 * float(np.max(bands))
