"""Effects put into records: each one is undone by its own equation, written out anew here, and none adds noise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mrdamp.diagnosis.injection.forms import FORMS
from mrdamp.diagnosis.injection.inject import NOT_EXACT, Injection, NotPut, change_of, refusal, strength_of
from mrdamp.diagnosis.injection.signals import Scales, Signals
from mrdamp.model import Model, damper_effects
from mrdamp.model.core import Array
from mrdamp.records import Record, embedded

DT, AMPLITUDE, HZ, PRELOAD = 0.002, 8e-3, 1.5, 25.0
OMEGA = 2 * math.pi * HZ
BINGHAM = Model("bingham", {"c0a": 400.0, "c0b": 250.0, "fya": 40.0, "fyb": 300.0, "v_ref": 0.01})


def record(command: Array | float = 1.0, noise: float = 0.0) -> Record:
    """Six seconds of a sine under a Bingham damper with a preload."""
    t = DT * np.arange(3000)
    u = np.broadcast_to(np.asarray(command, dtype=float), t.shape)
    v = AMPLITUDE * OMEGA * np.cos(OMEGA * t)
    rng = np.random.default_rng(3)
    x = AMPLITUDE * np.sin(OMEGA * t) + noise * 2e-6 * rng.standard_normal(len(t))
    force = (400 + 250 * u) * v + (40 + 300 * u) * np.tanh(v / 0.01) + PRELOAD
    force = force + noise * 2.0 * rng.standard_normal(len(t))
    return Record("sine", None, DT, {"displacement_m": x, "command": u, "force_N": force})


def wandering() -> Array:
    """A command that varies slowly and keeps from its ends."""
    t = DT * np.arange(3000)
    return np.asarray(1.0 + 0.5 * np.sin(2 * math.pi * 0.7 * t) + 0.3 * np.sin(2 * math.pi * 1.9 * t))


def put(effect: str, parameters: dict[str, float], r: Record) -> Record:
    return FORMS[effect].put(Signals(r), parameters, Scales.of([r], BINGHAM))


def test_every_effect_of_a_damper_can_be_put_in_or_says_why_not() -> None:
    assert {*FORMS, *NOT_EXACT} <= set(damper_effects())


@pytest.mark.parametrize("effect", list(FORMS))
def test_an_effect_leaves_a_whole_record_and_grows_with_its_strength(effect: str) -> None:
    r = record(wandering(), noise=1.0)
    assert refusal(effect, BINGHAM, [r]) == ""
    injection = Injection.draw(effect, BINGHAM, [r], np.random.default_rng(1))
    change = change_of(BINGHAM, [r])
    sizes = [change(injection, s) for s in (0.02, 0.06, 0.18)]
    assert 0 < sizes[0] < sizes[1] < sizes[2]
    weak = injection.put(r, 1e-6)
    assert np.abs(weak.channel("force_N") - r.channel("force_N")[: weak.n]).max() < 1.0


def test_a_moving_mass_is_its_mass_times_the_acceleration_without_noise() -> None:
    r = record(noise=1.0)
    added = put("moving_mass", {"m": 50.0}, r).channel("force_N") - r.channel("force_N")
    truth = -50 * AMPLITUDE * OMEGA**2 * np.sin(OMEGA * r.time)
    inside = slice(50, -50)
    # Second differences of that noise would be 2e-6 sqrt(6) / dt^2 * 50 kg = 61 N.
    assert np.std((added - truth)[inside]) < 0.15 * np.std(truth)


def test_a_seal_drags_against_the_motion_with_its_coulomb_force() -> None:
    r = record()
    fixed = {"presliding": 5e-5, "breakaway": 1.0, "stribeck": 5e-3}
    added = put("seal_friction", {"coulomb": 30.0, **fixed}, r).channel("force_N") - r.channel("force_N")
    v = np.cos(OMEGA * r.time)
    assert np.allclose(added[np.abs(v) > 0.5][100:], 30 * np.sign(v[np.abs(v) > 0.5][100:]), rtol=1e-3)
    assert np.abs(added).max() < 30 * (1 + 1e-9)


def test_a_gas_spring_has_its_stiffness_about_the_middle() -> None:
    r = record()
    parameters = {"f0": 100.0, "length": 0.05, "exponent": 1.3}
    added = put("gas_spring", parameters, r).channel("force_N") - r.channel("force_N")
    near = np.abs(r.displacement) < 1e-3
    slope = np.polyfit(r.displacement[near], added[near], 1)[0]
    assert slope == pytest.approx(100 * 1.3 / 0.05, rel=0.05)


def test_asymmetry_and_trapped_gas_leave_the_preload_alone() -> None:
    r = record()
    scales = replace(Scales.of([r], BINGHAM), preload=PRELOAD)
    fluid = r.channel("force_N") - PRELOAD
    made = FORMS["asymmetry"].put(Signals(r), {"a": 0.2, "width": 1e-6}, scales)
    v = np.cos(OMEGA * r.time)
    sure = np.abs(v) > 0.05
    assert np.allclose(
        ((made.channel("force_N") - PRELOAD) / fluid)[sure], 1 + 0.2 * np.sign(v[sure]), atol=1e-3
    )
    parameters = {"d": 0.5, "length": 3e-3, "direction": 1.0, "width": 1e-6}
    factor = (FORMS["trapped_gas"].put(Signals(r), parameters, scales).channel("force_N") - PRELOAD) / fluid
    assert np.allclose(factor[sure & (v < 0)], 1.0, atol=1e-3)  # one direction alone
    late = sure & (v > 0) & (r.displacement > 0.9 * AMPLITUDE) & (r.time > 1)
    early = sure & (v > 0) & (r.displacement < -0.995 * AMPLITUDE)
    assert late.any()
    assert early.any()
    assert factor[late].min() > 0.98
    assert factor[early].max() < 0.52


def test_the_piston_behind_a_mount_is_where_it_was() -> None:
    r = record(noise=1.0)
    k, hard = 2e5, 100.0
    read = put("mount_compliance", {"k": k, "hardening": hard}, r)
    stretch = hard / k * np.arcsinh(r.channel("force_N") / hard)
    piston = read.displacement - stretch  # with the noisy force: the stretch was of the smoothed one
    assert np.std(piston - r.displacement) < 2 * 2.0 / k
    assert np.array_equal(read.channel("force_N"), r.channel("force_N"))
    # The machine's reading is as smooth as before: fifth differences are noise alone.
    assert np.std(np.diff(read.displacement, 5)) < 1.2 * np.std(np.diff(r.displacement, 5))


def test_a_clearance_is_its_gap_wide() -> None:
    r = record()
    extra = put("backlash", {"gap": 1e-3, "contact": 1.0}, r).displacement - r.displacement
    force = r.channel("force_N")
    assert np.allclose(np.abs(extra[np.abs(force) > 50]), 0.5e-3, rtol=1e-2)
    assert np.all(np.sign(extra[np.abs(force) > 50]) == np.sign(force[np.abs(force) > 50]))


@pytest.mark.parametrize("delay", [0.0073, -0.0073])
def test_a_shifted_displacement_is_that_of_another_time(delay: float) -> None:
    r = record()
    late = put("channel_shift", {"d": delay}, r)
    assert np.allclose(late.displacement, AMPLITUDE * np.sin(OMEGA * (late.time - delay)), atol=1e-7)
    first = round((late.time[0] - r.time[0]) / DT)
    assert np.array_equal(late.channel("force_N"), r.channel("force_N")[first : first + late.n])


def test_measured_derivatives_of_another_motion_are_left_out() -> None:
    r = record().with_channels({"velocity_m_s": np.ones(3000)})
    assert "velocity_m_s" not in put("mount_compliance", {"k": 1e5, "hardening": 1e9}, r).channels
    assert "velocity_m_s" in put("sensor_gain", {"g": 2.0}, r).channels


def test_a_sensor_effect_leaves_the_load_cell_alone() -> None:
    r = record()
    r = r.with_channels({"reference_force_N": r.channel("force_N")})
    parameters = {"sensor_gain": {"g": 1.3}, "sensor_offset": {"f": 9.0}, "sensor_leakage": {"tau": 0.5}}
    for effect, values in {**parameters, "sensor_lag": {"tau": 0.01, "order": 2.0}}.items():
        made = put(effect, values, r)
        assert np.array_equal(made.channel("reference_force_N"), r.channel("reference_force_N")), effect
        assert not np.allclose(made.channel("force_N"), r.channel("force_N")), effect
    both = put("gas_spring", {"f0": 100.0, "length": 0.05, "exponent": 1.3}, r)
    assert np.array_equal(both.channel("reference_force_N"), both.channel("force_N"))


def test_filters_are_those_of_their_equations() -> None:
    r = record()
    force = r.channel("force_N")

    def rate(t: float) -> float:
        return float(np.interp(t, r.time[:-1] + DT / 2, np.diff(force) / DT))

    leaked = put("sensor_leakage", {"tau": 0.4}, r).channel("force_N")
    solution = solve_ivp(lambda t, q: rate(t) - q / 0.4, (0, 2), [force[0]], max_step=DT, rtol=1e-6)
    assert np.allclose(leaked[:1000], np.interp(r.time[:1000], solution.t, solution.y[0]), atol=3.0)
    # A Bessel filter's delay is tau for what is slow against it.
    t = r.time
    slow = r.with_channels({"force_N": np.sin(OMEGA * t)})
    for order in (1.0, 2.0, 3.0):
        late = put("sensor_lag", {"tau": 0.01, "order": order}, slow).channel("force_N")
        assert np.allclose(late[500:], np.sin(OMEGA * (t[500:] - 0.01)), atol=0.006), order


@pytest.mark.parametrize("froehlich", [0.0, 1.0])
def test_the_field_of_the_logged_command_is_the_current_that_flowed(froehlich: float) -> None:
    u = wandering()
    bend, span = 1.7, float(u.max())
    logged = put("saturation", {"span": span, "bend": bend, "froehlich": froehlich}, record(u)).command
    share = logged / span
    field = (
        (1 + bend) * share / (1 + bend * share) if froehlich else np.arctan(bend * share) / np.arctan(bend)
    )
    assert np.allclose(span * field, u, rtol=1e-9)
    assert np.all(logged <= span * (1 + 1e-9))


def test_the_lag_of_the_logged_command_is_the_current_that_flowed() -> None:
    u = wandering()
    r = record(u)
    logged = put("driver_lag", {"tau": 0.02}, r).command
    current = np.empty_like(u)
    current[0] = u[0]
    decay = math.exp(-DT / 0.02)
    for k in range(1, len(u)):  # exact for a command that runs straight between samples
        slope = (logged[k] - logged[k - 1]) / DT
        current[k] = logged[k] - 0.02 * slope + (current[k - 1] - logged[k - 1] + 0.02 * slope) * decay
    assert np.abs(current - u).max() < 2e-3


def test_the_delay_of_the_logged_command_is_what_was_sent() -> None:
    u = wandering()
    early = put("command_delay", {"d": 0.011}, record(u))
    back = np.interp(early.time - 0.011, early.time, early.command)
    assert np.allclose(back[10:], u[10 : early.n], atol=2e-4)


def test_remanence_makes_the_field_higher_on_the_way_down() -> None:
    u = wandering()
    r = record(u).with_channels({"current_A": u})
    made = put("remanence", {"width": 0.2, "reach": 0.1}, r)
    above = u - made.command  # field over the logged current
    assert above[np.gradient(u) < -1e-3].mean() > 0.08
    assert above[np.gradient(u) > 1e-3].mean() < -0.08
    assert np.array_equal(made.channel("current_A"), made.command)  # what is measured is the coil's current


STEPS = np.where(np.sin(2 * math.pi * 0.9 * DT * np.arange(3000)) > 0, 2.0, 0.0)
SLOW_STEPS = np.interp(
    DT * np.arange(3000), np.arange(0, 6.1, 0.5), [0, 0, 1, 1, 0.4, 0.4, 2, 2, 0.6, 0.6, 1.5, 1.5, 0]
)


@pytest.mark.parametrize(
    ("effect", "commands", "said"),
    [
        ("heating", [1.0], NOT_EXACT["heating"]),
        ("driver_lag", [0.0, 0.5, 1.0], "constant"),
        ("saturation", [0.0, 0.5, 1.0], ""),
        ("saturation", [0.0, 0.5], "2 levels"),
        ("driver_lag", [STEPS], "levels"),
        ("command_delay", [STEPS], ""),
        ("driver_lag", [SLOW_STEPS], ""),
        ("driver_lag", [np.round(2 * wandering()) / 2], "leave its range"),
    ],
)
def test_what_records_cannot_have(effect: str, commands: list[Array | float], said: str) -> None:
    found = refusal(effect, BINGHAM, [record(u) for u in commands])
    assert said in found if said else found == ""
    may_show_it = said in ("leave its range", NOT_EXACT["heating"])
    assert isinstance(found, NotPut) == may_show_it


def test_a_size_is_met_and_one_out_of_reach_is_none() -> None:
    records = list(embedded().train[:2])
    model = Model("bingham", BINGHAM.parameters)
    change = change_of(model, records)
    injection = Injection.draw("moving_mass", model, records, np.random.default_rng(0))
    strength = strength_of(lambda s: change(injection, s), 0.1)
    assert strength is not None
    assert change(injection, strength) == pytest.approx(0.1, rel=0.02)
    asymmetry = Injection.draw("asymmetry", model, records, np.random.default_rng(0))
    assert strength_of(lambda s: change(asymmetry, s), 0.95) is None  # F (1 + 0.8) is the end
