"""State and parameters: copies, restores, files, threads, batches, and parameters changed on the way."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path

import mujoco
import mujoco.batch
import mujoco.rollout
import numpy as np
import pytest

from dampers import attributes
from excitation import Array
from mjcf_builders import (
    DYKE,
    Damper,
    Sensor,
    Track,
    attribute,
    chain,
    compiled,
    dashpot,
    document,
    set_attribute,
    slider,
    step_through,
)
from networks import random_network

EFFECTS = {
    "driver_lag_tau": 0.008, "driver_lag_tau2": 0.003, "remanence_b": 0.1, "heating_kappa": 0.01,
    "heating_capacity": 3.0, "seal_friction_coulomb": 20.0, "trapped_gas_d": 0.4,
}  # fmt: skip
MOUNT = {"mount_compliance_k": 5e4, "backlash_gap": 1e-4, "driver_lag_tau": 0.005}
STEPS, MANY = 400, 120  # of one run, and of each of many
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS
SPECS = [FULL, mujoco.mjtState.mjSTATE_INTEGRATION]


def rich() -> str:
    """All that keeps a past: a network with a delayed command, a mount, heat, bristles, noise, lags."""
    dampers = [
        Damper("narx", {"weights": "text:net", "command_delay_d": 0.0123, "driver_lag_tau": 0.01}, "net"),
        Damper("modified_bouc_wen", {**DYKE, **EFFECTS}, "mr", 'joint="j1"'),
        Damper("hyperbolic_tangent", {**attributes("zapateiro_foam_tanh"), **MOUNT}, "foam", 'joint="j2"'),
    ]
    reading = {"noise": 2.0, "seed": 11.0, "sensor_leakage_tau": 0.3, "sensor_lag_tau": 0.004}
    sensors = [Sensor(f"f_{damper.name}", damper.name, reading) for damper in dampers]
    sensors += [Sensor(f"i_{damper.name}", damper.name, {"signal": "current"}) for damper in dampers]
    extra = f"""<custom><text name="net" data="{random_network(2, (6,)).text()}"/></custom>
