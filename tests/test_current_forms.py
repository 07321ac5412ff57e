"""Forms of effects ahead of the fluid and behind it, driver, magnetics and mount, by their equations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim, lti

from dampers import rms
from form_runs import DT, STEP, T, X, close, only, run
from mjcf_builders import dashpot
from mrdamp.model import core
from refusals import refuses

U = np.ndarray | float
UP, DOWN = (T > 0.21) & (T < 0.59), T > 0.61
SWELL = np.sin(6 * np.pi * T) * T
ZIGZAG = 1 - np.abs((50 * T) % 2 - 1)
RAMP = 0.5 + 0.4 * T
UP_AND_DOWN = np.interp(T, [0, 0.25, 0.4, 0.55, 0.7, 0.99], [-0.3, 1.0, 0.2, 0.6, 0.0, 0.9])  # A


def led(u: np.ndarray, above: list[float], below: list[float]) -> np.ndarray:
    """What a transfer function makes of a command (n,) that begins at rest."""
    return np.asarray(lsim(lti(above, below), u, T)[1])


def ringing(ratio: float) -> np.ndarray:
    """A step of 0.4 A through a second order of 20 ms."""
    w = 2 * ratio / 0.02
    return np.asarray(0.3 + 0.4 * lsim(lti([w**2], [1, 0.02 * w**2, w**2]), STEP, T, interp=False)[1])


def behind_a_voltage(tau: float, gain: float, integral: float) -> np.ndarray:
    """A coil under a controller whose voltage is at its limit of 1.3 after the jump."""

    def rates(t: float, y: np.ndarray) -> list[float]:
        error = float(np.interp(t, T, 0.2 + 0.8 * STEP)) - y[0]
        asked = gain * error + y[1]
        given = min(max(asked, -1.3), 1.3)
        return [(given - y[0]) / tau, 0.0 if asked != given and asked * error > 0 else gain * error / integral]

    return np.asarray(solve_ivp(rates, (0, T[-1]), [0.2, 0.2], t_eval=T, max_step=1e-4, rtol=1e-7, atol=1e-9).y[0])


def remembered(up: float, down: float) -> np.ndarray:
    """Field by the loop's equation with bounds that change with the current, on its way up and on its way down."""

    def rate(t: float, h: np.ndarray) -> np.ndarray:
        i, after = (np.interp(t + late, T, UP_AND_DOWN) for late in (0.0, 1e-6))
        way = (after - i) / 1e-6
        bound = 1 + (up if way * i > 0 else down) * abs(i)
        return np.asarray((way / 0.2) * (bound - np.sign(way) * h))

    h = solve_ivp(rate, (0, T[-1]), [0.0], t_eval=T, rtol=1e-6, atol=1e-7, max_step=1e-3).y[0]
    return np.asarray(UP_AND_DOWN - 0.1 * h)


def stopped(up: float, down: float, knee: float = np.inf) -> np.ndarray:
    """Field by stops of Prandtl and Ishlinskii written out: a current that comes back finds the field that it left.
    Their bounds follow the current and close where they would turn round."""
    widths, at, branch = 0.1 * 2 * np.arange(1, 7) / 7, np.zeros(6), [0.0]
    fine = np.interp(np.arange(0, T[-1] + 1e-9, DT / 10), T, UP_AND_DOWN)
    for was, i in pairwise(fine):
        above, below = (up, down) if i > 0 else (down, up)
        high, low = max(1 + above * abs(i), 0.0), max(1 + below * abs(i), 0.0)
        at = np.clip(at + i - was, -widths * low, widths * high)
        branch.append(float(np.mean(at) / 0.1))
    return np.asarray(UP_AND_DOWN - 0.1 * np.array(branch)[::10] * np.exp(-((UP_AND_DOWN / knee) ** 2)))


