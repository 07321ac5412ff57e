"""The cable: frequencies, damping and sag against closed form, its two models against each other, its contract."""

from __future__ import annotations

import math
import tracemalloc
import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.signal import butter, lfilter

from mrdamp import models_xml
from mrdamp.envs import (
    AmbientLoads,
    CableEnv,
    CableLoad,
    CablePlant,
    CableTask,
    WindLoads,
    cable_damper,
)
from mrdamp.envs.cable_xml import chain_xml
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.structures.cables import StayCable


def dashpot(c: float) -> Model:
    return Model("bingham", {"c0a": c, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01})


def test_a_point_load_pushes_as_much_as_it_should() -> None:
    """Static: a uniform load's deflection is w L^2 / (8 T) at mid-span of a taut string."""
    cable = StayCable(ratio=0.2, modes=14)
    damping = Model("bingham", {"c0a": 50.0, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01})
    plant = CablePlant(cable, damping, (0.5,), command_max=1.0)
    y = plant.reset(CableLoad("even", 1.0, np.array([0.5]), np.full((12, 1), 2.0)))
    while not plant.finished:
        y = plant.step(0.0)
    assert y["displacement_1"] == pytest.approx(2.0 * 12.65**2 / (8 * 2172.0), rel=2e-3)


def test_without_force_the_motion_is_the_reference() -> None:
    env = CableEnv(model=dashpot(0.0), command_max=1.0, loads=AmbientLoads(duration=6.0))
    env.reset(seed=1)
    over, total = False, 0.0
    info: dict[str, Any] = {}
    while not over:
        _, reward, _, over, info = env.step(np.zeros(1, np.float32))
        total += reward
    assert info["motion_ratio"] == pytest.approx(1.0, abs=5e-3)
    assert total == pytest.approx(-100, rel=1e-2)
    assert info["dissipated_energy"] == 0.0


def test_the_shipped_chain_is_the_default_cable_with_sag() -> None:
    shipped = mujoco.MjModel.from_xml_path(str(models_xml.path("cable", "scene.xml")))
    made = mujoco.MjModel.from_xml_string(chain_xml(StayCable(sag=1.0), cable_damper()))
    for field in ("body_mass", "body_pos", "tendon_stiffness", "tendon_lengthspring", "dof_damping"):
        np.testing.assert_allclose(
            getattr(shipped, field), getattr(made, field), rtol=2e-5, atol=1e-9, err_msg=field
        )
    for model in (shipped, made):
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        assert np.abs(data.qacc).max() < 1e-6  # it hangs in balance
    config = {
        c.attrib["key"]: c.attrib["value"]
        for c in ET.parse(models_xml.path("cable")).getroot().iter("config")
    }
    damper = cable_damper()
    assert config.pop("law") == damper.law
    assert {key: float(value) for key, value in config.items()} == damper.attributes


@pytest.mark.parametrize(
    "values", [{"length": 0.0}, {"tension": -1.0}, {"sag": -1.0}, {"damper_at": 1.0}, {"modes": 0}]
)
def test_cables_that_cannot_be(values: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="cable: "):
        StayCable(**values)


@pytest.mark.parametrize("engine", ["mujoco", "chain"])
def test_accelerometers_with_a_bandwidth_are_scipys_filter_of_the_mean_acceleration(engine: str) -> None:
    signals = [f"{what}_{j}" for what in ("acceleration", "velocity") for j in (1, 2)]
    task = CableTask(1, engine=engine, bandwidth=15.0, signals=signals, loads=AmbientLoads(duration=1.0))
    task.reset([0], [np.random.default_rng(1)])
    found = []
    for k in range(100):
        task.step(np.array([math.sin(k)]))
        found.append(task.measured[0, [0, 1, 4, 5]])
    read, velocity = np.split(np.array(found), 2, axis=1)
    mean = np.diff(velocity, axis=0, prepend=0.0) / 5e-3
    np.testing.assert_allclose(read, lfilter(*butter(2, 15.0, fs=200.0), mean, axis=0), atol=1e-9)


@pytest.mark.slow
def test_what_an_accelerometer_with_a_bandwidth_reads_does_not_hang_on_the_modes() -> None:
    """At five times the damper's distance, under commands that switch; without a bandwidth it does."""
    load = WindLoads(duration=3.0).draw(np.random.default_rng(3), StayCable().length)
    rms: dict[float | None, list[float]] = {}
    for bandwidth in (15.0, None):
        for modes in (10, 40):
            cable = replace(StayCable(), modes=modes)
            plant = CablePlant(cable, bandwidth=bandwidth, timestep=6.25e-5, engine="chain")
            plant.reset(load)
            rng = np.random.default_rng(1)
            found = [plant.step(rng.choice([0.0, 4.0]))["acceleration_2"] for _ in range(580)]
            rms.setdefault(bandwidth, []).append(float(np.std(found)))
    assert rms[15.0][1] == pytest.approx(rms[15.0][0], rel=0.05)
    assert rms[None][1] != pytest.approx(rms[None][0], rel=0.2)


@pytest.mark.parametrize("engine", ["mujoco", "chain"])
def test_a_load_is_kept_at_its_own_samples(engine: str) -> None:
    """Not at the engine's 160,000 steps: 20 s of wind below 15 Hz are 60 samples a second in 11 coordinates."""
    plant = CablePlant(engine=engine)
    load = WindLoads(duration=20.0).draw(np.random.default_rng(0), 12.65)
    tracemalloc.start()
    plant.reset(load)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert plant.rows.plants.save(0).load.shape == (1201, 11)
    assert peak < 2e6


def test_every_engine_step_is_pushed_along_the_loads_lines() -> None:
    """Also behind its end, where it stays as it is to the end of the control period and is none afterwards."""
    plant = CablePlant(period=5e-3, timestep=1e-3)
    force = np.random.default_rng(1).normal(size=(7, 1))
    plant.reset(CableLoad("drawn", 1 / 60, np.array([0.5]), force))
    plants, pushes = plant.rows.plants, []
    for _ in range(23):
        pushes.append(plants.loads_at(np.arange(1), plants.step[:, None] + np.arange(5))[0])
        plant.step(1.0)
    time = 1e-3 * np.arange(5 * len(pushes))
    expected = np.interp(time, np.arange(7) / 60, force[:, 0]) * (time < 0.1049)
    per_newton = StayCable().load_matrix(np.array([0.5]))[0]
    np.testing.assert_allclose(np.concatenate(pushes), expected[:, None] * per_newton, atol=1e-9)
