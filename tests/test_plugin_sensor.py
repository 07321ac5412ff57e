"""The force sensor: closed forms, noise, what it takes over; the command on its way into the damper; the arrow."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import mujoco
import numpy as np
import pytest
from scipy import stats

from dampers import rms
from excitation import Array
from mjcf_builders import (
    ALL_SIGNALS,
    BINGHAM,
    HEAVY,
    Damper,
    Sensor,
    Values,
    compiled,
    dashpot,
    document,
    drive,
    grid,
    oscillator,
    signals,
    slider,
    step_through,
)

C = 100.0  # N s/m: the force is C times the velocity of the rig
DASHPOT = dashpot(C)
DT = 1e-3  # s


def rig(damper: Damper, sensors: Sequence[Sensor] = signals()) -> str:
    return document(slider(HEAVY), [damper], sensors, timestep=DT)


def read(force: Array, sensor: Values, damper: Values | None = None) -> Array:
    """Reading (n,) of a sensor on a damper whose force (n,) is prescribed."""
    text = rig(Damper("bingham", {**DASHPOT, **(damper or {})}), [Sensor("f", "mr", sensor)])
    zero = np.zeros(len(force))
    return drive(text, zero, np.asarray(force / C), zero)["f"]


def close(found: Array, expected: Array, scale: float = 1.0) -> None:
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * scale)


T = grid(0.5, DT)
RAMP = 400.0 * T  # N
BEHIND: Values = {"sensor_gain_g": 0.8, "sensor_leakage_tau": 0.2, "sensor_lag_tau": 0.01}


@pytest.mark.parametrize(
    ("sensor", "expected"),
    [
        ({}, RAMP),
        ({"signal": "true_force", "sensor_gain_g": 2.0}, RAMP),
        ({"sensor_gain_g": -1.3, "sensor_offset_f": 7.0}, -1.3 * RAMP + 7.0),
        ({"sensor_leakage_tau": 0.1}, 400.0 * 0.1 * (1.0 - np.exp(-T / 0.1))),
        ({"sensor_lag_tau": 0.003}, 400.0 * (T - 0.003 * (1.0 - np.exp(-T / 0.003)))),
        ({"sensor_lag_tau2": 0.05}, 400.0 * (T - 0.05 * (1.0 - np.exp(-T / 0.05)))),
        (
            {"sensor_offset_f": 5.0, "sensor_offset_settle": -60.0, "sensor_offset_time": 0.1},
            RAMP + 5.0 - 60.0 * np.exp(-T / 0.1),
        ),
        # Eqs. (1) to (3) of the self-sensing paper
        ({"signal": "charge"}, -158.248 * RAMP),
        ({"signal": "charge", "sensitivity": 40.0}, 40.0 * RAMP),
        ({"signal": "charge", **BEHIND}, -158.248 * read(RAMP, BEHIND)),
    ],
)
def test_a_ramp_is_read_in_closed_form(sensor: Values, expected: Array) -> None:
    close(read(RAMP, sensor), expected, max(100.0, float(np.max(np.abs(expected)))))


def test_damper_carries_the_sensor_and_the_sensor_overrides() -> None:
    """`sensor_*` of the damper count for every sensor on it, unless the sensor has its own."""
    carried: Values = {**BEHIND, "sensor_offset_f": 4.0}
    close(read(RAMP, {}, carried), read(RAMP, carried), 100.0)
    own: Values = {"sensor_gain_g": 1.0, "sensor_leakage_tau": 0.0}
    close(read(RAMP, own, carried), read(RAMP, {**carried, **own}), 100.0)
    off: Values = {**own, "sensor_offset_f": 0.0, "sensor_lag_tau": 0.0}
    close(read(RAMP, off, carried), RAMP, 100.0)
    assert rms(read(RAMP, {}, carried) - RAMP) > 50.0


def test_range_and_resolution() -> None:
    force = 150.0 * np.sin(20.0 * T)
    close(read(force, {"range": 100.0}), np.clip(force, -100.0, 100.0), 100.0)
    step = 8.0
    found = read(force, {"resolution": step})
    close(found, step * np.round(found / step), 100.0)
    assert step / 2 * 0.9 < np.max(np.abs(found - force)) <= step / 2 + 1e-9
    both = read(force, {"resolution": step, "range": 103.0})
    assert 96.0 <= np.max(np.abs(both)) <= 103.0
    # gain and offset come before the converter, its steps behind them
    shifted = read(force, {"resolution": step, "sensor_offset_f": 3.0, "sensor_gain_g": 0.9})
    close(shifted, step * np.round((0.9 * force + 3.0) / step), 100.0)


# z' = 100 v (1 - z^2): z = tanh(100 x) from zero
HYSTERESIS = dict.fromkeys(("c0a", "c0b", "alpha_a", "alpha_b", "k0", "x0"), 0.0)
HYSTERESIS |= {"gamma": 50.0, "beta": 50.0, "A": 100.0, "n": 2.0}


def limited(force: float, more: str, joint: str) -> dict[str, float]:
    """Every signal of a dashpot at a held velocity, behind a limit of the engine's."""
    text = rig(Damper("bingham", DASHPOT, more=more)).replace('type="slide"', f'type="slide" {joint}')
    model, data = compiled(text)
    data.qvel[0] = force / C
    mujoco.mj_step(model, data)
    return {name: float(data.sensor(name).data[0]) for name in ALL_SIGNALS}


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("more", "joint"),
    [
        ('forcelimited="true" forcerange="-100 100"', ""),
        ("", 'actuatorfrclimited="true" actuatorfrcrange="-100 100"'),
        ('gear="2"', 'actuatorfrclimited="true" actuatorfrcrange="-200 200"'),
    ],
)
def test_a_limit_of_the_engine_is_what_acts(more: str, joint: str, sign: float) -> None:
    gear = 2.0 if "gear" in more else 1.0
    found = limited(sign * 630.0 / gear, more, joint)
    for name in ("force", "true_force", "applied_force"):
        assert found[name] == pytest.approx(sign * 100.0, rel=1e-12), name
    assert found["unlimited_force"] == pytest.approx(sign * 630.0, rel=1e-9)
    assert found["charge"] == pytest.approx(-158.248 * sign * 100.0, rel=1e-12)
    assert found["power"] == pytest.approx(100.0 * 6.3, rel=1e-9)
    within = limited(sign * 60.0 / gear, more, joint)
    for name in ("force", "true_force", "applied_force", "unlimited_force"):
        assert within[name] == pytest.approx(sign * 60.0, rel=1e-6), name


