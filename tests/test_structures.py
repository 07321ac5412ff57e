"""Structures against published matrices and the equations of motion; models to be included, and the examples in C."""

from __future__ import annotations

import itertools
import re
import runpy
import shutil
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from excitation import Array
from mrdamp import models_xml, sets
from mrdamp.cli import main
from mrdamp.library import library_path
from mrdamp.structures import ShearFrame, dyke1996


def test_dyke_frame_has_the_published_matrices_and_modes() -> None:
    frame = dyke1996()
    # Dyke et al. 1996, in SI, with K22 not rounded.
    k = [[12e5, -6.84e5, 0], [-6.84e5, 13.68e5, -6.84e5], [0, -6.84e5, 6.84e5]]
    np.testing.assert_allclose(frame.stiffness_matrix, k, rtol=1e-14)
    np.testing.assert_allclose(frame.damping_matrix, [[175, -50, 0], [-50, 100, -50], [0, -50, 50]])
    np.testing.assert_allclose(frame.mass_matrix, 98.3 * np.eye(3))
    np.testing.assert_allclose(frame.frequencies, [5.44, 15.81, 23.63], rtol=3e-4)
    np.testing.assert_array_equal(frame.gamma, [-1, 0, 0])
    assert frame.weight == pytest.approx(3 * 98.3 * 9.80665)


def test_frequencies_agree_with_the_poles() -> None:
    frame = ShearFrame(np.array([120.0, 90, 70]), np.array([4e5, 5e5, 3e5]), np.array([80.0, 150, 20]))
    inverse = np.linalg.inv(frame.mass_matrix)
    a = np.block(
        [[np.zeros((3, 3)), np.eye(3)], [-inverse @ frame.stiffness_matrix, -inverse @ frame.damping_matrix]]
    )
    poles = np.linalg.eigvals(a)
    poles = poles[poles.imag > 0]
    poles = poles[np.argsort(np.abs(poles))]
    np.testing.assert_allclose(frame.frequencies, np.abs(poles) / (2 * np.pi), rtol=1e-4)


def test_geometry_between_floors() -> None:
    frame = dyke1996(damper_between=(1, 3))
    x = np.array([[0.1, 0.3, 0.7], [0.0, -0.2, 0.2]])
    np.testing.assert_array_equal(frame.gamma, [1, 0, -1])
    np.testing.assert_allclose(frame.stroke(x), [0.6, 0.2])
    np.testing.assert_allclose(frame.displacement([[0.1, 0.2, 0.4], [0.0, -0.2, 0.4]]), x)


# Dyke et al. 1996, typed in, so that the model is not checked against the package alone.
STIFFNESS = np.array([[12e5, -6.84e5, 0], [-6.84e5, 13.68e5, -6.84e5], [0, -6.84e5, 6.84e5]])
DAMPING = np.array([[175.0, -50, 0], [-50, 100, -50], [0, -50, 50]])
MASS = 98.3


def without_plugins(path: Path) -> ET.Element:
    """The model's XML, its includes put in, less everything that needs a plugin."""
    root = ET.parse(path).getroot()
    for include in root.findall("include"):
        root.remove(include)
        root.extend(list(without_plugins(path.parent / include.attrib["file"])))
    for extension in root.findall("extension"):
        root.remove(extension)
    for group in [*root.findall("actuator"), *root.findall("sensor")]:
        for plugin in group.findall("plugin"):
            group.remove(plugin)
    return root


def compiled(name: str, file: str = "model.xml") -> mujoco.MjModel:
    root = without_plugins(models_xml.path(name, file))
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))


def ground_motion() -> Callable[[float], float]:
    """Sines from 1 to 30 Hz with random phases under a smooth envelope, m/s2, about 3 m/s2 peak."""
    rng = np.random.default_rng(7)
    w = 2 * np.pi * np.linspace(1, 30, 40)
    phase, size = rng.uniform(0, 2 * np.pi, 40), rng.uniform(0.1, 0.5, 40)
    return lambda t: float((size * np.sin(w * t + phase)).sum() * np.sin(np.pi * t / 6) ** 2)


