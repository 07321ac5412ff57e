"""A Bingham damper under a sine and a step of current, to see what one form of an effect adds."""

from __future__ import annotations

import numpy as np

from mrdamp.model import core

BINGHAM = {"c0a": 800.0, "c0b": 300.0, "fya": 50.0, "fyb": 400.0, "v_ref": 0.004}
DT = 5e-4  # s
T = np.arange(0.0, 1.0, DT)
X = 0.01 * np.sin(2 * np.pi * 1.5 * T)  # m
STEP = np.where((T > 0.2) & (T < 0.6), 1.0, 0.0)  # A, up and down again


def run(column: str, u: np.ndarray | float = 0.5, **effect: float) -> np.ndarray:
    signed = {"command_min": -10.0}  # a negative field stays negative
    return core.run("bingham", {**BINGHAM, **signed, **effect}, DT, X, u=u, columns=(column,))[column]
