"""Forms of the mount between rod and piston against SciPy, or what they say of the piston's own motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dampers import rms
from form_runs import BINGHAM, DT, T, X
from mrdamp.model import core


def test_mount_hardens_with_its_deflection() -> None:
    k, k3 = 2e5, 4e5
    out = core.run(
        "bingham",
        {**BINGHAM, "mount_compliance_k": k, "mount_compliance_k3": k3},
        DT,
        X,
        u=0.5,
        columns=("force", "piston"),
    )
    d = X - out["piston"]
    late = T > 0.05
    np.testing.assert_allclose(out["force"][late], (k * d * (1 + k3 * d**2))[late], rtol=1e-3, atol=0.5)
    assert np.abs(k3 * d**2).max() > 0.5  # the cubic part is no trifle here


def errors(attributes: dict[str, float], x: np.ndarray, expected: np.ndarray) -> Callable[..., float]:
    """A function of other attributes: RMS difference of the chain's force from the expected, over the latter's RMS."""

    def error(**other: float) -> float:
        force = core.run("bingham", attributes | other, DT, x, u=0.0, columns=("force",))["force"]
        return rms((force - expected)[5:-5]) / rms(expected)

    return error


@pytest.mark.parametrize("gap", [0.0, 3e-4])
def test_a_bush_meets_its_stop(gap: float) -> None:
    """Against SciPy: two slopes in series with a dashpot."""
    k, stop, stiffer, c = 1.5e5, 4e-4, 3.0, 1600.0
    law = {"c0a": c, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.03}
    x = 0.01 * np.sin(3 * np.pi * T) + 4e-4 * np.sin(34 * np.pi * T)

    def spring(d: np.ndarray) -> np.ndarray:
        d = np.sign(d) * np.maximum(np.abs(d) - gap / 2, 0.0)
        return np.asarray(k * (d + stiffer * np.sign(d) * np.maximum(np.abs(d) - stop, 0.0)))

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        rod = 0.01 * np.sin(3 * np.pi * t) + 4e-4 * np.sin(34 * np.pi * t)
        return spring(rod - y) / c

    y = solve_ivp(rates, (0, T[-1]), [0.0], t_eval=T, max_step=1e-4, rtol=1e-7, atol=1e-10).y[0]
    expected = spring(x - y)
    bush = {"mount_compliance_k": k, "mount_compliance_stop": stop, "mount_compliance_stiffer": stiffer}
    if gap:
        bush["backlash_gap"] = gap

    error = errors(law | bush, x, expected)

    assert error() < 0.01
    assert error(mount_compliance_stiffer=0.0) > 0.02
    assert error(mount_compliance_stop=0.0) > 0.02


@pytest.mark.parametrize("gap", [0.0, 3e-4])
def test_a_mount_has_friction_inside(gap: float) -> None:
    """Against SciPy: a spring and a Dahl element in parallel, in series with a dashpot."""
    c, k, largest, slide = 3e3, 2e5, 80.0, 2e-4
    law = {"c0a": c, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01}
    rubber = {"mount_compliance_k": k, "mount_compliance_friction": largest, "mount_compliance_slide": slide,
              "backlash_gap": gap}  # fmt: skip
    x = X + 4e-4 * np.sin(2 * np.pi * 17 * T)

    def rates(t: float, y: np.ndarray) -> list[float]:
        rod = 0.01 * np.sin(3 * np.pi * t) + 4e-4 * np.sin(34 * np.pi * t)
        speed = 0.03 * np.pi * np.cos(3 * np.pi * t) + 0.0136 * np.pi * np.cos(34 * np.pi * t)
        d = rod - y[0]
        beyond = d - np.clip(d, -gap / 2, gap / 2)
        force = k * beyond + largest * y[1]
        stretch = (speed - force / c) * (beyond != 0 or gap == 0)
        return [force / c, (stretch - abs(stretch) * y[1]) / slide]

    y = solve_ivp(rates, (0, T[-1]), [0.0, 0.0], t_eval=T, max_step=1e-4, rtol=1e-6, atol=1e-9).y
    d = x - y[0]
    expected = k * (d - np.clip(d, -gap / 2, gap / 2)) + largest * y[1]

    error = errors(law | rubber, x, expected)

    assert error() < 0.01
    assert error(mount_compliance_friction=0.0) > 0.03
    assert error(mount_compliance_slide=2 * slide) > 0.012


@pytest.mark.parametrize("gap", [0.0, 3e-4])
def test_a_mount_lets_go(gap: float) -> None:
    """Against SciPy: a standard linear solid in series with a dashpot."""
    c, k, loss, time = 3e3, 2e5, 1.5, 0.04
    law = {"c0a": c, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01}
    rubber = {"mount_compliance_k": k, "mount_compliance_loss": loss, "mount_compliance_time": time,
              "backlash_gap": gap}  # fmt: skip
    x = X + 4e-4 * np.sin(2 * np.pi * 17 * T)

    def beyond(d: np.ndarray | float) -> np.ndarray | float:
        return d - np.clip(d, -gap / 2, gap / 2)

    def rates(t: float, y: np.ndarray) -> list[float]:
        rod = 0.01 * np.sin(3 * np.pi * t) + 4e-4 * np.sin(34 * np.pi * t)
        speed = 0.03 * np.pi * np.cos(3 * np.pi * t) + 0.0136 * np.pi * np.cos(34 * np.pi * t)
        d = beyond(rod - y[0])
        force = k * (d + loss * y[1])
        stretch = (speed - force / c) * (d != 0 or gap == 0)
        return [force / c, stretch - y[1] / time]

    y = solve_ivp(rates, (0, T[-1]), [0.0, 0.0], t_eval=T, max_step=1e-4, rtol=1e-6, atol=1e-9).y
    expected = k * (beyond(x - y[0]) + loss * y[1])

    error = errors(law | rubber, x, expected)

    assert error() < 0.01
    assert error(mount_compliance_loss=0.0) > 0.03
    assert error(mount_compliance_time=2 * time) > 0.012
