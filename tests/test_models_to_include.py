"""What a user takes into a model or program of his own: the car with contacts, the sets as files, the C examples."""

from __future__ import annotations

import re
import runpy
import shutil
import subprocess
from pathlib import Path

import mujoco
import numpy as np
import pytest

from excitation import Array
from mrdamp import models_xml, sets
from mrdamp.cli import main
from mrdamp.library import library_path

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