@pytest.mark.parametrize(("integrator", "within"), [("Euler", 1e-9), ("implicitfast", 1e-9), ("RK4", 1e-4)])
def test_energy_is_what_the_body_lost(integrator: str, within: float) -> None:
    """A body of 3 kg braked by dashpot and yield force: kinetic energy by hand; the limit of the force counts."""
    values = {**DASHPOT, "fya": 20.0, "v_ref": 0.05}
    limit = 'forcelimited="true" forcerange="-150 150"'
    model, data = compiled(
        document(slider(3.0), [Damper("bingham", values, more=limit)], signals(), integrator=integrator)
    )
    data.qvel[0] = 2.0
    mujoco.mj_step(model, data, 61)
    v = float(data.qvel[0])
    mujoco.mj_forward(model, data)
    assert v < 1.0
    assert data.sensor("energy").data[0] == pytest.approx(1.5 * (4.0 - v**2), rel=within)
    assert data.sensor("power").data[0] == pytest.approx(v * data.sensor("true_force").data[0], rel=1e-12)


def test_a_group_that_is_off_leaves_the_state_in_motion() -> None:
    """The engine asks on: the hysteresis follows the motion and the force is there when the group is on again."""
    text = rig(Damper("bouc_wen", {**HYSTERESIS, "alpha_a": 100.0}, more='group="3"'))

    def force(off: bool) -> tuple[float, float]:
        model, data = compiled(text)
        data.qvel[0] = 0.1
        model.opt.disableactuator = 8 if off else 0
        mujoco.mj_step(model, data, 200)
        meanwhile = float(data.sensor("force").data[0])
        assert bool(data.actuator_force[0]) is not off
        model.opt.disableactuator = 0
        mujoco.mj_step(model, data)
        return meanwhile, float(data.sensor("force").data[0])

    asleep, awake = force(True)
    assert asleep == 0.0
    assert awake == pytest.approx(force(False)[1], rel=1e-6)
    assert awake == pytest.approx(100.0 * math.tanh(100.0 * 0.0200), rel=1e-3)