def test_ground_control_gives_the_response_of_the_equations() -> None:
    ground, h, n = ground_motion(), 2.5e-4, 24000
    model = compiled("frame3")
    model.opt.timestep = h
    data = mujoco.MjData(model)
    assert (model.nu, model.nsensordata) == (1, 13)
    rows = np.empty((n, model.nsensordata))
    table = np.empty(n)
    inputs = [ground(i * h) for i in range(n)]
    for i in range(n):
        data.ctrl[0] = inputs[i]
        mujoco.mj_step(model, data)
        rows[i] = data.sensordata  # of the state before the step
        table[i] = data.qacc[0]

    def rate(t: float, s: Array) -> Array:
        return np.concatenate([s[3:], (-STIFFNESS @ s[:3] - DAMPING @ s[3:]) / MASS - ground(t)])

    times = np.arange(n) * h
    run = solve_ivp(rate, (0, times[-1]), np.zeros(6), method="DOP853", t_eval=times, rtol=1e-7, atol=1e-9)
    x, v = run.y[:3].T, run.y[3:].T
    drift = np.diff(x, axis=1, prepend=0)
    acceleration = (-x @ STIFFNESS - v @ DAMPING) / MASS

    def names(prefix: str) -> list[int]:
        return [int(model.sensor(f"{prefix}_{i}").adr[0]) for i in (1, 2, 3)]

    for ours, exact in ((rows[:, names("drift")], drift), (rows[:, names("acceleration")], acceleration)):
        assert (np.sqrt(((ours - exact) ** 2).mean(axis=0) / (exact**2).mean(axis=0)) < 0.005).all()
    velocity = rows[:, int(model.sensor("stroke_velocity").adr[0])]
    assert np.sqrt(((velocity - v[:, 0]) ** 2).mean() / (v[:, 0] ** 2).mean()) < 0.02
    np.testing.assert_allclose(table, inputs, rtol=1e-5, atol=1e-5)


def test_rig_follows_an_imposed_motion() -> None:
    model = compiled("rig")
    data = mujoco.MjData(model)
    h = model.opt.timestep
    x = 0.01 + 0.02 * np.sin(2 * np.pi * 3 * np.arange(2001) * h)
    data.qpos[0] = x[0]
    found = []
    for now, after in itertools.pairwise(x):
        data.qvel[0] = (after - now) / h
        data.qfrc_applied[0] = -3000.0  # what a damper may pull with
        mujoco.mj_step(model, data)
        found.append(float(data.qpos[0]))
    np.testing.assert_allclose(found, x[1:], rtol=0, atol=5e-9)
    # Up is extension: the machine's axis points away from the cylinder, which stands on the ground.
    np.testing.assert_array_equal(data.joint("piston").xaxis, [0, 0, 1])
    assert data.geom("rod").xpos[2] > data.geom("cylinder").xpos[2]


@pytest.mark.parametrize("name", [name for name in models_xml.names() if name != "car"])
@pytest.mark.parametrize("file", ["model.xml", "scene.xml"])
def test_models_are_drawn_only_and_stay_at_rest(name: str, file: str) -> None:
    model = compiled(name, file)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 100)
    # The cable hangs in balance to rounding; nothing moves the others at all.
    assert np.abs(data.qpos).max() < (1e-9 if name == "cable" else 1e-300)
    assert data.ncon == 0
    for camera in ("front", "damper"):
        assert model.camera(camera).id >= 0


@pytest.mark.parametrize("name", ["frame3", "rig"])
def test_damper_of_the_models_is_the_published_one(name: str) -> None:
    # Spencer et al. 1997, converted from cm by hand; x0 = 0 and the driver of Dyke et al. 1996.
    published = {
        "c0a": 21e2, "c0b": 3.5e2, "c1a": 283e2, "c1b": 2.95e2, "k0": 46.9e2, "k1": 5e2, "x0": 0.0,
        "alpha_a": 140e2, "alpha_b": 695e2, "gamma": 363e4, "beta": 363e4, "A": 301.0, "n": 2.0,
        "command_min": 0.0, "command_max": 2.25, "driver_lag_tau": 1 / 190,
    }  # fmt: skip
    root = ET.parse(models_xml.path(name)).getroot()
    config = {c.attrib["key"]: c.attrib["value"] for c in root.iter("config")}
    assert config.pop("law") == "modified_bouc_wen"
    assert {key: float(value) for key, value in config.items()} == pytest.approx(published, rel=1e-12)
    joint = {"frame3": "storey1", "rig": "piston"}[name]
    actuator = root.find("actuator/plugin")
    assert actuator is not None
    assert actuator.attrib["joint"] == joint


ROOT = Path(__file__).parents[1]
CORNERS = ("fl_", "fr_", "rl_", "rr_")


@pytest.mark.parametrize("file", ["model.xml", "scene.xml"])
def test_the_car_stands_on_springs_and_tyres(file: str) -> None:
    """By hand: 1600 kg on four springs of 20 kN/m, 1760 kg on four tyres of 210 kN/m."""
    model = mujoco.MjModel.from_xml_path(str(models_xml.path("car", file)))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 6000)
    load = 1600 * 9.81 / 4
    for corner in CORNERS:
        # modified Bouc-Wen at rest: c0 and alpha are relaxed, k1 = 840 N/m is left beside the spring
        stroke = (20000 * 0.22 - load) / (20000 + 840)
        assert data.joint(f"{corner}suspension").qpos[0] == pytest.approx(stroke, abs=2e-4)
        assert data.sensor(f"{corner}force").data[0] == pytest.approx(840 * stroke, rel=0.05)
        pressed = 0.31 - data.body(f"{corner}wheel").xpos[2]
        assert 1760 * 9.81 / 4 / pressed == pytest.approx(210e3, rel=0.01)
    assert data.ncon == 8  # two points a wheel
    assert np.abs(data.qvel).max() < 1e-3
    for camera in ("side", "corner"):
        assert model.camera(camera).id >= 0


