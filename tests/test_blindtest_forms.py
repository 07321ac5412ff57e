"""The reference rig's further forms of effects: closed forms and equations stepped by hand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from scipy.special import jn_zeros

from rig_paths import DASHPOT, NOTHING, YIELD, at, clock, held, moved, on_the_way, sensed, steady
from studies.blindtest import bench, rig
from studies.blindtest.bench import Truth
from studies.blindtest.excitation import GRID_HZ, Excitation
from studies.blindtest.rig import RATE_HZ, Array


# --- driver and magnetics ----------------------------------------------------------------------
def test_current_controller_has_little_voltage_to_spare() -> None:
    """i'' tau + i' (1 + K) + i K / T = K / T where the voltage suffices; where it does not, 1 - exp(-t / tau) of it."""
    t = clock(1.0)
    lag = {"lag_form": 4.0, "lag_tau": 0.04, "lag_tau2": 0.02, "lag_gain": 1.0, "lag_span": 50.0}
    step = np.where(t > 0, 1.0, 0.0)
    free = held({**DASHPOT, **lag}, t, step)["current"]
    # w0^2 = K / (T tau) = 1250, 2 z w0 = 2 / tau; zero at -1 / T: the step response of both.
    s = t[::2]
    w, d = np.sqrt(1250 - 25**2), 25.0
    expected = 1 - np.exp(-d * s) * (np.cos(w * s) + (d - 25.0) / w * np.sin(w * s))
    assert np.abs(free - expected).max() < 2e-3
    assert free.max() > 1.04
    assert np.sum(1 - free[1:]) / RATE_HZ == pytest.approx(0.02, rel=1e-2)  # T / K late
    short = held({**DASHPOT, **lag, "lag_gain": 4.0, "lag_span": 1.2}, t, step)["current"]
    assert short[at(0.01)] == pytest.approx(1.2 * (1 - np.exp(-0.25)), rel=5e-3)
    assert short.max() < 1.1  # it does not wind up
    assert short[-1] == pytest.approx(1.0, abs=1e-3)


def test_field_diffuses_into_the_core() -> None:
    """By the first four zeros of J0, as SciPy has them, behind the coil's own pole."""
    t = clock(0.2)
    lag = {"lag_form": 5.0, "lag_tau": 0.05, "lag_tau2": 0.008}
    current = held({**DASHPOT, **lag}, t, np.where(t > 0, 1.0, 0.0))["current"]
    s, zeros = t[::2], jn_zeros(0, 4)
    left, shares = np.zeros(len(s)), zeros**-2 / np.sum(zeros**-2)
    for share, tau in zip(shares, 0.05 * (zeros[0] / zeros) ** 2, strict=True):
        left += share * (tau * np.exp(-s / tau) - 0.008 * np.exp(-s / 0.008)) / (tau - 0.008)
    assert np.abs(current - (1 - left)).max() < 3e-3