def test_without_actuation_a_damper_starts_anew() -> None:
    """The engine does not ask then: at rest where it stands, without current; stroke and velocity are read on."""
    model, data = compiled(rig(Damper("bouc_wen", {**HYSTERESIS, "alpha_b": 100.0, "driver_lag_tau": 0.05})))
    data.qvel[0], data.ctrl[0] = 0.1, 1.0
    mujoco.mj_step(model, data, 100)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    mujoco.mj_step(model, data, 100)
    assert data.sensor("stroke").data[0] == pytest.approx(0.1 * 0.199, rel=1e-6)
    for name in ("force", "power"):
        assert data.sensor(name).data[0] == 0.0
    assert data.actuator_force[0] == 0.0
    model.opt.disableflags = 0
    mujoco.mj_step(model, data, 31)
    rise = 1.0 - math.exp(-0.03 / 0.05)
    assert data.sensor("current").data[0] == pytest.approx(rise, rel=1e-6)
    assert data.sensor("true_force").data[0] == pytest.approx(
        100.0 * rise * math.tanh(100.0 * 0.003), rel=1e-3
    )


def test_a_force_that_jumps_is_read_after_the_jump() -> None:
    """With the command, through a lag of 5 ms: 1 - exp(-t / tau) of it, and nothing before."""
    text = rig(
        Damper("bingham", {**DASHPOT, "fyb": 400.0, "v_ref": 0.001}), [Sensor(attributes={"sensor_lag_tau": 0.005})]
    )
    steps = np.arange(60)
    found = drive(text, np.zeros(60), np.full(60, 0.1), np.where(steps >= 30, 1.0, 0.0))["force"]
    after = np.maximum(steps - 30, 0) * DT
    np.testing.assert_allclose(found, 10 + 400 * (1 - np.exp(-after / 0.005)), atol=0.01)


def noise(seed: int, count: int = 20_000, level: float = 2.5) -> Array:
    return read(np.full(count, 10.0), {"noise": level, "seed": float(seed)}) - 10.0


def test_noise_is_white_and_normal() -> None:
    n = noise(7)
    count = len(n)
    assert abs(float(np.mean(n))) < 4.0 * 2.5 / math.sqrt(count)
    assert float(np.std(n)) == pytest.approx(2.5, rel=4.0 / math.sqrt(2.0 * count))
    for lag in (1, 2, 3, 10):
        assert abs(float(np.corrcoef(n[:-lag], n[lag:])[0, 1])) < 4.0 / math.sqrt(count)
    assert stats.kstest(n / 2.5, "norm").pvalue > 1e-3
    assert float(np.max(np.abs(n))) > 3.0 * 2.5


def test_seeds_and_sensors_have_noise_of_their_own() -> None:
    first, again, other = noise(1, 2000), noise(1, 2000), noise(2, 2000)
    np.testing.assert_array_equal(first, again)
    np.testing.assert_allclose(noise(1, 2000, level=5.0), 2.0 * first, rtol=1e-9, atol=1e-9)
    two = [Sensor(name, "mr", {"noise": 2.5, "seed": 3.0}) for name in "ab"]
    zero = np.zeros(2000)
    found = drive(rig(Damper("bingham", DASHPOT), two), zero, zero, zero)
    for pair in ((first, other), (found["a"], found["b"])):
        assert abs(float(np.corrcoef(*pair)[0, 1])) < 0.1


W = 20.0  # rad/s


@pytest.mark.parametrize(
    ("setting", "gain"),
    [
        *(({"channel_shift_d": d}, np.exp(-1j * W * d)) for d in (0.004, -0.004)),
        ({"motion_lag_tau": 0.004}, 1 / (1 + 0.004j * W)),
        ({"motion_lag_width": 0.02}, np.sinc(W * 0.02 / (2 * np.pi))),
    ],
)
def test_the_channel_of_the_stroke_is_late_or_filtered(setting: Mapping[str, float], gain: complex) -> None:
    """By their transfer functions; the force is that of now."""
    model, data = oscillator("bingham", {**dashpot(1e-6), **setting}, 2.0, 2.0 * W**2, 2e-4)
    data.qpos[0] = 0.02
    stroke = step_through(model, data, 3000).sensors[:, model.sensor("stroke").adr[0]]
    assert rms(stroke - 0.02 * np.real(gain * np.exp(1j * W * 2e-4 * np.arange(3000)))) < 3e-3 * 0.02


