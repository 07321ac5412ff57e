"""A mass in the prediction of a damper's record: its acceleration is not the displacement's noise."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.model import Effect, Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.simulation.predict import free_run

MASS, NOISE, VISCOSITY = 60.0, 2e-6, 800.0
LAW = {"c0a": VISCOSITY, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01}


def forces(dt: float, noise: float, *effects: Effect) -> tuple[Array, Array]:
    """Predicted force (n,) N of 15 mm at 2 Hz, and m a + c v of the motion without noise."""
    t = dt * np.arange(round(2 / dt))
    x = 0.015 * np.sin(4 * np.pi * t)
    noisy = x + noise * np.random.default_rng(1).standard_normal(len(t))
    record = Record("sine", None, dt, {"displacement_m": noisy, "command": np.zeros(len(t))})
    mass = sum(e.parameters["m"] for e in effects)
    exact = -mass * (4 * np.pi) ** 2 * x + VISCOSITY * 0.015 * 4 * np.pi * np.cos(4 * np.pi * t)
    keep = slice(round(0.1 / dt), -round(0.1 / dt))
    return free_run(Model("bingham", LAW, effects), record)["force_N"][keep], exact[keep]


@pytest.mark.parametrize("dt", [5e-4, 1e-3, 2e-3])
def test_a_mass_is_moved_without_the_displacements_noise(dt: float) -> None:
    """Differentiated as it is, the noise is a force of m sigma sqrt(6) / dt^2."""
    found, exact = forces(dt, NOISE, Effect("moving_mass", {"m": MASS}))
    assert np.std(found - exact) < 0.1 * MASS * NOISE * np.sqrt(6) / dt**2


def test_without_noise_or_mass_nothing_is_smoothed() -> None:
    plain, _ = forces(1e-3, NOISE)
    idle, _ = forces(1e-3, NOISE, Effect("moving_mass", {"m": 0.0}))
    assert idle == pytest.approx(plain, abs=1e-9)
    found, exact = forces(1e-3, 0.0, Effect("moving_mass", {"m": MASS}))
    assert np.std(found - exact) < 1e-3 * np.std(exact)