<keyframe><key name="bent" qpos="0.01 -0.004 0.003" qvel="0.1 0 0.2" ctrl="0.5 1 1.5"/></keyframe>"""
    bodies = chain([20.0, 10.0, 2.0], [2e4, 2e4, 1e4], [5.0, 5.0, 1.0])
    return document(bodies, dampers, sensors, extra=extra)


def controls(steps: int = STEPS, seed: int = 0) -> Array:
    levels = np.random.default_rng(seed).uniform(0.2, 1.6, (steps // 20 + 1, 3))
    return np.repeat(levels, 20, axis=0)[:steps]


def bent() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model, data = compiled(rich())
    mujoco.mj_resetDataKeyframe(model, data, 0)
    return model, data


def equal(one: Track, two: Track) -> None:
    """Bit for bit."""
    for name in ("x", "v", "sensors"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name), err_msg=name)


@pytest.fixture(scope="module")
def whole() -> Track:
    model, data = bent()
    return step_through(model, data, STEPS, controls())


def rest(track: Track, k: int) -> Track:
    return Track(track.x[k:], track.v[k:], track.sensors[k:])


@pytest.mark.parametrize("k", [1, 150])
def test_copies_and_states_put_back_go_on_alike(whole: Track, k: int) -> None:
    """Into the same data after it went elsewhere, and into data that never stepped."""
    model, data = bent()
    step_through(model, data, k, controls()[:k])
    twin, other = copy.copy(data), mujoco.MjData(model)
    mujoco.mj_copyData(other, model, data)
    states = [np.empty(mujoco.mj_stateSize(model, spec)) for spec in SPECS]
    for spec, state in zip(SPECS, states, strict=True):
        mujoco.mj_getState(model, data, state, spec)
    step_through(model, data, 60, controls(seed=5))  # the original moves on first
    for following in (twin, other):
        equal(step_through(model, following, STEPS - k, controls()[k:]), rest(whole, k))
    for spec, state in zip(SPECS, states, strict=True):
        for following in (data, mujoco.MjData(model)):
            mujoco.mj_setState(model, following, state, spec)
            equal(step_through(model, following, STEPS - k, controls()[k:]), rest(whole, k))


def test_reset_and_keyframe(whole: Track) -> None:
    model, data = bent()
    step_through(model, data, 123, controls(seed=3))
    mujoco.mj_resetDataKeyframe(model, data, 0)
    equal(step_through(model, data, STEPS, controls()), whole)
    mujoco.mj_resetData(model, data)
    fresh = step_through(model, mujoco.MjData(model), 100, controls())
    equal(step_through(model, data, 100, controls()), fresh)


def test_the_engines_clock_may_be_set(whole: Track) -> None:
    model, data = bent()
    for k in range(STEPS):
        data.time = 0.0
        found = step_through(model, data, 1, controls()[k : k + 1])
        equal(found, Track(*(values[k : k + 1] for values in vars(whole).values())))


def test_looking_does_not_move_the_state(whole: Track) -> None:
    """mj_forward, mj_inverse, mj_step1 and a linearisation between the steps."""
    model, data = bent()
    before = data.plugin_state.copy()
    looks: tuple[Callable[[], None], ...] = (
        lambda: mujoco.mj_forward(model, data),
        lambda: mujoco.mj_step1(model, data),
        lambda: mujoco.mjd_transitionFD(
            model, data, 1e-6, True, np.zeros((6, 6)), np.zeros((6, 3)), None, None
        ),
    )
    for look in looks:
        for _ in range(3):
            look()
            np.testing.assert_array_equal(data.plugin_state, before)
    x, sensors = np.empty((60, 3)), np.empty((60, model.nsensordata))
    for k in range(60):
        data.ctrl[:] = controls()[k]
        x[k] = data.qpos
        looks[k % 3]()
        mujoco.mj_step(model, data)
        sensors[k] = data.sensordata
    np.testing.assert_array_equal(x, whole.x[:60])
    np.testing.assert_array_equal(sensors, whole.sensors[:60])


def test_two_halves_of_a_step_are_the_step(whole: Track) -> None:
    model, data = bent()
    for k in range(100):
        np.testing.assert_array_equal(data.qpos, whole.x[k])
        mujoco.mj_step1(model, data)
        data.ctrl[:] = controls()[k]
        mujoco.mj_step2(model, data)


def test_saved_models_move_alike(whole: Track, tmp_path: Path) -> None:
    xml, mjb = str(tmp_path / "model.xml"), str(tmp_path / "model.mjb")
    model, _ = compiled(rich())
    mujoco.mj_saveLastXML(xml, model)
    mujoco.mj_saveModel(model, mjb)
    for again in (
        mujoco.MjModel.from_xml_path(xml),
        mujoco.MjModel.from_binary_path(mjb),
        mujoco.MjModel.from_xml_string(mujoco.MjSpec.from_string(rich()).to_xml()),
    ):
        data = mujoco.MjData(again)
        mujoco.mj_resetDataKeyframe(again, data, 0)
        equal(step_through(again, data, STEPS, controls()), whole)


def starts(model: mujoco.MjModel, count: int) -> tuple[Array, Array]:
    """States (count, nstate) away from rest, the plugins' past among them, and controls (count, MANY, 3)."""
    states = np.empty((count, mujoco.mj_stateSize(model, FULL)))
    data = mujoco.MjData(model)
    for k in range(count):
        mujoco.mj_resetDataKeyframe(model, data, 0)
        step_through(model, data, 10 * k, controls(10 * k, seed=20 + k))
        mujoco.mj_getState(model, data, states[k], FULL)
    return states, np.array([controls(MANY, seed=40 + k) for k in range(count)])


def loop(models: list[mujoco.MjModel], states: Array, commands: Array) -> Array:
    sensors = []
    for model, state, command in zip(models, states, commands, strict=True):
        data = mujoco.MjData(model)
        mujoco.mj_setState(model, data, state, FULL)
        sensors.append(step_through(model, data, len(command), command).sensors)
    return np.array(sensors)


def stronger(model: mujoco.MjModel, factor: float) -> mujoco.MjModel:
    """A copy whose modified Bouc-Wen damper has another c0a, written into its attributes in place."""
    other = copy.copy(model)
    set_attribute(other, "mr_data", "c0a", factor * 2100.0)
    return other


def rollout(models: list[mujoco.MjModel], way: str, threads: int, states: Array, commands: Array) -> Array:
    datas = [mujoco.MjData(models[0]) for _ in range(threads)]
    return np.asarray(mujoco.rollout.rollout(models[0] if way == "one" else models, datas, states, commands)[1])


