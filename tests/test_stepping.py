"""The written MJCF, stepped by MuJoCo, gives what the C entry predicts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from dampers import off
from mrdamp import sets
from mrdamp.model import Effect, Model
from mrdamp.model.core import Array
from mrdamp.records import embedded
from mrdamp.simulation import stepping
from mrdamp.simulation.mjcf import mjcf
from mrdamp.structures import ShearFrame, dyke1996

LIMIT = 0.006  # of the RMS; most of it is the command, straight in a record, that the engine holds over its steps

SPENCER = {k: v for k, v in sets.load("dyke1996_3kN").parameters.items() if not k.startswith("command")}
TANH = {
    "k0a": 500.0, "k0b": 0.0, "k1a": 2e5, "k1b": 1e5, "c0a": 800.0, "c0b": 300.0, "c1a": 500.0, "c1b": 100.0,
    "m0": 0.5, "f0a": 60.0, "f0b": 500.0, "v_ref": 0.004,
}  # fmt: skip
LAWS = {"modified_bouc_wen": SPENCER, "hyperbolic_tangent": TANH}

EFFECTS = {
    "none": (),
    "driver, friction, mass": (
        Effect("driver_lag", {"tau": 0.01, "tau2": 0.003}),
        Effect("seal_friction", {"coulomb": 40.0, "breakaway": 1.5}),
        Effect("moving_mass", {"m": 3.0}),
    ),
    "delay, mount, gap, leak": (
        Effect("command_delay", {"d": 0.012}),
        Effect("mount_compliance", {"k": 2e6}),
        Effect("backlash", {"gap": 4e-4}),
        Effect("sensor_leakage", {"tau": 0.5}),
    ),
    "heat, gas, remanence, lag": (
        Effect("heating", {"kappa": 0.02, "kappa_yield": 0.01, "capacity": 50.0, "loss": 1.0}),
        Effect("trapped_gas", {"d": 0.4}),
        Effect("remanence", {"b": 0.1, "d": 0.2}),
        Effect("sensor_lag", {"tau": 0.004}),
    ),
    "a valve's plate, gas in series": (
        Effect("asymmetry", {"a": 0.2, "force": 300.0, "time": 0.02}),
        Effect("trapped_gas", {"force": 200.0, "s_g": 5e-4, "shape": 1.2, "width": 5e-3, "series": 1.0}),
    ),
    "gas in series behind a mount": (
        Effect("mount_compliance", {"k": 2e6}),
        Effect("trapped_gas", {"force": 200.0, "s_g": 5e-4, "shape": 1.2, "width": 5e-3, "series": 1.0}),
    ),
    "shift, saturation, gain": (
        Effect("channel_shift", {"d": 0.003}),
        Effect("saturation", {"i_s": 1.0, "shape": 1.0}),
        Effect("sensor_gain", {"g": 1.2}),
        Effect("sensor_offset", {"f": 30.0, "settle": 200.0, "time": 0.3}),
        Effect("gas_spring", {"k": 3000.0, "k2": 5.0, "f0": 50.0}),
    ),
}


@pytest.mark.parametrize("effects", EFFECTS)
@pytest.mark.parametrize("law", LAWS)
def test_the_rig_agrees_with_the_c_entry(law: str, effects: str) -> None:
    record = embedded()["random_random_current_2"].part(0.0, 4.0)
    inputs = {name: record.channel(name) for name in ("displacement_m", "command")}
    model = Model(law, LAWS[law], EFFECTS[effects])
    predicted = model.simulate(record.sample_time, inputs)
    stepped = stepping.drive_rig(model, record.sample_time, inputs)
    for name, values in predicted.items():
        assert off(stepped[name], values) < LIMIT, name


FRAME_EFFECTS = {
    "none": (),
    "structure": (
        Effect("storey_stiffness", {"e": -0.2}, 2),
        Effect("joint_friction", {"coulomb": 80.0}, 2),
        Effect("floor_mass", {"dm": 15.0}, 3),
        Effect("storey_damping", {"e": 2.0}, 1),
        Effect("joint_friction", {"coulomb": 60.0, "width": 0.003}, 3),
    ),
    "gas in series": (
        Effect("trapped_gas", {"force": 300.0, "s_g": 5e-4, "shape": 1.2, "width": 5e-3, "series": 1.0}),
    ),
    "driver and sensors": (
        Effect("driver_lag", {"tau": 0.01}),
        Effect("sensor_gain", {"g": 1.3}, 3),
        Effect("sensor_lag", {"tau": 0.005, "tau2": 0.003}, 1),
        Effect("sensor_leakage", {"tau": 0.5}, 2),
        Effect("sensor_offset", {"f": 0.1}, 2),
        Effect("channel_shift", {"d": 0.002}),
    ),
    "other forms": (
        Effect("storey_damping", {"e": 0.5, "quadratic": 2000.0}, 1),
        Effect("sensor_lag", {"tau": 0.006, "ratio": 0.6, "tau2": 0.004}, 1),
        Effect("sensor_leakage", {"tau": 0.2, "share": 0.4, "tau2": 1.0}, 2),
        Effect("sensor_offset", {"settle": 0.5, "time": 0.6}, 3),
        Effect("sensor_leakage", {"tau": 0.2, "share": 0.4}, 3),
    ),
}


def smooth_inputs() -> dict[str, Array]:
    t = 0.002 * np.arange(2000)
    ground = sum(
        a * np.sin(2 * np.pi * f * t + p) for a, f, p in ((1.5, 2.3, 0), (1.2, 5.2, 1), (0.5, 12, 2))
    )
    return {"ground_acceleration_m_s2": np.asarray(ground), "command": 1 + 0.9 * np.sin(2 * np.pi * 1.7 * t)}


FRAMES: dict[tuple[str, Any], ShearFrame] = {
    **{(effects, between): replace(dyke1996(), damper_between=between)
       for effects in FRAME_EFFECTS for between in ((0, 1), (2, 1))},
    **{("none", between): replace(dyke1996(), damper_between=between) for between in ((1, 2), (0, 3))},
    **{("none", n): ShearFrame(np.full(n, 90.0), np.full(n, 4e5), np.full(n, 80.0)) for n in (1, 2, 7)},
}  # fmt: skip


@pytest.mark.parametrize("key", FRAMES, ids=str)
def test_the_frame_agrees_with_the_c_entry(key: tuple[str, Any]) -> None:
    """By effects, and the floors of the damper or the number of storeys."""
    model = Model("modified_bouc_wen", SPENCER, FRAME_EFFECTS[key[0]], "frame", FRAMES[key])
    inputs = smooth_inputs()
    predicted = model.simulate(0.002, inputs)
    stepped = stepping.drive_frame(model, 0.002, inputs)
    for name, values in predicted.items():
        assert off(stepped[name], values) < LIMIT, name


def test_without_damper_there_is_none() -> None:
    model = Model(
        "modified_bouc_wen", SPENCER, (Effect("joint_friction", {"coulomb": 5.0}, 1),), "frame", dyke1996()
    )
    bare = mujoco.MjModel.from_xml_string(mjcf(model, damper=False))
    assert [bare.actuator(k).name for k in range(bare.nu)] == ["ground", "friction_1"]
