"""Forms of effects that bend their equation, against that equation written out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim, lti

from dampers import rms
from form_runs import BINGHAM, DT, STEP, T, X, run
from mjcf_builders import dashpot
from mrdamp.model import core


def test_gas_spring_has_a_cubic_part() -> None:
    k, k2, k3, f0 = 4000.0, 12.0, 3000.0, 20.0
    added = run("force", gas_spring_k=k, gas_spring_k2=k2, gas_spring_k3=k3, gas_spring_f0=f0) - run("force")
    np.testing.assert_allclose(added, k * X * (1 + k2 * X + k3 * X**2) + f0, atol=1e-6)


@pytest.mark.parametrize("shape", [1.0, 2.0, 6.0])
def test_force_comes_back_over_the_stroke_in_its_shape(shape: float) -> None:
    loss, length = 0.5, 0.004
    gas = {"trapped_gas_d": loss, "trapped_gas_s_g": length, "trapped_gas_shape": shape}
    # One stroke: from the turn at -10 mm (t = 1/2) to the one at 10 mm.
    stroke = (T > 0.52) & (T < 0.82)
    share = run("force", trapped_gas_direction=0.0, **gas)[stroke] / run("force")[stroke]
    s = X[stroke] + 0.01
    np.testing.assert_allclose(share, 1 - loss * np.exp(-((s / length) ** shape)), atol=0.01)


def test_extension_and_compression_differ_by_the_force() -> None:
    a, width = 0.2, 60.0
    plain, bent = run("force"), run("force", asymmetry_a=a, asymmetry_force=width)
    np.testing.assert_allclose(bent, plain * (1 + a * np.tanh(plain / width)), rtol=1e-9, atol=1e-9)


def test_extension_and_compression_differ_by_the_part() -> None:
    """The hyperbolic tangent's equation in SciPy, yield force and viscosity each with a share of its own."""
    law = {"c0a": 600.0, "c1a": 900.0, "k0a": 700.0, "k1a": 9e4, "f0a": 300.0, "m0": 1.5, "v_ref": 0.02}
    law |= {f"{name}b": 0.0 for name in ("c0", "c1", "k0", "k1", "f0")}
    shares = {"asymmetry_yield": -0.2, "asymmetry_viscous": 0.4, "asymmetry_width": 0.004}
    w = 3 * np.pi
    v = 0.01 * w * np.cos(w * T)

    def parts(t: float, g: float, rate: float) -> tuple[float, float]:
        side = np.tanh(0.01 * w * np.cos(w * t) / 0.004)
        flow = 600 * (1 + 0.4 * side) * rate + 300 * (1 - 0.2 * side) * np.tanh(rate / 0.02) + 700 * g
        force = 9e4 * (0.01 * np.sin(w * t) - g) + 900 * (0.01 * w * np.cos(w * t) - rate)
        return float(flow), float(force)

    def rates(t: float, y: np.ndarray) -> list[float]:
        flow, force = parts(t, y[0], y[1])
        return [y[1], (force - flow) / 1.5]

    y = solve_ivp(rates, (0, T[-1]), [0.0, 0.0], "LSODA", t_eval=T, rtol=1e-8, atol=1e-10).y
    expected = np.array([parts(*row)[1] for row in zip(T, *y, strict=True)])
    late = (T > 0.05) & (T < 0.99)

    def error(**effect: float) -> float:
        force = core.run("hyperbolic_tangent", law | effect, DT, X, v, substep=1e-4)["force"]
        return rms(force[late] - expected[late]) / rms(expected[late])

    assert error(**shares) < 0.005
    assert error() > 0.1
    assert error(**shares | {"asymmetry_viscous": 0.0}) > 0.02


def test_a_plate_takes_its_stroke_from_stop_to_stop() -> None:
    a, travel = -0.2, 0.006
    plate = [0.0]
    for step in np.diff(X):
        plate.append(float(np.clip(plate[-1] + 2 * step / travel, -1, 1)))
    plain, bent = run("force"), run("force", asymmetry_a=a, asymmetry_travel=travel, asymmetry_force=50.0)
    np.testing.assert_allclose(bent[5:-5], (plain * (1 + a * np.array(plate)))[5:-5], atol=0.5)