def test_packets_are_under_way_for_a_time_of_their_own() -> None:
    t = clock(20.0)
    network = {"command.delay": 0.05, "command.jitter": 0.3, "command.beat": 0.02}
    late = t - bench.driven(Truth({}, network), t, np.random.default_rng(0))
    later = late[len(t) // 10 :]
    assert later.mean() == pytest.approx(0.05, rel=0.1)
    assert 0.034 < later.min() < 0.037
    assert later.max() <= 0.065 + 1e-9
    assert np.ptp(np.round(later[2 : round(0.01 * 2 * RATE_HZ)], 9)) < 0.03
    assert np.all(np.diff(t - late) >= -1e-12)


def there_and_back(numbers: Mapping[str, float]) -> tuple[Array, Array]:
    """Current and field: up from 0 to 1 and down again, each in 1 s."""
    t = clock(2.0)
    out = held({**YIELD, **numbers}, t, 1 - np.abs(1 - t))
    return out["current"], out["field"]


def test_loop_closes_at_the_tip() -> None:
    """A play of width w lags by w, and less by 1 / (1 + (i / 0.7)^4)."""
    w = 0.12
    _, b = there_and_back({"rem_form": 3.0, "rem_width": w, "rem_share": 0.9, "rem_span": 1.0})
    weights = np.exp(-0.3 * np.arange(6))
    mean = 0.9 * float(weights @ (w * np.arange(1, 7) / 6)) / float(weights.sum())
    for level in (0.3, 0.7):
        lag = mean / (1 + (level / 0.7) ** 4)
        assert b[at(level)] == pytest.approx(level - lag, abs=1e-3)
        assert b[at(2 - level)] == pytest.approx(level + lag, abs=1e-3)


def test_field_follows_by_the_share_that_comes_back() -> None:
    """b' = (1 - g) / w |i'| (i - b) + g i', by small steps."""
    width, share = 0.15, 0.3
    _, b = there_and_back({"rem_form": 4.0, "rem_width": width, "rem_share": share})
    step, i, field, found = 1e-5, 0.0, 0.0, {}
    for k in range(200_000):
        way = 1.0 if k < 100_000 else -1.0
        field += step * ((1 - share) / width * (i - field) + share * way)
        i += step * way
        found[k + 1] = field
    for seconds in (0.1, 0.8, 1.05, 1.5):
        assert b[at(seconds)] == pytest.approx(found[round(seconds / step)], abs=3e-4)
    assert b[at(1.5)] - b[at(0.5)] > 1.6 * width


# --- fluid ---------------------------------------------------------------------------------------
def test_second_plateau_of_viscosity() -> None:
    numbers = {**DASHPOT, "thin_form": 3.0, "thin_v": 0.05, "thin_m": 0.2, "thin_rest": 0.1}
    assert steady(numbers, 0.002)["force"][-1] == pytest.approx(2.0, rel=1e-3)
    share = 0.1 + 0.9 * (1 + 4.0**4) ** (-0.8 / 4)
    assert steady(numbers, -0.2)["force"][-1] == pytest.approx(-200 * share)


def test_crowded_particles() -> None:
    """Quemada: (rest (1 + r) / (rest + r))^2 of the viscosity, r the root of the speed; from 1 down to thin_rest."""
    numbers = {**DASHPOT, "thin_form": 4.0, "thin_v": 0.4, "thin_rest": 0.09}
    assert steady(numbers, 0.1)["force"][-1] == pytest.approx(100 * (0.3 * 1.5 / 0.8) ** 2, rel=1e-6)
    assert steady(numbers, -0.4)["force"][-1] == pytest.approx(-400 * (0.6 / 1.3) ** 2, rel=1e-6)
    assert steady(numbers, 4e-9)["force"][-1] == pytest.approx(4e-6, rel=2e-3)
    assert steady(numbers, 400.0)["force"][-1] == pytest.approx(4e5 * 0.09, rel=0.16)


def test_directions_differ_the_more_the_faster() -> None:
    shares = {"asym_form": 3.0, "asym_share": 0.2, "asym_v": 0.1}
    assert steady({**DASHPOT, **shares}, 0.3)["force"][-1] == pytest.approx(
        300 * (1 + 0.2 * 0.8125), rel=1e-3
    )
    assert steady({**DASHPOT, **shares}, -0.1)["force"][-1] == pytest.approx(
        -100 * (1 - 0.2 * 0.625), rel=1e-3
    )


def test_check_valve_takes_its_time() -> None:
    """The plate goes from stop to stop by exp(-t / T) after the force has turned."""
    numbers = {**YIELD, "asym_form": 4.0, "asym_share": 0.2, "asym_width": 1.0, "asym_time": 0.02}
    t = clock(0.4)
    v = np.where(t < 0.2, 0.1, -0.1)
    force = rig.run_damper(numbers, np.cumsum(v) / (2 * RATE_HZ), v, np.ones(len(t)))["force"]
    assert force[at(0.19)] == pytest.approx(120.0, rel=1e-3)
    assert force[at(0.22)] == pytest.approx(-100 * (1 + 0.2 * (2 * np.exp(-1) - 1)), rel=2e-3)
    assert force[-1] == pytest.approx(-80.0, rel=1e-3)


def test_gas_in_series_is_pressed_before_the_fluid_flows() -> None:
    """Pressed by d the gas holds p = f ((1 - d / l)^-1.3 - 1); it takes (1 - p / F) of the rod's way."""
    numbers = {**YIELD, "gas_form": 3.0, "gas_sign": 1.0, "gas_stroke": 0.004, "gas_force": 20.0}
    pressed, step = 0.0, 1e-7
    for _ in range(round(0.003 / step)):
        held_out = 20 * ((1 - pressed / 0.004) ** -1.3 - 1)
        pressed += step * (1 - held_out / 100)
    expected = 20 * ((1 - pressed / 0.004) ** -1.3 - 1)
    assert 0.4 < expected / 100 < 0.95
    assert on_the_way(numbers, 0.003) == pytest.approx((expected, -100.0), rel=0.02)
    assert on_the_way(numbers, 0.0095)[0] == pytest.approx(100.0, rel=0.02)
    # Going back the gas expands before the other chamber's fluid is alone.
    assert -95 < on_the_way(numbers, 0.0095)[1] < 0
    tiny = on_the_way({**numbers, "gas_stroke": 2e-5}, 0.0005)
    assert tiny == pytest.approx((100.0, -100.0), rel=0.02)


def test_play_before_the_fluid_takes_hold() -> None:
    """Empty for half of 4 mm, then softly: half of the loss is made up half way."""
    numbers = {
        **YIELD,
        "gas_form": 4.0,
        "gas_sign": 1.0,
        "gas_loss": 0.8,
        "gas_stroke": 0.004,
        "gas_free": 0.5,
    }
    assert on_the_way(numbers, 0.0015) == pytest.approx((20.0, -100.0), rel=0.05)
    assert on_the_way(numbers, 0.0025)[0] == pytest.approx(20 + 80 * 5 / 32, rel=0.03)
    assert on_the_way(numbers, 0.003)[0] == pytest.approx(60.0, rel=0.02)
    assert on_the_way(numbers, 0.005)[0] == pytest.approx(100.0, rel=0.02)
    assert on_the_way({**numbers, "gas_sign": -1.0}, 0.0085) == pytest.approx((100.0, -20.0), rel=0.05)


# --- mechanics and mount -----------------------------------------------------------------------------
def test_gas_on_both_sides() -> None:
    numbers = {**NOTHING, "spring_form": 3.0, "spring_f0": 50.0, "spring_length": 0.04, "spring_other": 0.6}
    force = [steady(numbers, speed)["force"] for speed in (0.1, -0.1)]
    assert force[0][0] == pytest.approx(20.0)
    assert force[0][-1] == pytest.approx(50 * (0.5**-1.2 - 0.6 * 1.5**-1.2))
    assert force[1][-1] == pytest.approx(50 * (1.5**-1.2 - 0.6 * 0.5**-1.2))


def test_progressive_spring() -> None:
    numbers = {**NOTHING, "spring_form": 4.0, "spring_f0": 5.0, "spring_k": 1000.0, "spring_end": 20.0}
    for length in (0.01, -0.01):
        force = steady({**numbers, "spring_length": length}, 0.1)["force"]
        assert force[0] == pytest.approx(5.0)
        part = 0.02 / length
        assert force[-1] == pytest.approx(5 + 20 + 20 * (np.exp(part) - 1 - part))


def test_seal_is_elastic_before_it_slides() -> None:
    """Over small cycles a bristle with a breakaway gives all work back."""
    t = clock(1.0)
    x = 8e-6 * np.sin(2 * np.pi * 5 * t)
    seal = {"seal_coulomb": 40.0, "seal_static": 1.3, "seal_v": 1.0, "seal_slide": 2e-5}
    force = moved({**NOTHING, **seal, "seal_form": 4.0}, t, x)["force"]
    assert np.abs(force - 40 / 2e-5 * x[::2]).max() < 0.02


def test_film_remembers_the_velocity() -> None:
    """After a jump of the speed the friction goes from one value of Stribeck's curve to the other in its own time."""
    seal = {"seal_form": 5.0, "seal_coulomb": 40.0, "seal_static": 1.5, "seal_v": 0.01, "seal_slide": 2e-5}
    t = clock(0.4)
    v = np.where(t < 0.2, 0.1, 0.004)
    numbers = {**NOTHING, **seal, "seal_time": 0.02}
    force = rig.run_damper(numbers, np.cumsum(v) / (2 * RATE_HZ), v, np.ones(len(t)))["force"]
    film = 0.004 + 0.096 * np.exp(-0.05 / 0.02)
    assert force[[at(0.19), at(0.25), -1]] == pytest.approx(
        [40, 40 * (1 + 0.5 * np.exp(-((film / 0.01) ** 2))), 40 * (1 + 0.5 * np.exp(-0.16))], rel=1e-3
    )


def shaken(hz: float, **numbers: float) -> Array:
    """A mass's share of the force under 1 mm of sine."""
    t = np.arange(2 * GRID_HZ + 1) / GRID_HZ
    test = Excitation("sine", 1e-3 * np.sin(2 * np.pi * hz * t), np.ones(len(t)))
    rod = {f"rod.{name}": value for name, value in numbers.items()}
    heavy, plain = (
        bench.damper_channels(Truth(DASHPOT, more), test, np.random.default_rng(0))["force_N"]
        for more in (rod, {})
    )
    return np.asarray(heavy - plain)[len(heavy) // 2 :]


def test_mass_behind_something_viscous_and_in_two_clamps() -> None:
    hz, w = 20.0, 2 * np.pi * 20.0
    rigid = float(np.abs(shaken(hz, mass=2.0)).max())
    viscous = shaken(hz, mass=2.0, mass_time=0.006)
    assert np.abs(viscous).max() / rigid == pytest.approx(1 / np.hypot(1, 0.006 * w), rel=0.01)
    clamps = shaken(hz, mass=2.0, mass_hz=40.0, mass_hz2=80.0, mass_share2=0.4)

    def sprung(own: float) -> complex:
        k = (2 * np.pi * own) ** 2
        return complex(k / (k - w**2 + 0.1j * w * np.sqrt(k)))

    assert np.abs(clamps).max() / rigid == pytest.approx(abs(0.6 * sprung(40) + 0.4 * sprung(80)), rel=0.01)


def test_mount_of_two_rates_and_one_that_relaxes() -> None:
    mount = {**DASHPOT, "mount_k": 1e5, "mount_c": 100.0, "mount_mass": 0.1}
    stop = steady({**mount, "mount_form": 5.0, "mount_scale": 1e-3, "mount_power": 3.0}, 0.2)
    # 100 N of 200 beyond the stop
    assert 0.04 - stop["piston"][-1] == pytest.approx(1e-3 + 100 / 3e5, rel=1e-2)
    # Under a constant force the spring alone bears it: when the second one has let go, and 3 times as stiff before.
    relaxes = {**mount, "mount_form": 6.0, "mount_loss": 2.0, "mount_c": 1.0}
    quick, slow = (
        steady({**relaxes, "mount_time": time}, 0.2, end=0.4)["piston"][-1] for time in (0.02, 1e3)
    )
    assert 0.08 - quick == pytest.approx(200 / 1e5, rel=1e-2)
    assert 0.08 - slow == pytest.approx(200 / 3e5, rel=1e-2)


# --- sensors -------------------------------------------------------------------------------------------
def test_amplifier_warms_up() -> None:
    late = at(2.0)
    read = sensed(np.full(late + 1, 100.0), gain=0.3, offset=7.0, settle=0.2, settle_time=2.0)
    assert read[0] == pytest.approx(100 + 0.8 * 37)
    assert read[late] == pytest.approx(100 + (1 - 0.2 * np.exp(-1)) * 37)


def test_charge_leaks_away_twice() -> None:
    """A step through two high-passes: (e^(-t/a) / a - e^(-t/b) / b) / (1/a - 1/b)."""
    t = np.arange(RATE_HZ) / RATE_HZ
    read = sensed(np.where(t > 0, 100.0, 0.0), leakage=0.2, leakage_again=4.0)
    a, b = 5.0, 1 / 0.8
    expected = 100 * (a * np.exp(-a * 0.5) - b * np.exp(-b * 0.5)) / (a - b)
    assert read[at(0.5)] == pytest.approx(expected, rel=1e-3)


def test_transducer_averages() -> None:
    t = np.arange(2 * GRID_HZ + 1) / GRID_HZ
    test = Excitation("sine", 0.005 * np.sin(2 * np.pi * 10 * t), t)
    read = bench.as_read(Truth({}, {"reading.average": 0.01}), test)[2 * RATE_HZ :]
    size = np.sin(np.pi * 0.2) / (np.pi * 0.2)  # 20 ms of 100
    expected = size * np.interp(test.time[2 * RATE_HZ :] - 0.01, t, test.motion)
    assert np.abs(read - expected).max() < 2e-3 * 0.005
