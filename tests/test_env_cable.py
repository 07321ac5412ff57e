"""The cable: damping of a taut string, Irvine's frequencies, energy, its two models and its environment."""

from __future__ import annotations

import cmath
import math
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.signal import butter, lfilter

from env_arguments import dashpot
from excitation import Array
from mrdamp import models_xml
from mrdamp.envs import AmbientLoads, CableLoad, CablePlant, CableTask, WindLoads, cable_damper
from mrdamp.envs.cable import Cable
from mrdamp.envs.cable_xml import chain_xml
from mrdamp.structures.cables import StayCable


def test_a_point_load_pushes_as_much_as_it_should() -> None:
    """Static: a uniform load's deflection is w L^2 / (8 T) at mid-span of a taut string."""
    cable = StayCable(ratio=0.2, modes=14)
    plant = CablePlant(cable, dashpot(50.0), (0.5,), command_max=1.0)
    y = plant.reset(CableLoad("even", 1.0, np.array([0.5]), np.full((12, 1), 2.0)))
    while not plant.finished:
        y = plant.step(0.0)
    assert y["displacement_1"] == pytest.approx(2.0 * 12.65**2 / (8 * 2172.0), rel=2e-3)


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


def test_no_reading_is_cut_off() -> None:
    """The accelerometer at the damper under a command that switches: what is observed is what is measured."""
    task, pick = CableTask(1, loads=WindLoads(duration=2.0)), np.random.default_rng(0)
    task.reset([0], [pick])
    k = task.observer.signals.index("acceleration_1")
    seen, measured = [], []
    for _ in range(300):
        step = task.step(np.sign(pick.uniform(-1, 1, (1, 1))))
        seen.append(step.observation[0, k] * task.observer.scales[k])
        measured.append(task.measured[0, task.rows.names.index("acceleration_1")])
    assert np.max(np.abs(measured)) > 10.0  # m/s2
    np.testing.assert_allclose(seen, measured, rtol=1e-5)


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


PLACES = (0.01, 0.02, 0.05)


GRAVITY = 9.80665


def exact(eta: float, place: float, mode: int) -> complex:
    """Complex wave number times length of a taut string with a dashpot eta (T m)^(1/2) at `place`. sin b = -i eta
    sin(b a) sin(b (1 - a)), from v = A sin(b x) and B sin(b (1 - x)) on both sides and the jump of the slope; damping
    ratio im b / |b|, frequency |b| / pi over the string's first."""

    def miss(b: complex) -> complex:
        return cmath.sin(b) + 1j * eta * cmath.sin(b * place) * cmath.sin(b * (1 - place))

    b = complex(mode * math.pi, 0.01)
    for _ in range(60):
        b -= miss(b) * 2e-7 / (miss(b + 1e-7) - miss(b - 1e-7))
    assert abs(miss(b)) < 1e-9
    return b


def stepped_poles(cable: StayCable, c: float) -> Array:
    """Poles (1/s) with positive frequency of the natural coordinates with a dashpot, as the engine steps them at 1
    ms. From a free motion of all coordinates: the linear map from one step to the next that it obeys."""
    model = mujoco.MjModel.from_xml_string(Cable(cable, dashpot(c)).mjcf(1e-3))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    w = cable.natural
    data.qpos[:], data.qvel[:] = 0.01 * w[0] * rng.normal(size=(2, model.nv)) * [1 / w, np.ones(model.nv)]
    rows = np.empty((600, 2 * model.nv))
    for row in rows:
        row[:] = *(data.qpos * w), *data.qvel
        mujoco.mj_step(model, data)
    step = np.linalg.lstsq(rows[1:-1], rows[2:])[0]
    assert np.abs(rows[1:-1] @ step - rows[2:]).max() < 1e-10 * np.abs(rows).max()
    roots = np.linalg.eigvals(step).astype(np.complex128)
    found = np.log(roots[np.abs(roots) > 1e-6]) / model.opt.timestep
    return np.asarray(found[found.imag > 1.0])