LOOP = {"remanence_b": 0.1, "remanence_d": 0.2}
#: What is looked at, the command, attributes, what is expected and the most that it may be off by.
EQUATIONS: Mapping[str, tuple[str, U, Mapping[str, float], np.ndarray | Callable[[], np.ndarray], float]] = {
    "driver_lag falls at its own rate": (
        "current", STEP, {"driver_lag_tau": 0.02, "driver_lag_fall": 0.06},
        np.where(UP, 1 - np.exp(-(T - 0.2) / 0.02), only(DOWN, np.exp(-(T - 0.6) / 0.06))), 0.03,
    ),
    "driver_lag rises no faster than its rate": (
        "current", STEP, {"driver_lag_tau": 0.002, "driver_lag_rate": 8.0},
        only((T > 0.22) & (T < 0.31), 8 * (T - 0.2)), 0.02,
    ),
    **{f"driver_lag overshoots, ratio {r}": (
        "current", 0.3 + 0.4 * STEP, {"driver_lag_tau": 0.02, "driver_lag_ratio": r}, ringing(r), 0.02,
    ) for r in (0.3, 0.7)},
    "driver_lag of two poles as short as a step": (
        "current", ZIGZAG, {"driver_lag_tau": 4e-4, "driver_lag_tau2": 6e-4}, led(ZIGZAG, [1], [2.4e-7, 1e-3, 1]), 1e-6,
    ),
    "driver_lag by eddy currents in a share of the field": (
        "field", SWELL, {"driver_lag_tau": 0.01, "driver_lag_tau2": 0.15, "driver_lag_share": 0.6},
        led(SWELL, [0.4 * 0.15, 1], [0.01 * 0.15, 0.01 + 0.15, 1]), 1e-3,
    ),
    "driver_lag of a share without a first pole": (
        "field", SWELL, {"driver_lag_tau2": 0.15, "driver_lag_share": 0.6},
        0.4 * SWELL + 0.6 * led(SWELL, [1], [0.15, 1]), 1e-3,
    ),
    **{f"driver_lag under a controller of limited voltage, {tau}": (
        "current", 0.2 + 0.8 * STEP, {"driver_lag_tau": tau, "driver_lag_gain": gain,
                                      "driver_lag_integral": integral, "driver_lag_limit": 1.3},
        partial(behind_a_voltage, tau, gain, integral), 0.015,
    ) for tau, gain, integral in ((0.1, 3.0, 0.1), (0.01, 2.5, 0.02))},
    "remanence of how it got to the start": (
        "field", RAMP, {**LOOP, "remanence_start": -0.8},
        RAMP - 0.1 * (1 - 1.8 * np.exp(-(RAMP - 0.5) / 0.2)), 2e-3,
    ),
    # A test at a constant current begins on the way up from zero, further the larger the current is.
    **{f"remanence risen from zero to {u}": (
        "field", u, {**LOOP, "remanence_rise": 1.0}, np.full(len(T), u - 0.1 * (1 - np.exp(-u / 0.2))), 1e-12,
    ) for u in (0.0, 0.3, 1.0)},
    "remanence with loops that change with the current": (
        "field", UP_AND_DOWN, {**LOOP, "remanence_up": -0.5, "remanence_down": 1.4},
        partial(remembered, -0.5, 1.4), 1e-3,
    ),
    **{f"remanence with stops that change with the current, {up} {down}": (
        "field", UP_AND_DOWN, {"remanence_b": 0.1, "remanence_d": 0.1, "remanence_stops": 1.0, "remanence_up": up,
                               "remanence_down": down}, partial(stopped, up, down), 2e-3,
    ) for up, down in ((0.0, 0.0), (0.0, 1.8), (-0.5, -0.6), (-2.0, 0.5))},
    "remanence with loops that close at saturation": (
        "field", UP_AND_DOWN, {"remanence_b": 0.1, "remanence_d": 0.1, "remanence_stops": 1.0, "remanence_knee": 0.6},
        partial(stopped, 0.0, 0.0, 0.6), 2e-3,
    ),
}  # fmt: skip


@pytest.mark.parametrize("form", EQUATIONS)
def test_a_form_is_its_equation(form: str) -> None:
    column, u, effect, expected, most = EQUATIONS[form]
    close(run(column, u, **effect), expected() if callable(expected) else expected, most)


def test_an_overshooting_current_may_be_slower_in_a_share() -> None:
    u, fast = 0.3 + 0.4 * STEP, {"driver_lag_tau": 0.02, "driver_lag_ratio": 0.3}
    alone = run("current", u, **fast)
    both = run("current", u, **fast, driver_lag_tau2=0.1, driver_lag_share=0.4)
    close(both, 0.6 * alone + 0.4 * (0.3 + led(alone - 0.3, [1], [0.1, 1])), 1e-3)


GAIN = {"driver_lag_tau": 0.01, "driver_lag_gain": 1.0}


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        *((GAIN | {f"driver_lag_{w}": 0.5}, f"driver_lag_gain with driver_lag_{w}") for w in ("ratio", "fall", "rate")),
        ({"driver_lag_gain": 1.0}, "driver_lag_gain without driver_lag_tau"),
        ({"driver_lag_tau": 1e-4, "driver_lag_gain": 99.0}, "as fast as 1e-06 s"),
        (
            {"driver_lag_tau": 0.01, "driver_lag_ratio": 0.5, "driver_lag_rate": 5.0},
            "driver_lag_ratio with driver_lag_rate",
        ),
        ({"command_delay_period": 1e-6}, "command_delay_period = 1e-06 s; allowed: 0, or from 1e-05"),
    ],
)
def test_forms_that_do_not_go_together(numbers: dict[str, float], said: str) -> None:
    refuses(lambda: run("current", STEP, **numbers), said)


@pytest.mark.parametrize(
    ("delay", "period", "phase"), [(0.0312, 0.0173, 0.4), (0.0, 0.05, 0.0), (0.004, 0.0031, 1.7)]
)
def test_a_controller_takes_the_command_at_its_ticks(delay: float, period: float, phase: float) -> None:
    def sent(t: np.ndarray) -> np.ndarray:
        return np.asarray(0.5 + 0.5 * np.sin(4 * np.pi * np.maximum(t, 0.0)))

    ticks = (np.floor((T - delay) / period - phase) + phase) * period
    since = T - delay - ticks
    between = (since > DT) & (since < period - DT)  # a step takes a sample
    clock = {"command_delay_d": delay, "command_delay_period": period, "command_delay_phase": phase}
    close(run("field", sent(T), **clock), only(between, sent(ticks)), 1e-4)
    assert between.mean() > 0.5


@pytest.mark.parametrize(
    ("start", "rise", "field"),
    [
        (1.0, 0.0, 1 - 0.5 * 0.4),
        (-1.0, 0.0, -(1 + 0.5 * 0.9)),
        # stops that are not met yet move with the current
        (0.0, 1.0, float(np.mean(np.minimum(0.5, 2 * np.arange(1, 7) / 7 * (1 - 0.5 * 0.4))))),
    ],
)
def test_a_magnetic_circuit_begins_on_its_bound(start: float, rise: float, field: float) -> None:
    bounds = {"remanence_stops": 1.0, "remanence_up": -0.4, "remanence_down": 0.9}
    found = run("field", 0.5, remanence_b=0.1, remanence_d=1.0, remanence_start=start, remanence_rise=rise, **bounds)
    np.testing.assert_allclose(found, 0.5 - 0.1 * field, atol=1e-12)


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
