"""Forms of the effects between command and field against what they say, in closed form or by SciPy."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim, lti

from dampers import rms
from form_runs import DT, STEP, T, run
from refusals import refuses


def test_current_falls_at_its_own_rate() -> None:
    rise, fall = 0.02, 0.06
    current = run("current", STEP, driver_lag_tau=rise, driver_lag_fall=fall)
    up, down = (T > 0.21) & (T < 0.59), T > 0.61
    np.testing.assert_allclose(current[up], 1 - np.exp(-(T[up] - 0.2) / rise), atol=0.03)
    np.testing.assert_allclose(current[down], np.exp(-(T[down] - 0.6) / fall), atol=0.02)
    # The time constants themselves, by the logarithm's slope: a factor of two is far off.
    slope = np.polyfit(T[down][:100], np.log(current[down][:100]), 1)[0]
    assert -1 / slope == pytest.approx(fall, rel=0.01)


def test_current_rises_no_faster_than_its_rate() -> None:
    rate = 8.0  # A/s
    current = run("current", STEP, driver_lag_tau=0.002, driver_lag_rate=rate)
    slope = np.diff(current) / DT
    assert np.abs(slope).max() <= rate * (1 + 1e-9)
    ramp = (T > 0.22) & (T < 0.31)
    np.testing.assert_allclose(current[ramp], rate * (T[ramp] - 0.2), atol=0.02)


@pytest.mark.parametrize("ratio", [0.3, 0.7])
def test_a_controlled_current_overshoots(ratio: float) -> None:
    """Against SciPy, and the overshoot against its formula."""
    tau, u = 0.02, 0.3 + 0.4 * STEP
    w = 2 * ratio / tau
    expected = 0.3 + lsim(lti([w**2], [1, tau * w**2, w**2]), 0.4 * STEP, T, interp=False)[1]
    current = run("current", u, driver_lag_tau=tau, driver_lag_ratio=ratio)
    np.testing.assert_allclose(current, expected, atol=0.02)  # the command jumps within a sample
    overshoot = np.exp(-np.pi * ratio / np.sqrt(1 - ratio**2))
    assert current.max() == pytest.approx(0.7 + 0.4 * overshoot, abs=2e-3)
    slow = {"driver_lag_tau2": 0.1, "driver_lag_share": 0.4}
    both = run("current", u, driver_lag_tau=tau, driver_lag_ratio=ratio, **slow)
    behind = lsim(lti([1], [0.1, 1]), current - 0.3, T)[1] + 0.3
    np.testing.assert_allclose(both, 0.6 * current + 0.4 * behind, atol=1e-3)


def test_a_share_of_the_field_is_slower() -> None:
    """Against SciPy's transfer function: eddy currents hold back a share of the field, the rest follows the current."""
    tau, slow, share = 0.01, 0.15, 0.6
    u = np.sin(2 * np.pi * 3 * T) * T
    system = lti([(1 - share) * slow, 1], np.polymul([tau, 1], [slow, 1]))
    lag = {"driver_lag_tau": tau, "driver_lag_tau2": slow}
    field = run("field", u, driver_lag_share=share, **lag)
    np.testing.assert_allclose(field, lsim(system, u, T)[1], atol=1e-3)
    assert rms(field - run("field", u, **lag)) > 0.1 * rms(field)
    alone = run("field", u, driver_lag_tau2=slow, driver_lag_share=share)  # no first pole
    np.testing.assert_allclose(alone, (1 - share) * u + share * lsim(lti([1], [slow, 1]), u, T)[1], atol=1e-3)


@pytest.mark.parametrize(("tau", "gain", "integral"), [(0.1, 3.0, 0.1), (0.01, 2.5, 0.02)])
def test_a_coil_under_a_controller_of_limited_voltage(tau: float, gain: float, integral: float) -> None:
    """Against SciPy; the voltage is at its limit after the jump."""
    u, limit = 0.2 + 0.8 * STEP, 1.3

    def rates(t: float, y: np.ndarray) -> list[float]:
        error = float(np.interp(t, T, u)) - y[0]
        asked = gain * error + y[1]
        given = min(max(asked, -limit), limit)
        return [(given - y[0]) / tau, 0.0 if asked != given and asked * error > 0 else gain * error / integral]

    expected = solve_ivp(rates, (0, T[-1]), [0.2, 0.2], t_eval=T, max_step=1e-4, rtol=1e-7, atol=1e-9).y[0]
    numbers = {"driver_lag_tau": tau, "driver_lag_gain": gain, "driver_lag_integral": integral}
    current = run("current", u, **numbers, driver_lag_limit=limit)
    np.testing.assert_allclose(current, expected, atol=0.015)  # the command jumps within a sample
    assert rms(current - expected) < 2e-3
    assert np.abs(run("current", u, **numbers) - expected).max() > 0.05


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
    u = 0.5 + 0.5 * np.sin(2 * np.pi * 2 * T)
    clock = {"command_delay_d": delay, "command_delay_period": period, "command_delay_phase": phase}
    field = run("field", u, **clock)
    ticks = (np.floor((T - delay) / period - phase) + phase) * period
    taken = 0.5 + 0.5 * np.sin(2 * np.pi * 2 * np.maximum(ticks, 0.0))
    since = T - delay - ticks
    between = (since > DT) & (since < period - DT)  # a step takes a sample
    np.testing.assert_allclose(field[between], taken[between], atol=1e-4)
    assert between.mean() > 0.5
    assert len(np.unique(np.round(field[between], 7))) < 1.2 * (T[-1] + delay) / period + 2
    late = run("field", u, command_delay_d=delay + period / 2)
    assert np.abs(field - late).max() > 0.4 * period * 2 * np.pi  # half the period at the largest slope


