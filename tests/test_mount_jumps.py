"""A piston behind a clearance whose force jumps where it turns."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.model import core

LAW = {
    "c0a": 930.0, "c0b": 860.0, "k0": 250.0, "x0": 0.0, "alpha_a": 19e3, "alpha_b": 109e3,
    "gamma": 1.03e6, "beta": 0.95e6, "A": 144.0, "n": 2.0,
}  # fmt: skip
GAS = {"trapped_gas_d": 0.83, "trapped_gas_s_g": 7.6e-4, "trapped_gas_direction": -1.0}


@pytest.mark.parametrize("friction", [0.0, 150.0])
@pytest.mark.parametrize("stiffness", [1e6, 1e7, 2e8])
def test_the_force_stays_that_of_the_damper(stiffness: float, friction: float) -> None:
    """Behind a mount the force is no larger than without one, but for what the clearance's end gives back."""
    dt = 5e-4
    t = dt * np.arange(16000)
    rng = np.random.default_rng(3)
    x = np.sum(
        [2e-3 / f * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.7, 1.9, 4.3, 8.1)], axis=0
    )
    u = np.interp(t, np.arange(0.0, 9.0, 0.25), rng.uniform(0, 1, 36))
    free = core.run("bouc_wen", LAW | GAS, dt, x, u=u)["force"]
    mount = {"backlash_gap": 2.5e-4, "backlash_k": stiffness, "mount_compliance_friction": friction}
    held = core.run("bouc_wen", LAW | GAS | mount, dt, x, u=u)["force"]
    assert np.abs(held).max() < 1.5 * np.abs(free).max()
    assert np.sqrt(np.mean(held**2)) == pytest.approx(np.sqrt(np.mean(free**2)), rel=0.3)