@pytest.mark.parametrize("id", sets.names())
def test_a_set_is_a_file_to_include(id: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sets", id, "--include"]) == 0
    path = Path(capsys.readouterr().out.strip())
    written = runpy.run_path(str(ROOT / "tools" / "damper_includes.py"))["include"](id)
    assert path.read_text(encoding="utf-8") == written, "run tools/damper_includes.py"
    text = f"""<mujoco><include file="{path}"/>
<worldbody><body><joint name="s" type="slide"/><geom size=".1"/></body></worldbody>
<actuator><plugin name="a" joint="s" plugin="mrdamp.damper" instance="{id}"/></actuator></mujoco>"""
    (tmp_path / "model.xml").write_text(text, encoding="utf-8")
    spec = mujoco.MjSpec.from_file(str(tmp_path / "model.xml"))
    (instance,) = spec.plugins
    config = dict(instance.config)
    assert config.pop("law") == sets.load(id).law
    assert {key: float(value) for key, value in config.items()} == sets.load(id).attributes()
    assert mujoco.MjData(spec.compile()).time == 0.0


def test_other_ports_of_the_engine_do_not_take_it_for_a_motor() -> None:
    """MJX refuses biases that it does not know; else the damper would be a motor, its force the command."""
    model = mujoco.MjModel.from_xml_path(str(models_xml.path("quarter_car")))
    assert model.actuator("damper").biastype[0] == mujoco.mjtBias.mjBIAS_USER
    assert model.actuator("road").biastype[0] != mujoco.mjtBias.mjBIAS_USER


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_the_c_example_steps_as_python_does(tmp_path: Path) -> None:
    engine = Path(mujoco.__file__).parent
    source = ROOT / "examples" / "step.c"
    command = ["gcc", "-std=c99", "-Wall", "-Werror", f"-I{engine}/include", str(source)]
    command += [str(engine / "libmujoco.so.4.0.0"), f"-Wl,-rpath,{engine}", "-o", str(tmp_path / "step")]
    subprocess.run(command, check=True)
    path = models_xml.path("quarter_car")
    run = [str(tmp_path / "step"), str(library_path()), str(path), "1.0"]
    done = subprocess.run(run, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    rows = np.array([[float(cell) for cell in line.split()] for line in done.stdout.splitlines()])
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qvel[-1], data.actuator("damper").ctrl[0] = 0.5, 1.0
    for time, force, stroke in rows:
        while data.time < time - 1e-9:
            mujoco.mj_step(model, data)
        assert -data.actuator("damper").force[0] == pytest.approx(force, abs=1e-3)
        assert data.actuator("damper").length[0] == pytest.approx(stroke, abs=1e-6)
    assert np.ptp(rows[:, 1]) > 100.0
    nothing = subprocess.run([run[0], run[1], "none.xml", "1"], capture_output=True, text=True, timeout=60)
    assert nothing.returncode == 1


SOURCE = ROOT / "plugin_cpp"


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example, compiled by the README's own lines in a copy of the sources."""
    for compiler in ("gcc", "g++"):
        if shutil.which(compiler) is None:
            pytest.skip(f"{compiler} is not installed")
    folder = tmp_path_factory.mktemp("realtime") / "plugin_cpp"
    shutil.copytree(SOURCE, folder)
    commands = re.findall(r"^    (g.*)$", (SOURCE / "realtime" / "README.md").read_text(), re.MULTILINE)
    assert len(commands) == 2
    strict = commands[0].replace("-std=c99", "-std=c99 -pedantic-errors -Wall -Wextra -Werror")
    for command in (strict, commands[1]):
        subprocess.run(command, shell=True, cwd=folder, check=True)
    return folder / "damper"


def run(program: Path, *arguments: str, text: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run([program, *arguments], input=text, capture_output=True, text=True, timeout=60)


def table(program: Path, *arguments: str, text: str = "") -> Array:
    done = run(program, *arguments, text=text)
    assert (done.returncode, done.stderr) == (0, "")
    return np.array([[float(cell) for cell in line.split()] for line in done.stdout.splitlines()])


@pytest.mark.slow
def test_bingham_from_standard_input_is_the_closed_form(program: Path) -> None:
    time = 1e-3 * np.arange(400)
    x, v, u = 0.01 * np.sin(20 * time), 0.2 * np.cos(20 * time), 1.0 + np.cos(3 * time)
    rows = np.stack([x, v, u], axis=1)
    lines = "".join("{!r} {!r} {!r}\n".format(*row) for row in rows.tolist())
    got = table(program, "-i", "bingham", "c0a=600", "c0b=150", "fya=40", "fyb=300", "v_ref=0.02", text=lines)
    np.testing.assert_allclose(got[:, 0], time, atol=1e-9)
    np.testing.assert_allclose(got[:, 1:4], rows, rtol=1e-8)
    force = (600 + 150 * u) * v + (40 + 300 * u) * np.tanh(v / 0.02)
    np.testing.assert_allclose(got[:, 4], force, rtol=1e-6, atol=1e-5)