def commanded(
    setting: Mapping[str, float], more: str, command: Callable[[float], float], seconds: float, signal: str = "current"
) -> Array:
    """Coil current, or another signal, before each 1 ms step under a command."""
    model, data = compiled(rig(Damper("bingham", {**BINGHAM, **setting}, more=more)))
    out = np.empty(round(seconds / 1e-3))
    for k in range(len(out)):
        data.ctrl[0] = command(k * 1e-3)
        mujoco.mj_step(model, data)
        out[k] = data.sensor(signal).data[0]
    return out


def step_at(time: float, low: float, high: float) -> Callable[[float], float]:
    return lambda t: high if t > time - 1e-9 else low


def test_engine_delay_of_the_actuator_acts() -> None:
    """MuJoCo's own `delay` with its history buffer, a step of the command after a while at rest."""
    found = commanded({}, 'delay="0.02" nsample="40"', step_at(0.1, 0.3, 1.1), 0.3)
    np.testing.assert_array_equal(found[30:119], 0.3)
    np.testing.assert_array_equal(found[121:], 1.1)


def test_commands_are_clamped() -> None:
    """By ctrlrange, by the parameters' own range, and by both; ctrlrange has its flag."""
    both = {"command_min": 0.6, "command_max": 1.5}
    cases: tuple[tuple[Mapping[str, float], str, float, float], ...] = (
        ({}, "", -3.0, 5.0),
        ({}, 'ctrllimited="true" ctrlrange="0 2"', 0.0, 2.0),
        (both, "", 0.6, 1.5),
        (both, 'ctrllimited="true" ctrlrange="0 1"', 0.6, 1.0),
        ({"command_max": 1.5}, "", -1.5, 1.5),
        ({"command_min": 0.6}, "", 0.6, 5.0),
    )
    for setting, more, low, high in cases:
        found = commanded(setting, more, step_at(0.01, -3.0, 5.0), 0.02)
        assert (found[5], found[15]) == (low, high), (setting, more)
    model, data = compiled(rig(Damper("bingham", BINGHAM, more='ctrllimited="true" ctrlrange="0 2"')))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    data.ctrl[0] = 5.0
    mujoco.mj_forward(model, data)
    assert data.sensor("current").data[0] == 5.0


@pytest.mark.parametrize(
    "effect",
    [{}, {"driver_lag_tau": 0.01}, {"saturation_i_s": 0.8}, {"remanence_b": 0.1, "remanence_d": 0.3}],
)
def test_the_sign_of_a_current_does_not_matter_to_the_fluid(effect: Mapping[str, float]) -> None:
    """(c0a + c0b |i|) v + (fya + fyb |i|) tanh(v / v_ref); with a least command the sign counts."""

    def force(u: float, more: Mapping[str, float]) -> float:
        model, data = compiled(rig(Damper("bingham", {**BINGHAM, **effect, **more})))
        data.qvel[0], data.ctrl[0] = 0.1, u
        mujoco.mj_step(model, data, 200)
        return float(data.sensor("true_force").data[0])

    assert force(-0.5, {}) == pytest.approx(force(0.5, {}), rel=1e-9)
    if not effect:
        assert force(-0.5, {}) == pytest.approx((150 + 40) * 0.1 + (40 + 30), rel=1e-6)
        assert force(-0.5, {"command_min": -1.0}) == pytest.approx((150 - 40) * 0.1 + (40 - 30), rel=1e-6)
        assert force(-0.5, {"command_min": 0.0}) == pytest.approx(150 * 0.1 + 40, rel=1e-6)


def test_a_current_that_changes_its_sign_passes_zero() -> None:
    """From 1 to -1 A behind a lag: |2 exp(-t / tau) - 1|."""
    found = commanded(
        {"driver_lag_tau": 0.02, "command_start": 1.0}, "", step_at(0.05, 1.0, -1.0), 0.2, "field"
    )
    since = np.maximum(np.arange(len(found)) * 1e-3 - 0.05, 0.0)
    np.testing.assert_allclose(found, np.abs(2.0 * np.exp(-since / 0.02) - 1.0), atol=1e-9)
