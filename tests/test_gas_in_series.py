"""A pocket of gas in series with the fluid, against its differential equation in SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dampers import rms
from form_runs import DT, T, X
from mrdamp.model import core

C = 4000.0  # N s/m, a dashpot
LAW = {"c0a": C, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01}
FORCE, LENGTH, EXPONENT, WIDTH = 60.0, 0.003, 1.3, 0.02
GAS = {
    "trapped_gas_series": 1.0,
    "trapped_gas_force": FORCE,
    "trapped_gas_s_g": LENGTH,
    "trapped_gas_shape": EXPONENT,
    "trapped_gas_width": WIDTH,
}
OMEGA = 3 * np.pi
V = 0.01 * OMEGA * np.cos(OMEGA * T)


def gas(q: float) -> float:
    return float(FORCE * ((1 - min(q / LENGTH, 1 - 1e-9)) ** -EXPONENT - 1))


def simulated(step: float | None = None, **other: float) -> np.ndarray:
    return core.run("bingham", LAW | GAS | other, DT, X, V, substep=step, columns=("force",))["force"]


def one_sided(side: float) -> np.ndarray:
    """q' = (v - F(q) / c) / w while the rod or the gas presses, v towards the pocket."""

    def rate(t: float, y: np.ndarray) -> list[float]:
        v = side * 0.01 * OMEGA * np.cos(OMEGA * t)
        q = max(y[0], 0.0)
        share = 0.5 * (1 + np.tanh(v / WIDTH))
        return [(v - gas(q) / C) / share if q > 0 or v > 0 else 0.0]

    q = solve_ivp(rate, (0, T[-1]), [0.0], "Radau", t_eval=T, max_step=1e-3, rtol=1e-8, atol=1e-12).y[0]
    v = side * V
    return side * np.where((q > 1e-9) | (v > 0), [gas(max(k, 0.0)) for k in q], C * v)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_fluid_moves_less_while_gas_is_pressed(side: float) -> None:
    expected = one_sided(side)

    def error(**other: float) -> float:
        return rms(simulated(trapped_gas_direction=side, **other) - expected) / rms(expected)

    assert error() < 0.01
    assert error(trapped_gas_shape=1.5 * EXPONENT) > 0.02
    assert error(trapped_gas_s_g=1.3 * LENGTH) > 0.02
    assert error(trapped_gas_width=4 * WIDTH) > 0.012
    assert error(trapped_gas_series=0.0) > 0.05


@pytest.mark.parametrize("k", [0.0, 2e5])
def test_gas_on_both_sides_is_a_spring_ahead_of_the_fluid(k: float) -> None:
    """With a mount's spring too: (dq/dF + 1 / k) F' = v - F / c."""

    def rate(t: float, y: np.ndarray) -> list[float]:
        v = 0.01 * OMEGA * np.cos(OMEGA * t)
        give = LENGTH / (EXPONENT * FORCE) * (1 + abs(y[0]) / FORCE) ** (-1 / EXPONENT - 1)
        return [(v - y[0] / C) / (give + (1 / k if k else 0.0))]

    y = solve_ivp(rate, (0, T[-1]), [0.0], "Radau", t_eval=T, rtol=1e-8, atol=1e-8).y[0]
    mount = {"mount_compliance_k": k}
    assert rms(simulated(trapped_gas_direction=0.0, **mount) - y) < 0.005 * rms(y)
    assert rms(simulated(trapped_gas_direction=0.0, mount_compliance_k=4e4) - y) > 0.02 * rms(y)


@pytest.mark.parametrize("law", [LAW, {**LAW, "fya": 200.0, "v_ref": 0.0}])
def test_step_of_the_chain_matters_little(law: dict[str, float]) -> None:
    """Dry friction too: where the rod turns the fluid sticks and the gas gives."""

    def run(step: float, **other: float) -> np.ndarray:
        settings = law | GAS | other
        return core.run("bingham", settings, 1e-3, X[::2], V[::2], substep=step, columns=("force",))["force"]

    for mount in ({}, {"mount_compliance_k": 5e5}):
        fine, coarse = run(2e-5, **mount), run(1e-3, **mount)
        assert rms(coarse - fine) < 0.02 * rms(fine)