@pytest.mark.parametrize(
    "mover", [{"asymmetry_force": 60.0}, {"asymmetry_width": 0.02}], ids=["force", "velocity"]
)
def test_a_plate_moves_in_its_own_time(mover: dict[str, float]) -> None:
    """The plate's equation in SciPy, moved by the law's own force or by the velocity."""
    a, time = -0.25, 0.03
    plain = run("force")
    driven = plain / 60.0 if "asymmetry_force" in mover else np.gradient(X, DT) / 0.02
    plate = lsim(lti([1.0], [time, 1.0]), np.tanh(driven), T)[1]
    expected = (plain * (1 + a * plate))[100:-5]
    bent = run("force", asymmetry_a=a, asymmetry_time=time, **mover)[100:-5]
    at_once = run("force", asymmetry_a=a, **mover)[100:-5]
    assert rms(bent - expected) < 0.003 * rms(expected)
    assert rms(at_once - expected) > 0.05 * rms(expected)
    again = run("force", asymmetry_a=a, asymmetry_time=1.1 * time, **mover)[100:-5]
    assert rms(again - expected) > 0.006 * rms(expected)


@pytest.mark.parametrize(("m", "shape"), [(0.4, 0.6), (0.0, 1.0), (0.3, 5.0), (0.3, 2.0)])
def test_viscosity_falls_by_its_exponent(m: float, shape: float) -> None:
    v_s = 0.03
    force = run("force", shear_thinning_m=m, shear_thinning_v_s=v_s, shear_thinning_shape=shape)
    v = 0.01 * 2 * np.pi * 1.5 * np.cos(2 * np.pi * 1.5 * T)[5:-5]
    lost = (force - run("force"))[5:-5]

    def expected(a: float) -> np.ndarray:
        return 950.0 * v * ((1 + np.abs(v / v_s) ** a) ** ((m - 1) / a) - 1)

    np.testing.assert_allclose(lost, expected(shape), atol=0.02)
    assert np.abs(expected(1.1 * shape) - lost).max() > 0.2  # another exponent would be seen


def test_seal_slips_at_once_over_a_small_velocity() -> None:
    coulomb, breakaway, v_s, width = 40.0, 1.5, 0.02, 0.004
    seal = {"seal_friction_coulomb": coulomb, "seal_friction_breakaway": breakaway, "seal_friction_v_s": v_s}
    added = run("force", seal_friction_width=width, **seal) - run("force")
    v = 0.01 * 2 * np.pi * 1.5 * np.cos(2 * np.pi * 1.5 * T)
    limit = coulomb * (1 + (breakaway - 1) * np.exp(-((v / v_s) ** 2)))
    np.testing.assert_allclose(added[5:-5], (limit * np.tanh(v / width))[5:-5], atol=0.5)


@pytest.mark.parametrize(
    ("delay", "spread", "range_"), [(0.02, 0.3, (0.014, 0.026)), (0.02, 1.0, (0.0, 0.04))]
)
def test_packets_have_delays_of_their_own(delay: float, spread: float, range_: tuple[float, float]) -> None:
    """What arrives is the mean over all delays in the range; none is below zero."""
    law = {"c0a": 700.0, "c0b": 800.0, "fya": 70.0, "fyb": 620.0, "v_ref": 0.03}
    u = (np.sin(7 * T) > 0) * 1.0

    def current(**other: float) -> np.ndarray:
        run = core.run("bingham", law | {"command_delay_d": delay} | other, DT, X, u=u, columns=("current",))
        return np.asarray(run["current"])

    expected = np.mean([np.interp(T - d, T, u) for d in np.linspace(*range_, 2001)], axis=0)
    assert current(command_delay_spread=spread) == pytest.approx(expected, abs=2e-3)
    assert np.abs(current() - expected).max() > 0.3


