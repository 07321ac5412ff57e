"""Forms of effects that bend their equation, against that equation written out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim, lti, sawtooth, square

from dampers import rms
from form_runs import BINGHAM, DT, OMEGA, STEP, T, V, X, close, only, run, speed
from mjcf_builders import dashpot
from mrdamp.model import Effect, Model, core
from mrdamp.records import Record
from mrdamp.simulation.predict import free_run
from mrdamp.simulation.stepping import drive_rig

PLAIN = run("force")  # N, without an effect


def between_stops(path: np.ndarray, low: float, high: float) -> np.ndarray:
    """Where what a motion drags along is, from zero."""
    at = [0.0]
    for step in np.diff(path):
        at.append(min(max(at[-1] + step, low), high))
    return np.array(at)


def carried(room: np.ndarray) -> np.ndarray:
    """The smaller of the fluid's force and that of gas in so much of its room, in a fourth power."""
    gas = np.where(room > 0, 60 / np.maximum(room, 1e-12) ** 1.3, np.inf)
    return np.where(PLAIN > 0, (np.maximum(PLAIN, 1e-9) ** -4 + gas**-4) ** -0.25, PLAIN)


#: Attributes, the force (N) and the most that the chain's may be off by.
EQUATIONS: Mapping[str, tuple[Mapping[str, float], np.ndarray, float]] = {
    "gas_spring, cubic": (
        {"gas_spring_k": 4000.0, "gas_spring_k2": 12.0, "gas_spring_k3": 3000.0, "gas_spring_f0": 20.0},
        PLAIN + 4000 * X * (1 + 12 * X + 3000 * X**2) + 20, 1e-6,
    ),
    "asymmetry by the force": (
        {"asymmetry_a": 0.2, "asymmetry_force": 60.0}, PLAIN * (1 + 0.2 * np.tanh(PLAIN / 60)), 1e-6,
    ),
    "asymmetry of a plate from stop to stop": (
        {"asymmetry_a": -0.2, "asymmetry_travel": 0.006, "asymmetry_force": 50.0},
        PLAIN * (1 - 0.2 * between_stops(2 * X / 0.006, -1, 1)), 0.5,
    ),
    "seal_friction that slips at once over a small velocity": (
        {"seal_friction_coulomb": 40.0, "seal_friction_breakaway": 1.5, "seal_friction_v_s": 0.02,
         "seal_friction_width": 0.004},
        PLAIN + 40 * (1 + 0.5 * np.exp(-((V / 0.02) ** 2))) * np.tanh(V / 0.004), 0.5,
    ),
    "trapped_gas in a pocket, by the velocity": (
        {"trapped_gas_d": 0.6, "trapped_gas_reach": 0.008, "trapped_gas_s_g": 0.003, "trapped_gas_shape": 1.5,
         "trapped_gas_width": 0.02},
        PLAIN * (1 - 0.6 * np.tanh(np.maximum(V, 0) / 0.02) * np.exp(-((between_stops(X, 0, 0.008) / 0.003) ** 1.5))),
        1.5,
    ),
    "trapped_gas that carries its pressure until it is pressed together": (
        {"trapped_gas_force": 60.0, "trapped_gas_s_g": 0.008, "trapped_gas_shape": 1.3},
        carried(1 - between_stops(X, 0, 0.008) / 0.008), 1.5,
    ),
    # From the turn at -10 mm (t = 1/2) to the one at 10 mm.
    **{
        f"trapped_gas by the stroke, shape {shape}": (
            {"trapped_gas_d": 0.5, "trapped_gas_s_g": 0.004, "trapped_gas_shape": shape, "trapped_gas_direction": 0.0},
            only((T > 0.52) & (T < 0.82), PLAIN * (1 - 0.5 * np.exp(-((np.abs(X + 0.01) / 0.004) ** shape)))), 1.5,
        )
        for shape in (1.0, 2.0, 6.0)
    },
    **{
        f"shear_thinning, m {m}, shape {a}": (
            {"shear_thinning_m": m, "shear_thinning_v_s": 0.03, "shear_thinning_shape": a},
            PLAIN + 950 * V * ((1 + np.abs(V / 0.03) ** a) ** ((m - 1) / a) - 1), 0.02,
        )
        for m, a in ((0.4, 0.6), (0.0, 1.0), (0.3, 5.0), (0.3, 2.0))
    },
}  # fmt: skip