def test_magnetic_circuit_remembers_how_it_got_to_the_start() -> None:
    b, d, start = 0.1, 0.2, -0.8
    level = run("field", 0.5, remanence_b=b, remanence_d=d, remanence_start=start)
    np.testing.assert_allclose(level, 0.5 - b * start)  # constant current: the branch stays
    ramp = 0.5 + 0.4 * T
    field = run("field", ramp, remanence_b=b, remanence_d=d, remanence_start=start)
    branch = 1 + (start - 1) * np.exp(-(ramp - 0.5) / d)
    np.testing.assert_allclose(field, ramp - b * branch, atol=2e-3)


def test_a_magnetic_circuit_may_have_risen_from_zero() -> None:
    """A test at a constant current begins on the way up from zero, further the larger the current is."""
    b, d = 0.1, 0.2
    for u in (0.0, 0.3, 1.0):
        field = run("field", u, remanence_b=b, remanence_d=d, remanence_rise=1.0)
        np.testing.assert_allclose(field, u - b * (1 - np.exp(-u / d)), atol=1e-12)


UP_AND_DOWN = np.interp(T, [0, 0.25, 0.4, 0.55, 0.7, 0.99], [-0.3, 1.0, 0.2, 0.6, 0.0, 0.9])  # A


def test_loops_of_a_magnetic_circuit_change_with_the_current() -> None:
    """Against SciPy: the equation with bounds that grow on the way down and shrink on the way up."""
    b, d, up, down = 0.1, 0.2, -0.5, 1.4

    def rate(t: float, h: np.ndarray) -> np.ndarray:
        i, after = (np.interp(t + late, T, UP_AND_DOWN) for late in (0.0, 1e-6))
        way = (after - i) / 1e-6
        bound = 1 + (up if way * i > 0 else down) * abs(i)
        return np.asarray((way / d) * (bound - np.sign(way) * h))

    expected = solve_ivp(rate, (0, T[-1]), [0.0], t_eval=T, rtol=1e-6, atol=1e-7, max_step=1e-3).y[0]
    level = {"remanence_up": up, "remanence_down": down}
    field = run("field", UP_AND_DOWN, remanence_b=b, remanence_d=d, **level)
    np.testing.assert_allclose(field, UP_AND_DOWN - b * expected, atol=1e-3)
    plain = run("field", UP_AND_DOWN, remanence_b=b, remanence_d=d)
    assert np.abs(field - plain).max() > 0.03


@pytest.mark.parametrize(("up", "down"), [(0.0, 0.0), (0.0, 1.8), (-0.5, -0.6), (-2.0, 0.5)])
def test_stops_of_a_magnetic_circuit_change_with_the_current(up: float, down: float) -> None:
    """Against stops of Prandtl and Ishlinskii written out: a current that comes back finds the field that it left.

    Their bounds follow the current and close where they would turn round.
    """
    b, d = 0.1, 0.1
    widths, stops, branch = d * 2 * np.arange(1, 7) / 7, np.zeros(6), [0.0]
    fine = np.interp(np.arange(0, T[-1] + 1e-9, DT / 10), T, UP_AND_DOWN)
    for was, i in pairwise(fine):
        above, below = (up, down) if i > 0 else (down, up)
        high, low = max(1 + above * abs(i), 0.0), max(1 + below * abs(i), 0.0)
        stops = np.clip(stops + i - was, -widths * low, widths * high)
        branch.append(float(np.mean(stops) / d))
    form = {"remanence_b": b, "remanence_d": d, "remanence_stops": 1.0}
    field = run("field", UP_AND_DOWN, **form, remanence_up=up, remanence_down=down)
    np.testing.assert_allclose(field, UP_AND_DOWN - b * np.array(branch)[::10], atol=2e-3)


def test_loops_of_a_magnetic_circuit_close_at_saturation() -> None:
    b, d, knee = 0.1, 0.2, 0.6
    loops = {"remanence_b": b, "remanence_d": d, "remanence_stops": 1.0}
    plain, closing = run("field", UP_AND_DOWN, **loops), run("field", UP_AND_DOWN, **loops, remanence_knee=knee)
    lag = UP_AND_DOWN - plain
    np.testing.assert_allclose(UP_AND_DOWN - closing, lag * np.exp(-((UP_AND_DOWN / knee) ** 2)), atol=1e-12)


def test_a_magnetic_circuit_begins_on_its_bound() -> None:
    b, up, down = 0.1, -0.4, 0.9
    for start, rise, bound in ((1.0, 0.0, 1 + 0.5 * up), (-1.0, 0.0, -(1 + 0.5 * down)), (0.0, 1.0, 0.5)):
        field = run("field", 0.5, remanence_b=b, remanence_d=1.0, remanence_start=start, remanence_rise=rise,
                    remanence_stops=1.0, remanence_up=up, remanence_down=down)  # fmt: skip
        if rise == 0:
            np.testing.assert_allclose(field, 0.5 - b * bound, atol=1e-12)
        else:  # stops that are not met yet move with the current
            limits = 2 * np.arange(1, 7) / 7 * (1 + 0.5 * up)
            np.testing.assert_allclose(field, 0.5 - b * np.mean(np.minimum(0.5, limits)), atol=1e-12)