def linear(model: mujoco.MjModel) -> tuple[Array, Array]:
    """Masses (n,) and stiffness matrix (n, n) of a chain about its rest, by differences."""
    data = mujoco.MjData(model)
    mass = np.asarray(model.body_mass[model.jnt_bodyid])
    rows = []
    for k in range(model.nv):
        forces = []
        for sign in (1, -1):
            mujoco.mj_resetData(model, data)
            data.qpos[k] = sign * 1e-6
            mujoco.mj_forward(model, data)
            forces.append(data.qacc * mass)
        rows.append(-(forces[0] - forces[1]) / 2e-6)
    return mass, np.array(rows).T


@pytest.mark.parametrize("kappa", [0.03, 0.1013, 0.2])
@pytest.mark.parametrize("place", PLACES)
def test_modal_damping_is_that_of_the_string(place: float, kappa: float) -> None:
    """Below, at and above the first mode's best dashpot, modes 1 to 5: ratio within 2 %, frequency within 0.1 %."""
    eta = kappa * math.pi / place
    cable = StayCable(damper_at=place, ratio=1e-9)
    poles = stepped_poles(cable, eta * math.sqrt(cable.tension * cable.mass))
    for mode in range(1, 6):
        b = exact(eta, place, mode)
        pole = poles[np.argmin(np.abs(poles - 1j * abs(b) / math.pi * cable.first))]
        ratio = -pole.real / abs(pole)
        assert ratio == pytest.approx(b.imag / abs(b), rel=0.02), mode
        assert abs(pole) == pytest.approx(abs(b) / math.pi * cable.first, rel=1e-3), mode
        # What the exact ratio tends to for a small place: the curve of Pacheco, Fujino and Sulekh, 1993.
        if mode * place <= 0.02:
            curve = place * math.pi**2 * kappa * mode / (1 + (math.pi**2 * kappa * mode) ** 2)
            assert ratio == pytest.approx(curve, rel=0.025), mode


def irvine(sag: float, count: int) -> Array:
    """Frequencies of the flat-sag cable over sqrt(T / m) / L, ascending: those of the string's antisymmetric modes, and
    tan(w / 2) = w / 2 - (4 / lambda^2) (w / 2)^3 (Irvine, Cable Structures, 1981, ch. 3)."""
    found = [2 * math.pi * k for k in range(1, count + 1)]
    for k in range(count):
        if sag == 0:
            found.append((2 * k + 1) * math.pi)
            continue
        low, high = (k + 0.5) * math.pi, (k + 1.5) * math.pi  # poles of the tangent, one root between them
        found.append(
            2 * brentq(lambda w: (w - 4 / sag * w**3) * math.cos(w) - math.sin(w), low + 1e-12, high - 1e-12)
        )
    return np.sort(np.array(found))[:count]


@pytest.mark.parametrize("sag", [0.0, 1.0, 4.0, 60.0])
def test_frequencies_are_irvines(sag: float) -> None:
    """Natural coordinates and chain within 0.5 %, modes 1 to 5."""
    cable = StayCable(sag=sag)
    wanted = irvine(sag, 5) * math.sqrt(cable.tension / cable.mass) / cable.length
    np.testing.assert_allclose(cable.natural[:5], wanted, rtol=5e-3)
    mass, stiffness = linear(mujoco.MjModel.from_xml_string(chain_xml(cable)))
    found = np.sqrt(np.sort(np.linalg.eigvals(stiffness / mass[:, None]).real)[:5])
    np.testing.assert_allclose(found, wanted, rtol=5e-3)