@pytest.mark.parametrize("form", EQUATIONS)
def test_a_form_is_its_equation(form: str) -> None:
    effect, expected, most = EQUATIONS[form]
    close(run("force", **effect), expected, most)


def test_extension_and_compression_differ_by_the_part() -> None:
    """The hyperbolic tangent's equation in SciPy, yield force and viscosity each with a share of its own."""
    law = {"c0a": 600.0, "c1a": 900.0, "k0a": 700.0, "k1a": 9e4, "f0a": 300.0, "m0": 1.5, "v_ref": 0.02}
    law |= {f"{name}b": 0.0 for name in ("c0", "c1", "k0", "k1", "f0")}
    shares = {"asymmetry_yield": -0.2, "asymmetry_viscous": 0.4, "asymmetry_width": 0.004}

    def parts(t: float, g: float, rate: float) -> tuple[float, float]:
        side = np.tanh(speed(t) / 0.004)
        flow = 600 * (1 + 0.4 * side) * rate + 300 * (1 - 0.2 * side) * np.tanh(rate / 0.02) + 700 * g
        force = 9e4 * (0.01 * np.sin(OMEGA * t) - g) + 900 * (speed(t) - rate)
        return float(flow), float(force)

    def rates(t: float, y: np.ndarray) -> list[float]:
        flow, force = parts(t, y[0], y[1])
        return [y[1], (force - flow) / 1.5]

    y = solve_ivp(rates, (0, T[-1]), [0.0, 0.0], "LSODA", t_eval=T, rtol=1e-8, atol=1e-10).y
    expected = np.array([parts(*row)[1] for row in zip(T, *y, strict=True)])[100:-20]
    force = core.run("hyperbolic_tangent", law | shares, DT, X, V, substep=1e-4)["force"][100:-20]
    assert rms(force - expected) < 0.005 * rms(expected)


@pytest.mark.parametrize(
    "mover", [{"asymmetry_force": 60.0}, {"asymmetry_width": 0.02}], ids=["force", "velocity"]
)
def test_a_plate_moves_in_its_own_time(mover: dict[str, float]) -> None:
    """The plate's equation in SciPy, moved by the law's own force or by the velocity."""
    driven = PLAIN / 60 if "asymmetry_force" in mover else V / 0.02
    plate = lsim(lti([1.0], [0.03, 1.0]), np.tanh(driven), T)[1]
    expected = (PLAIN * (1 - 0.25 * plate))[100:-5]
    bent = run("force", asymmetry_a=-0.25, asymmetry_time=0.03, **mover)[100:-5]
    assert rms(bent - expected) < 0.003 * rms(expected)


@pytest.mark.parametrize(("spread", "range_"), [(0.3, (0.014, 0.026)), (1.0, (0.0, 0.04))])
def test_packets_have_delays_of_their_own(spread: float, range_: tuple[float, float]) -> None:
    """What arrives is the mean over all delays in the range; none is below zero."""
    u = (np.sin(7 * T) > 0) * 1.0
    expected = np.mean([np.interp(T - d, T, u) for d in np.linspace(*range_, 2001)], axis=0)
    found = run("current", u, command_delay_d=0.02, command_delay_spread=spread)
    assert found == pytest.approx(expected, abs=2e-3)


def test_a_mass_beyond_the_mount_follows_the_rod() -> None:
    law = {**dashpot(3e3, 50.0), "mount_compliance_k": 5e4, "backlash_gap": 5e-4}
    a = -(OMEGA**2) * X

    def force(**other: float) -> np.ndarray:
        return core.run("bingham", law | other, DT, X, u=0.0, a=a)["force"]

    beyond = force(moving_mass_m=20.0, moving_mass_beyond=1.0)
    assert beyond == pytest.approx(force() + 20.0 * a, abs=1e-9)
    assert rms(force(moving_mass_m=20.0) - beyond) > 0.05 * rms(beyond)  # the piston is another matter