def batch(models: list[mujoco.MjModel], way: str, threads: int, states: Array, commands: Array) -> Array:
    model, many = models[0], len(models)
    made = mujoco.batch.Batch(model, nsim=many, nthread=threads)
    if way == "models":
        made.set_models(models)
    elif way == "plugin_attr":
        made.expand("plugin_attr")[:] = [m.plugin_attr for m in models]
    sensors, bound, data = np.empty((many, MANY, model.nsensordata)), made.bind("sensordata"), mujoco.MjData(model)
    for k in range(many):
        mujoco.mj_setState(model, data, states[k], FULL)
        mujoco.mj_getState(model, data, made.state[k], mujoco.mjtState.mjSTATE_INTEGRATION)
    for k in range(MANY):
        made.ctrl = commands[:, k]
        made.step()
        sensors[:, k] = bound
    return sensors


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    ("many", "way"), [(rollout, "one"), (rollout, "models"), (batch, "one"), (batch, "models"), (batch, "plugin_attr")]
)
def test_many_at_a_time_are_the_loop(many: Callable[..., Array], way: str, threads: int) -> None:
    model, _ = compiled(rich())
    states, commands = starts(model, 5)
    models = [model if way == "one" else stronger(model, 1.0 + k / 2) for k in range(5)]
    np.testing.assert_array_equal(many(models, way, threads, states, commands), loop(models, states, commands))


def force_at(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    mujoco.mj_resetData(model, data)
    data.qvel[0] = 0.1
    mujoco.mj_forward(model, data)
    return float(data.sensor("force").data[0])


RIG = document(slider(1e9), [Damper("bingham", dashpot(100.0))], [Sensor(attributes={"sensor_gain_g": 1.0})])


def test_attributes_written_into_the_model_count_at_once() -> None:
    """Of damper and sensor, in data that already ran; while it runs, from the next step on."""
    model, data = compiled(RIG)
    assert attribute(model, "mr_data", "c0a") == "100.0"
    assert force_at(model, data) == pytest.approx(10.0, rel=1e-12)
    set_attribute(model, "mr_data", "c0a", 700.0)
    assert force_at(model, data) == pytest.approx(70.0, rel=1e-12)
    sensor = int(model.sensor_plugin[model.sensor("force").id])
    raw = bytes(model.plugin_attr.view(np.uint8))
    at = raw.index(b"1.0\0", int(model.plugin_attradr[sensor]))
    model.plugin_attr[at : at + 3] = np.frombuffer(b"0.5", dtype=model.plugin_attr.dtype)
    assert force_at(model, data) == pytest.approx(35.0, rel=1e-12)
    mujoco.mj_step(model, data)
    set_attribute(model, "mr_data", "c0a", 300.0)
    mujoco.mj_step(model, data)
    assert data.sensor("force").data[0] == pytest.approx(15.0, rel=1e-6)


def test_a_model_changed_on_the_way_acts_as_on_new_data() -> None:
    """Each change alters what a force brings about within a step: inertia, damping, gear, step, limits."""
    model, data = compiled(rich())

    changes: tuple[tuple[object, str, object], ...] = (
        (model, "body_mass", 1.5 * model.body_mass),
        (model, "dof_armature", model.dof_armature + 3.0),
        (model, "dof_damping", 2.0 * model.dof_damping),
        (model, "actuator_gear", 1.2 * model.actuator_gear),
        (model.opt, "timestep", 0.5 * model.opt.timestep),
        (model.opt, "disableflags", mujoco.mjtDisableBit.mjDSBL_DAMPER),
    )
    for k, change in enumerate(changes):
        data.ctrl[:] = 1.0 + 0.1 * k
        data.qfrc_applied[:] = 40.0 * (-1) ** k
        mujoco.mj_step(model, data, 40)
        setattr(*change)
        new = mujoco.MjData(model)
        state = np.empty(mujoco.mj_stateSize(model, SPECS[1]))
        mujoco.mj_getState(model, data, state, SPECS[1])
        mujoco.mj_setState(model, new, state, SPECS[1])
        for each in (data, new):
            mujoco.mj_step(model, each, 5)
        np.testing.assert_array_equal(data.qvel, new.qvel, err_msg=str(k))
        assert np.abs(data.actuator_force).max() > 0
