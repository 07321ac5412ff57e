"""Sparse regression of the residual on functions of motion, command and simulated force, by pysindy's STLSQ.

Sequentially thresholded least squares (Brunton, Proctor, Kutz 2016, doi:10.1073/pnas.1517384113). The
function with the largest share of the residual is reported as the effect with that form to first order.
"""

from __future__ import annotations

import importlib.util
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mrdamp.diagnosis.case.folder import Case
from mrdamp.model import Model
from mrdamp.records.sampling import derivative
from mrdamp.records.smoothing import smoothed
from studies.blindtest.rig import Array

#: Function of the library -> the effect that adds it to the force, to first order.
EFFECT = {
    "1": "sensor_offset",
    "x": "gas_spring",
    "x^2": "gas_spring",
    "x^3": "gas_spring",
    "a": "moving_mass",
    "sign v": "seal_friction",
    "|v| v": "shear_thinning",
    "F": "sensor_gain",
    "|F|": "asymmetry",
    "F'": "sensor_lag",
    "Q": "sensor_leakage",
    "u^2 sign v": "saturation",
    "u' sign v": "driver_lag",
    "|u'| sign v": "remanence",
    "E F": "heating",
}
#: Thresholds, relative to the residual's RMS over that of a function.
_THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.4)
#: Least reduction of the residual on left-out records; otherwise no effect is reported.
_WORTH = 0.1
_SMOOTH_SIGN = 0.005  # m/s
_SLOW = 1.0  # s, time constant for a leaking charge


@dataclass(frozen=True)
class Sparse:
    """effect: of the largest function, empty if none reduces the error enough. predict: simulator plus the
    sum."""

    effect: str
    predict: Callable[[Mapping[str, Array]], Mapping[str, Array]]


def available() -> bool:
    """True if pysindy is installed (extra `bench`)."""
    return importlib.util.find_spec("pysindy") is not None


def regress(case: Case) -> Sparse:
    """The sparse sum for the force of a damper case; its threshold is chosen on every third record, left out
    of the fit."""
    tables, residuals = [], []
    for record in case.records:
        inputs = {name: record.channel(name) for name in ("displacement_m", "command")}
        force = case.model.simulate(record.sample_time, inputs)["force_N"]
        tables.append(library(inputs, force, record.sample_time))
        residuals.append(record.channel("force_N") - force)
    kept = [k for k in range(len(tables)) if k % 3 != 2] or [0]
    left = [k for k in range(len(tables)) if k % 3 == 2] or [0]
    names = list(tables[0])

    def stacked(chosen: list[int]) -> tuple[Array, Array]:
        rows = [np.column_stack([tables[k][name] for name in names]) for k in chosen]
        return np.vstack(rows), np.concatenate([residuals[k] for k in chosen])

    features, target = stacked(kept)
    others, unseen = stacked(left)
    sums = [_stlsq(features, target, threshold) for threshold in _THRESHOLDS]
    errors = [float(np.mean((others @ c - unseen) ** 2)) for c in sums]
    best = int(np.argmin(errors))
    worth = errors[best] < (1 - _WORTH) * float(np.mean(unseen**2))
    coefficients = _stlsq(*stacked([*kept, *left]), _THRESHOLDS[best]) if worth else np.zeros(len(names))
    sizes = np.abs(coefficients) * np.sqrt(np.mean(features**2, axis=0))
    effect = EFFECT[names[int(np.argmax(sizes))]] if sizes.any() else ""
    return Sparse(effect, _predictor(case.model, names, coefficients))


def library(inputs: Mapping[str, Array], force: Array, sample_time: float) -> dict[str, Array]:
    """The functions (n,) by name: motion and command of a record and the simulated force (N)."""
    x = smoothed(inputs["displacement_m"])
    u = inputs["command"]
    v = derivative(x, sample_time)
    sign = np.tanh(v / _SMOOTH_SIGN)
    rate = derivative(u, sample_time)
    return {
        "1": np.ones(len(x)),
        "x": x,
        "x^2": x**2,
        "x^3": x**3,
        "a": derivative(v, sample_time),
        "sign v": sign,
        "|v| v": np.abs(v) * v,
        "F": force,
        "|F|": np.abs(force),
        "F'": derivative(force, sample_time),
        "Q": _memory(force, sample_time),
        "u^2 sign v": u**2 * sign,
        "u' sign v": rate * sign,
        "|u'| sign v": np.abs(rate) * sign,
        "E F": np.cumsum(np.abs(force * v)) * sample_time * force,
    }


def _memory(force: Array, sample_time: float) -> Array:
    """First-order low-pass with a time constant of one second."""
    keep = np.exp(-sample_time / _SLOW)
    out = np.empty(len(force))
    state = 0.0
    for k, value in enumerate(force.tolist()):
        state = keep * state + (1 - keep) * value
        out[k] = state
    return out


def _stlsq(features: Array, target: Array, threshold: float) -> Array:
    """Coefficients (functions,); functions and residual are scaled to an RMS of one for the threshold."""
    from pysindy.optimizers import STLSQ

    sizes = np.sqrt(np.mean(features**2, axis=0))
    sizes[sizes == 0] = 1.0
    size = float(np.sqrt(np.mean(target**2))) or 1.0
    optimizer = STLSQ(threshold=threshold, alpha=1e-6)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a threshold that removes all functions is valid
        optimizer.fit(features / sizes, (target / size)[:, None])
    return np.asarray(optimizer.coef_[0] * size / sizes, dtype=float)


def _predictor(
    model: Model, names: list[str], coefficients: Array
) -> Callable[[Mapping[str, Array]], Mapping[str, Array]]:
    def predict(inputs: Mapping[str, Array]) -> Mapping[str, Array]:
        step = float(inputs["time_s"][1] - inputs["time_s"][0])
        force = model.simulate(step, inputs)["force_N"]
        table = library(inputs, force, step)
        return {"force_N": force + sum(c * table[n] for n, c in zip(names, coefficients, strict=True))}

    return predict