def test_a_moving_mass_rings_on_its_own_spring() -> None:
    """Against SciPy: the load cell feels the mass's own acceleration, whatever the step; the damper nothing of it."""
    mass, w, ratio = 5.0, 2 * np.pi * 12.0, 0.1
    rod = -(OMEGA**2) * X

    def swings(w: float) -> np.ndarray:
        return np.asarray(lsim(lti([2 * ratio * w, w**2], [1, 2 * ratio * w, w**2]), rod, T)[1])

    hung = {"moving_mass_m": mass, "moving_mass_hz": 12.0, "moving_mass_ratio": ratio}
    for more, felt in (
        ({}, swings(w)),
        ({"moving_mass_share": 0.3}, 0.3 * swings(w) + 0.7 * rod),
        ({"moving_mass_hz2": 24.0, "moving_mass_share2": 0.4}, 0.6 * swings(w) + 0.4 * swings(2 * w)),
    ):
        added = run("reference", **hung, **more) - run("reference")
        np.testing.assert_allclose(added[20:], mass * felt[20:], atol=0.01 * mass * np.abs(rod).max())
    assert run("true", **hung) == pytest.approx(run("true"))


def test_a_share_of_the_charge_leaks_by_itself() -> None:
    def behind(**tau: float) -> np.ndarray:
        return run("force", **{f"sensor_leakage_{k}": v for k, v in tau.items()})

    for tau2 in ({"tau2": 2.0}, {}):
        slow = behind(tau=2.0) if tau2 else PLAIN
        expected = 0.7 * behind(tau=0.2) + 0.3 * slow
        np.testing.assert_allclose(behind(tau=0.2, share=0.3, **tau2), expected, atol=1e-8)


@pytest.mark.parametrize("tau2", [0.0, 0.007])
@pytest.mark.parametrize("ratio", [0.35, 0.71, 0.95])
def test_a_filter_of_second_or_third_order_has_its_damping(ratio: float, tau2: float) -> None:
    tau = 0.012
    w = 2 * ratio / tau
    force = run("force", STEP)
    poles = np.polymul([1, tau * w**2, w**2], [tau2, 1] if tau2 else [1])
    expected = lsim(lti([w**2], poles), force - force[0], T)[1] + force[0]
    found = run("force", STEP, sensor_lag_tau=tau, sensor_lag_ratio=ratio, sensor_lag_tau2=tau2)
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(force).max())


