"""A Bingham damper under a sine and a step of current, to see what one form of an effect adds."""

from __future__ import annotations

import numpy as np

from mrdamp.model import core

BINGHAM = {"c0a": 800.0, "c0b": 300.0, "fya": 50.0, "fyb": 400.0, "v_ref": 0.004}
DT = 5e-4  # s
T = np.arange(0.0, 1.0, DT)
OMEGA = 3 * np.pi  # rad/s
X, V = 0.01 * np.sin(OMEGA * T), 0.01 * OMEGA * np.cos(OMEGA * T)  # m, m/s
STEP = np.where((T > 0.2) & (T < 0.6), 1.0, 0.0)  # A, up and down again


def run(column: str, u: np.ndarray | float = 0.5, **effect: float) -> np.ndarray:
    signed = {"command_min": -10.0}  # a negative field stays negative
    return core.run("bingham", {**BINGHAM, **signed, **effect}, DT, X, u=u, columns=(column,))[column]


def speed(t: float) -> float:
    return float(0.01 * OMEGA * np.cos(OMEGA * t))


def only(where: np.ndarray, values: np.ndarray | float) -> np.ndarray:
    """NaN elsewhere: no value is expected there."""
    return np.where(where, values, np.nan)


def close(found: np.ndarray, expected: np.ndarray, most: float) -> None:
    """Wherever a value is expected, but for the ends, where the velocity is one of differences."""
    at = np.flatnonzero(np.isfinite(expected))
    at = at[(at >= 5) & (at < len(T) - 5)]
    assert len(at) > 100
    np.testing.assert_allclose(found[at], expected[at], rtol=0.0, atol=most)