def test_a_mass_beyond_the_mount_follows_the_rod() -> None:
    law = {"c0a": 3e3, "c0b": 0.0, "fya": 50.0, "fyb": 0.0, "v_ref": 0.01}
    mount = {"mount_compliance_k": 5e4, "backlash_gap": 5e-4}
    a = np.gradient(np.gradient(X, DT, edge_order=2), DT, edge_order=2)

    def force(**other: float) -> np.ndarray:
        run = core.run("bingham", law | mount | other, DT, X, u=0.0, a=a)
        return np.asarray(run["force"])

    beyond = force(moving_mass_m=20.0, moving_mass_beyond=1.0)
    assert beyond == pytest.approx(force() + 20.0 * a, abs=1e-9)
    assert rms(force(moving_mass_m=20.0) - beyond) > 0.05 * rms(beyond)  # the piston is another matter


def test_a_moving_mass_rings_on_its_own_spring() -> None:
    """Against SciPy: the load cell feels the mass's own acceleration, whatever the step."""
    mass, hz, ratio = 5.0, 12.0, 0.1
    w = 2 * np.pi * hz
    system = lti([2 * ratio * w, w**2], [1, 2 * ratio * w, w**2])  # y'' over x''
    rod = -0.01 * (2 * np.pi * 1.5) ** 2 * np.sin(2 * np.pi * 1.5 * T)
    felt = lsim(system, rod, T)[1]
    hung = {"moving_mass_m": mass, "moving_mass_hz": hz, "moving_mass_ratio": ratio}
    added = run("reference", **hung) - run("reference")
    np.testing.assert_allclose(added[20:], mass * felt[20:], atol=0.01 * mass * np.abs(rod).max())
    assert rms(added - mass * rod) > 0.02 * mass * rms(rod)  # a mass held rigidly is another force
    assert run("true", **hung) == pytest.approx(run("true"))  # the damper itself feels nothing of it
    parted = run("reference", **hung, moving_mass_share=0.3) - run("reference")
    both = mass * (0.3 * felt + 0.7 * rod)
    np.testing.assert_allclose(parted[20:], both[20:], atol=0.01 * mass * np.abs(rod).max())
    other = lsim(lti([2 * ratio * 2 * w, 4 * w**2], [1, 2 * ratio * 2 * w, 4 * w**2]), rod, T)[1]
    clamps = run("reference", **hung, moving_mass_hz2=2 * hz, moving_mass_share2=0.4) - run("reference")
    expected = mass * (0.6 * felt + 0.4 * other)
    np.testing.assert_allclose(clamps[20:], expected[20:], atol=0.01 * mass * np.abs(rod).max())


def test_a_share_of_the_charge_leaks_by_itself() -> None:
    share, fast, slow = 0.3, 0.2, 2.0

    def behind(**tau: float) -> np.ndarray:
        return run("force", **{f"sensor_leakage_{k}": v for k, v in tau.items()})

    expected = (1 - share) * behind(tau=fast) + share * behind(tau=slow)
    np.testing.assert_allclose(behind(tau=fast, share=share, tau2=slow), expected, atol=1e-8)
    expected = (1 - share) * behind(tau=fast) + share * run("force")
    np.testing.assert_allclose(behind(tau=fast, share=share), expected, atol=1e-8)


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