def test_heat_flows_from_the_fluid_to_its_body() -> None:
    """Against SciPy: two bodies that the damper's own power warms, and a viscosity that falls as a hyperbola."""
    heat = {"heating_kappa": 0.4, "heating_shape": 1.0, "heating_capacity": 2.0, "heating_link": 6.0,
            "heating_body": 5.0, "heating_loss": 1.0}  # fmt: skip
    dt, t = 1e-3, np.arange(0.0, 4.0, 1e-3)
    x, v = 0.01 * np.sin(9 * t), 0.09 * np.cos(9 * t)
    out = core.run("bingham", BINGHAM | heat, dt, x, v, u=0.5, columns=("temperature", "true"))

    def force(time: float, rise: float) -> float:
        speed = 0.09 * np.cos(9 * time)
        return float(950 * speed / (1 + 0.4 * rise) + 250 * np.tanh(speed / 0.004))

    def rates(time: float, y: np.ndarray) -> list[float]:
        power, flow = abs(force(time, y[0]) * 0.09 * np.cos(9 * time)), 6 * (y[0] - y[1])
        return [(power - flow) / 2, (flow - y[1]) / 5]

    rise = solve_ivp(rates, (0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-8, max_step=0.01).y[0]
    np.testing.assert_allclose(out["temperature"], rise, atol=0.01 * rise.max())
    expected = np.array([force(*pair) for pair in zip(t, rise, strict=True)])
    np.testing.assert_allclose(out["true"][5:-5], expected[5:-5], atol=1.0)
    assert rise.max() > 2.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_pocket_opens_in_its_own_time(side: float) -> None:
    """Against SciPy, by the share of the pocket that is open: pressed shut by the stroke, back by its time constant."""
    loss, length, width, time = 0.6, 0.016, 0.02, 0.3
    gas = {"trapped_gas_d": loss, "trapped_gas_s_g": length, "trapped_gas_time": time, "trapped_gas_end": 1.0,
           "trapped_gas_shape": 1.0, "trapped_gas_width": width, "trapped_gas_direction": side}  # fmt: skip

    def rate(t: float, share: np.ndarray) -> np.ndarray:
        v = side * speed(t)
        return np.where(v > 0, -v / length * (share > 0), (1 - share) / time)

    share = solve_ivp(rate, (0, T[-1]), [1.0], t_eval=T, max_step=1e-3, rtol=1e-6).y[0]
    expected = PLAIN * (1 - loss * np.tanh(np.maximum(side * V, 0) / width) * np.maximum(share, 0))
    close(run("force", **gas), expected, 1.5)
    assert share[T > 0.4].min() < 0.1
    assert share[T > 0.4].max() < 0.9  # it does not open whole in half a period


def test_a_late_reading_goes_on_beyond_the_record() -> None:
    """What a record's end does not show is taken to go on: standing still there, the last samples would be far off."""
    shift = 0.004
    late = core.run("bingham", {**BINGHAM, "channel_shift_d": shift}, DT, X, V, u=0.5)["force"]
    there = 0.01 * OMEGA * np.cos(OMEGA * (T + shift))
    expected = 950 * there + 250 * np.tanh(there / 0.004)
    np.testing.assert_allclose(late[-8:], expected[-8:], atol=0.02 * np.abs(expected).max())


@pytest.mark.parametrize(("tau", "width"), [(0.008, 0.0), (0.0, 0.03), (0.005, 0.02)])
def test_a_filtered_displacement_is_taken_back(tau: float, width: float) -> None:
    """A sine through a low-pass and an average, by their transfer functions: the force is that of the sine itself, of
    its velocity, displacement and acceleration."""
    gain = np.sinc(OMEGA * width / (2 * np.pi)) / (1 + 1j * OMEGA * tau)
    read, read_speed = (0.01 * np.imag(factor * gain * np.exp(1j * OMEGA * T)) for factor in (1, 1j * OMEGA))
    lag = {"motion_lag_tau": tau, "motion_lag_width": width}
    whole, motion = {**BINGHAM, "gas_spring_k": 4e4, "moving_mass_m": 5.0}, (DT, read, read_speed)
    found, without = (core.run("bingham", {**whole, **more}, *motion, u=0.5)["force"] for more in (lag, {}))
    speed, place = 0.01 * OMEGA * np.cos(OMEGA * T), 0.01 * np.sin(OMEGA * T)
    expected = 950 * speed + 250 * np.tanh(speed / 0.004) + (4e4 - 5 * OMEGA**2) * place
    inner = slice(20, -20)
    assert rms((found - expected)[inner]) < 2e-3 * rms(expected)
    assert rms((without - expected)[inner]) > 10 * rms((found - expected)[inner])


@pytest.mark.parametrize("width", [0.05, 0.2, 0.5])
def test_a_triangle_that_an_average_has_rounded_gets_corners_back(width: float) -> None:
    """A part of a dashpot's error, the average made from the triangle's own integral."""
    fine = 5e-4 * np.arange(-4000, 24001)
    path = 0.01 * sawtooth(2 * np.pi * 0.7 * fine, 0.5)
    area = np.concatenate([[0], np.cumsum(0.5 * (path[1:] + path[:-1]))]) * 5e-4
    t = 0.005 * np.arange(2000)
    read = (np.interp(t + width / 2, fine, area) - np.interp(t - width / 2, fine, area)) / width
    v = 0.028 * square(2 * np.pi * 0.7 * t)
    lags: tuple[dict[str, float], ...] = {}, {"motion_lag_width": width}
    forces = (core.run("bingham", dashpot(C) | lag, 0.005, read)["force"] for lag in lags)
    without, found = (rms((force - C * v)[200:-200]) for force in forces)
    assert found < 0.75 * without


def test_noise_of_an_averaged_displacement_is_not_raised() -> None:
    """A dashpot whose displacement is averaged over 30 ms and logged with 1 um of noise, in MuJoCo: its force is that
    of the motion, but for the noise of a central difference, 0.35 mm/s."""
    t, width, w = 0.002 * np.arange(2000), 0.03, 2 * np.pi * 3
    noise = 1e-6 * np.random.default_rng(4).standard_normal(len(t))
    read = 0.01 * np.sinc(w * width / (2 * np.pi)) * np.sin(w * t) + noise
    model = Model("bingham", dashpot(C), (Effect("motion_lag", {"width": width}),))
    found = drive_rig(model, 0.002, {"displacement_m": read, "command": np.zeros(len(t))})["force_N"]
    assert rms((found - C * 0.01 * w * np.cos(w * t))[30:-30]) < 2.5 * C * 0.35e-3


def test_noise_of_a_filtered_displacement_is_not_differentiated() -> None:
    """The sine through a low-pass, read with 1 um of noise, whose rate times tau outweighs the motion."""
    tau, rng = 0.008, np.random.default_rng(0)
    read = 0.01 * np.imag(np.exp(1j * OMEGA * T) / (1 + 1j * OMEGA * tau)) + 1e-6 * rng.standard_normal(len(T))
    record = Record("sine", None, DT, {"displacement_m": read, "command": np.full(len(T), 0.5)})
    model = Model("bingham", BINGHAM, (Effect("motion_lag", {"tau": tau}),))
    expected = 950 * V + 250 * np.tanh(V / 0.004)
    inner = slice(20, -20)
    assert rms((free_run(model, record)["force_N"] - expected)[inner]) < 0.05 * rms(expected)


C = 4000.0  # N s/m, a dashpot
FORCE, LENGTH, EXPONENT, WIDTH = 60.0, 0.003, 1.3, 0.02
GAS = {"trapped_gas_series": 1.0, "trapped_gas_force": FORCE, "trapped_gas_s_g": LENGTH}
GAS |= {"trapped_gas_shape": EXPONENT, "trapped_gas_width": WIDTH}


def off(expected: np.ndarray, **other: float) -> float:
    force = core.run("bingham", dashpot(C) | GAS | other, DT, X, V)["force"]
    return rms(force - expected) / rms(expected)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_fluid_moves_less_while_gas_is_pressed(side: float) -> None:
    """q' = (v - F(q) / c) / w while the rod or the gas presses, v towards the pocket."""

    def gas(q: float) -> float:
        return float(FORCE * ((1 - min(q / LENGTH, 1 - 1e-9)) ** -EXPONENT - 1))

    def rate(t: float, y: np.ndarray) -> list[float]:
        v, q = side * speed(t), max(y[0], 0.0)
        share = 0.5 * (1 + np.tanh(v / WIDTH))
        return [(v - gas(q) / C) / share if q > 0 or v > 0 else 0.0]

    q = solve_ivp(rate, (0, T[-1]), [0.0], "Radau", t_eval=T, max_step=1e-3, rtol=1e-8, atol=1e-12).y[0]
    v = side * V
    expected = side * np.where((q > 1e-9) | (v > 0), [gas(max(k, 0.0)) for k in q], C * v)
    assert off(expected, trapped_gas_direction=side) < 0.01
    assert off(expected, trapped_gas_direction=side, trapped_gas_width=4 * WIDTH) > 0.012


@pytest.mark.parametrize("k", [0.0, 2e5])
def test_gas_on_both_sides_is_a_spring_ahead_of_the_fluid(k: float) -> None:
    """With a mount's spring too: (dq/dF + 1 / k) F' = v - F / c."""

    def rate(t: float, y: np.ndarray) -> list[float]:
        give = LENGTH / (EXPONENT * FORCE) * (1 + abs(y[0]) / FORCE) ** (-1 / EXPONENT - 1)
        return [(speed(t) - y[0] / C) / (give + (1 / k if k else 0.0))]

    y = solve_ivp(rate, (0, T[-1]), [0.0], "Radau", t_eval=T, rtol=1e-8, atol=1e-8).y[0]
    assert off(y, trapped_gas_direction=0.0, mount_compliance_k=k) < 0.005