@pytest.mark.parametrize("sag", [0.0, 2.0])
def test_the_chain_hangs_as_irvines_parabola(sag: float) -> None:
    """Let go from a straight line, with much damping: depth m g L^2 / (8 T) and 3/4 of it at the quarters."""
    cable = StayCable(sag=sag)
    model = mujoco.MjModel.from_xml_string(chain_xml(cable, segments=48))
    model.dof_damping[:] = 0.5
    data = mujoco.MjData(model)
    z = np.array([model.body(f"node{k}").pos[2] for k in range(1, 48)])
    data.qpos[:] = -z
    mujoco.mj_step(model, data, 20000)
    hung = z + data.qpos
    depth = cable.mass * GRAVITY * cable.length**2 / (8 * cable.tension)
    assert -hung[23] == pytest.approx(depth, rel=5e-3)
    assert -hung[11] == pytest.approx(0.75 * depth, rel=5e-3)
    tension = model.tendon_stiffness[0] * (data.ten_length[0] - model.tendon_lengthspring[0, 0])
    assert tension == pytest.approx(cable.tension, rel=2e-3)


@pytest.mark.parametrize(
    ("kind", "sag", "strength", "limits"),
    [("dashpot", 1.0, 0.05, (0.03, 0.03, 0.05)), ("yielding", 0.0, 16.0, (0.03, 0.1, 0.3))],
)
def test_both_models_move_alike(kind: str, sag: float, strength: float, limits: tuple[float, ...]) -> None:
    """Wind on the natural coordinates and on the chain's nodes: motion at mid-span, stroke and force, RMS error. A
    damper that sticks and slips shakes waves that ten sines do not have; a sagged chain stretches, so that strong
    motion is not the linear one."""
    cable = StayCable(sag=sag, ratio=1e-9)
    damper = dashpot(60.0) if kind == "dashpot" else cable_damper()
    load = WindLoads(duration=6.0).draw(np.random.default_rng(2), cable.length).scaled(strength)
    plant = CablePlant(cable, damper, (0.5,), period=1e-2, command_max=4.0)
    y, found = plant.reset(load), []
    while not plant.finished:
        found.append([y["displacement_1"], y["stroke"], y["force"]])
        y = plant.step(2.0)
    segments, h = 100, 1e-3
    model = mujoco.MjModel.from_xml_string(chain_xml(cable, damper, segments))
    data = mujoco.MjData(model)
    x = np.arange(1, segments) / segments
    nodes = np.array([np.interp(x, load.places, row) for row in load.force]) * cable.length / segments
    time = load.sample_time * np.arange(len(load.force))
    steps = h * np.arange(10 * len(found))
    pushes = np.stack([np.interp(steps, time, node) for node in nodes.T], axis=1)
    data.ctrl[model.actuator("damper").id] = 2.0
    wanted = []
    for k, push in enumerate(pushes):
        data.qfrc_applied[:] = push
        if k % 10 == 0:
            mujoco.mj_forward(model, data)
            middle = data.joint(f"node{segments // 2}").qpos[0]
            wanted.append([middle, data.sensor("stroke").data[0], data.sensor("force").data[0]])
        mujoco.mj_step(model, data)
    a, b = np.array(found), np.array(wanted)
    error = np.sqrt(((a - b) ** 2).mean(axis=0) / (b**2).mean(axis=0))
    assert (error < limits).all(), error


def test_motion_is_measured_where_it_is() -> None:
    cable = StayCable(sag=2.0)
    plant = CablePlant(cable, measured_at=(0.02, 0.3, 0.5))
    y = plant.reset(CableLoad("even", 0.01, np.array([0.5]), np.full((300, 1), 3.0)))
    for _ in range(200):
        y = plant.step(1.0)
    q = plant.rows.plants.position(0)
    assert y["displacement_1"] == pytest.approx(y["stroke"], rel=1e-9)
    assert y["velocity_1"] == pytest.approx(y["stroke_velocity"], rel=1e-9)
    # int v^2 dx from the shape itself, out of the sines and the static shape written out here
    x = np.linspace(0, 1, 20001)
    shapes = np.column_stack(
        [np.minimum(x / 0.02, (1 - x) / 0.98), *(np.sin(k * np.pi * x) for k in range(1, 11))]
    )
    v = shapes @ cable.shapes @ q
    assert y["displacement_3"] == pytest.approx(v[10000], rel=1e-9)
    assert (q @ q) / (cable.mass * cable.length) == pytest.approx(np.trapezoid(v * v, x), rel=1e-4)