def test_a_pocket_loses_by_the_velocity() -> None:
    loss, reach, length, width = 0.6, 0.008, 0.003, 0.02
    gas = {"trapped_gas_d": loss, "trapped_gas_reach": reach, "trapped_gas_s_g": length, "trapped_gas_shape": 1.5}
    v = 0.03 * np.pi * np.cos(3 * np.pi * T)
    plain, with_gas = run("force"), run("force", trapped_gas_width=width, **gas)
    pocket = [0.0]
    for step in np.diff(X):
        pocket.append(min(max(pocket[-1] + step, 0.0), reach))
    expected = 1 - loss * np.tanh(np.maximum(v, 0) / width) * np.exp(-((np.array(pocket) / length) ** 1.5))
    np.testing.assert_allclose((plain * expected)[5:-5], with_gas[5:-5], atol=0.005 * plain.max())
    assert expected.min() < 0.5


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_pocket_opens_in_its_own_time(side: float) -> None:
    """Against SciPy, by the share of the pocket that is open: pressed shut by the stroke, back by its time constant."""
    loss, length, width, time = 0.6, 0.016, 0.02, 0.3
    gas = {"trapped_gas_d": loss, "trapped_gas_s_g": length, "trapped_gas_time": time, "trapped_gas_end": 1.0,
           "trapped_gas_shape": 1.0, "trapped_gas_width": width, "trapped_gas_direction": side}  # fmt: skip
    v = 0.03 * np.pi * np.cos(3 * np.pi * T)

    def rate(t: float, share: np.ndarray) -> np.ndarray:
        speed = side * 0.03 * np.pi * np.cos(3 * np.pi * t)
        return np.where(speed > 0, -speed / length * (share > 0), (1 - share) / time)

    share = solve_ivp(rate, (0, T[-1]), [1.0], t_eval=T, max_step=1e-3, rtol=1e-6).y[0]
    expected = 1 - loss * np.tanh(np.maximum(side * v, 0) / width) * np.maximum(share, 0)
    plain = core.run("bingham", BINGHAM, DT, X, v, u=0.5)["force"]
    force = core.run("bingham", BINGHAM | gas, DT, X, v, u=0.5)["force"]
    np.testing.assert_allclose(force[5:-5], (plain * expected)[5:-5], atol=0.005 * plain.max())
    assert share[T > 0.4].min() < 0.1
    assert share[T > 0.4].max() < 0.9  # it does not open whole in half a period


def test_gas_carries_its_pressure_until_it_is_pressed_together() -> None:
    limit, length, exponent = 60.0, 0.008, 1.3
    gas = {"trapped_gas_force": limit, "trapped_gas_s_g": length, "trapped_gas_shape": exponent}
    plain, with_gas = run("force"), run("force", **gas)
    pocket = [0.0]
    for step in np.diff(X):
        pocket.append(min(max(pocket[-1] + step, 0.0), length))
    room = 1 - np.array(pocket) / length
    carried = np.where(room > 0, limit / np.maximum(room, 1e-12) ** exponent, np.inf)
    expected = np.where(plain > 0, (np.maximum(plain, 1e-9) ** -4 + carried**-4) ** -0.25, plain)
    np.testing.assert_allclose(with_gas[5:-5], expected[5:-5], atol=0.005 * plain.max())
    assert (with_gas - 0.3 * plain)[plain > 1].min() < 0  # it loses most of it


def test_a_late_reading_goes_on_beyond_the_record() -> None:
    """What a record's end does not show is taken to go on: standing still there, the last samples would be far off."""
    shift, v = 0.004, 0.03 * np.pi * np.cos(3 * np.pi * T)
    late = core.run("bingham", {**BINGHAM, "channel_shift_d": shift}, DT, X, v, u=0.5)["force"]
    there = 0.03 * np.pi * np.cos(3 * np.pi * (T + shift))
    expected = 950 * there + 250 * np.tanh(there / 0.004)
    np.testing.assert_allclose(late[-8:], expected[-8:], atol=0.02 * np.abs(expected).max())


# --- gas in series with the fluid: its differential equation in SciPy ---------------------------------

C = 4000.0  # N s/m, a dashpot
LAW = dashpot(C)
FORCE, LENGTH, EXPONENT, WIDTH = 60.0, 0.003, 1.3, 0.02
GAS = {"trapped_gas_series": 1.0, "trapped_gas_force": FORCE, "trapped_gas_s_g": LENGTH}
GAS |= {"trapped_gas_shape": EXPONENT, "trapped_gas_width": WIDTH}
OMEGA = 3 * np.pi
V = 0.01 * OMEGA * np.cos(OMEGA * T)


def gas(q: float) -> float:
    return float(FORCE * ((1 - min(q / LENGTH, 1 - 1e-9)) ** -EXPONENT - 1))


def simulated(step: float | None = None, **other: float) -> np.ndarray:
    return core.run("bingham", LAW | GAS | other, DT, X, V, substep=step)["force"]


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
        return core.run("bingham", settings, 1e-3, X[::2], V[::2], substep=step)["force"]

    for mount in ({}, {"mount_compliance_k": 5e5}):
        fine, coarse = run(2e-5, **mount), run(1e-3, **mount)
        assert rms(coarse - fine) < 0.02 * rms(fine)
