"""Forms of the mount between rod and piston against SciPy, or what they say of the piston's own motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dampers import rms
from form_runs import DT, T, X, run
from mjcf_builders import dashpot
from mrdamp.model import core

K, C = 2e5, 3e3  # N/m of the mount, N s/m of the damper behind it
SHAKEN = X + 4e-4 * np.sin(34 * np.pi * T)
Rates = Callable[[float, float, np.ndarray], list[float]]


def test_mount_hardens_with_its_deflection() -> None:
    mount = {"mount_compliance_k": K, "mount_compliance_k3": 4e5}
    d = X - run("piston", **mount)
    late = T > 0.05
    expected = K * d * (1 + 4e5 * d**2)
    np.testing.assert_allclose(run("force", **mount)[late], expected[late], rtol=1e-3, atol=0.5)
    assert np.abs(4e5 * d**2).max() > 0.5  # the cubic part is no trifle here


def beyond(d: np.ndarray | float, gap: float) -> np.ndarray:
    """What of a deflection is beyond the clearance."""
    return np.asarray(d - np.clip(d, -gap / 2, gap / 2))


def inner(rates: Rates) -> np.ndarray:
    """States (n, 2) by SciPy of piston and mount; rates(deflection, the rod's speed, state)."""

    def at(t: float, y: np.ndarray) -> list[float]:
        rod = 0.01 * np.sin(3 * np.pi * t) + 4e-4 * np.sin(34 * np.pi * t)
        speed = 0.03 * np.pi * np.cos(3 * np.pi * t) + 0.0136 * np.pi * np.cos(34 * np.pi * t)
        return rates(rod - y[0], speed, y)

    return np.asarray(solve_ivp(at, (0, T[-1]), [0.0, 0.0], "LSODA", T, max_step=2e-4, rtol=1e-7, atol=1e-10).y)


def errors(mount: dict[str, float], expected: np.ndarray, *wrong: tuple[dict[str, float], float]) -> None:
    """The chain's force is the expected one, and is not with other attributes, by a least error each."""

    def error(**other: float) -> float:
        attributes = dashpot(C) | {"mount_compliance_k": K} | mount | other
        force = core.run("bingham", attributes, DT, SHAKEN, u=0.0)["force"]
        return rms((force - expected)[5:-5]) / rms(expected)

    assert error() < 0.01
    for other, least in wrong:
        assert error(**other) > least, other


@pytest.mark.parametrize("gap", [0.0, 3e-4])
def test_a_bush_meets_its_stop(gap: float) -> None:
    """Two slopes in series with a dashpot."""
    stop, stiffer = 4e-4, 3.0

    def spring(d: np.ndarray | float) -> np.ndarray:
        d = beyond(d, gap)
        return np.asarray(K * (d + stiffer * beyond(d, 2 * stop)))

    y = inner(lambda d, speed, y: [float(spring(d)) / C, 0.0])
    bush = {"mount_compliance_stop": stop, "mount_compliance_stiffer": stiffer, "backlash_gap": gap}
    errors(bush, spring(SHAKEN - y[0]),
           ({"mount_compliance_stiffer": 0.0}, 0.02), ({"mount_compliance_stop": 0.0}, 0.02))  # fmt: skip


@pytest.mark.parametrize("gap", [0.0, 3e-4])
def test_a_mount_has_friction_inside(gap: float) -> None:
    """A spring and a Dahl element in parallel, in series with a dashpot."""
    largest, slide = 80.0, 2e-4

    def rates(d: float, speed: float, y: np.ndarray) -> list[float]:
        past = float(beyond(d, gap))
        force = K * past + largest * y[1]
        stretch = (speed - force / C) * (past != 0 or gap == 0)
        return [force / C, (stretch - abs(stretch) * y[1]) / slide]

    y = inner(rates)
    rubber = {"mount_compliance_friction": largest, "mount_compliance_slide": slide, "backlash_gap": gap}
    errors(rubber, K * beyond(SHAKEN - y[0], gap) + largest * y[1],
           ({"mount_compliance_friction": 0.0}, 0.03), ({"mount_compliance_slide": 2 * slide}, 0.012))  # fmt: skip


@pytest.mark.parametrize("gap", [0.0, 3e-4])
def test_a_mount_lets_go(gap: float) -> None:
    """A standard linear solid in series with a dashpot."""
    loss, time = 1.5, 0.04

    def rates(d: float, speed: float, y: np.ndarray) -> list[float]:
        past = float(beyond(d, gap))
        force = K * (past + loss * y[1])
        return [force / C, (speed - force / C) * (past != 0 or gap == 0) - y[1] / time]

    y = inner(rates)
    rubber = {"mount_compliance_loss": loss, "mount_compliance_time": time, "backlash_gap": gap}
    errors(rubber, K * (beyond(SHAKEN - y[0], gap) + loss * y[1]),
           ({"mount_compliance_loss": 0.0}, 0.03), ({"mount_compliance_time": 2 * time}, 0.012))  # fmt: skip


LAW = {
    "c0a": 930.0, "c0b": 860.0, "k0": 250.0, "x0": 0.0, "alpha_a": 19e3, "alpha_b": 109e3,
    "gamma": 1.03e6, "beta": 0.95e6, "A": 144.0, "n": 2.0,
}  # fmt: skip
GAS = {"trapped_gas_d": 0.83, "trapped_gas_s_g": 7.6e-4, "trapped_gas_direction": -1.0}


@pytest.mark.parametrize("friction", [0.0, 150.0])
@pytest.mark.parametrize("stiffness", [1e6, 1e7, 2e8])
def test_behind_a_clearance_a_force_that_jumps_at_the_turns_stays_that_of_the_damper(
    stiffness: float, friction: float
) -> None:
    """It is no larger than without a mount, but for what the clearance's end gives back."""
    dt = 5e-4
    t = dt * np.arange(16000)
    rng = np.random.default_rng(3)
    x = np.sum([2e-3 / f * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.7, 1.9, 4.3, 8.1)], axis=0)
    u = np.interp(t, np.arange(0.0, 9.0, 0.25), rng.uniform(0, 1, 36))
    free = core.run("bouc_wen", LAW | GAS, dt, x, u=u)["force"]
    mount = {"backlash_gap": 2.5e-4, "backlash_k": stiffness, "mount_compliance_friction": friction}
    held = core.run("bouc_wen", LAW | GAS | mount, dt, x, u=u)["force"]
    assert np.abs(held).max() < 1.5 * np.abs(free).max()
    assert rms(held) == pytest.approx(rms(free), rel=0.3)
